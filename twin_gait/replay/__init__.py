"""Recorded walks through the gait state machine, offline: what would this table have done?"""

from twin_gait.replay.agreement import Agreement, agreement
from twin_gait.replay.machine import Replay, replay
from twin_gait.replay.normative import NormativeWalk, normative_walk
from twin_gait.replay.reading import LogFormat, read_recording
from twin_gait.replay.recording import Recording, at_ticks, mirrored, stride_period
from twin_gait.replay.request import ReplayRequest, replay_log
from twin_gait.replay.writing import summarise_replay, write_replay

__all__ = [
    "Agreement",
    "LogFormat",
    "NormativeWalk",
    "Recording",
    "Replay",
    "ReplayRequest",
    "agreement",
    "at_ticks",
    "mirrored",
    "normative_walk",
    "read_recording",
    "replay",
    "replay_log",
    "stride_period",
    "summarise_replay",
    "write_replay",
]
