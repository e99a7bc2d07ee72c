"""Recorded walks through the gait state machine, offline: what would this table have done?"""

from twin_gait.replay.agreement import Agreement, agreement
from twin_gait.replay.machine import Replay, replay
from twin_gait.replay.mirror import mirrored, stride_period
from twin_gait.replay.normative import NormativeWalk, normative_walk
from twin_gait.replay.reading import LogFormat, read_recording
from twin_gait.replay.recording import Recording, at_ticks

__all__ = [
    "Agreement",
    "LogFormat",
    "NormativeWalk",
    "Recording",
    "Replay",
    "agreement",
    "at_ticks",
    "mirrored",
    "normative_walk",
    "read_recording",
    "replay",
    "stride_period",
]
