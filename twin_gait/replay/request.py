"""Replay a recorded walk, or healthy walking from the literature, through a gait table."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from twin_gait.configuration import load_experiment, load_gait_table
from twin_gait.core.belt import walk_command
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.experiment import Experiment, PlantParameters
from twin_gait.gait.scaling import scale_table
from twin_gait.gait.signals import DEVICE_SIGNALS, STEP, WALK
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures import reference
from twin_gait.parameters import Patient, SensorParameters, require
from twin_gait.parameters.quantities import POSITIVE
from twin_gait.replay.machine import Progress, Replay, replay
from twin_gait.replay.recording import LogFormat, Recording, read_recording
from twin_gait.runs.log_files import number_of
from twin_gait.runs.record import EXPERIMENT_FILE, LOG_FILE
from twin_gait.vocabulary import JointName, Side

STRIDES = 8
KOOPMAN, WINTER = "koopman", "winter"


def normative_walk(name: str, *, strides: int = STRIDES) -> Recording:
    """A walk of curves from the literature; the left leg begins at heel contact, the right one mid-stride.

    ``name``: ``koopman@1.5`` for the regression of Koopman et al. (2014) at a walking speed in km/h, or
    ``winter`` for the means of Winter (1991) at natural cadence; ``strides``: how many. Raises ParameterError
    if there is no such walk, or the regression does not reach the speed.
    """
    curve: Callable[[JointName, np.ndarray], np.ndarray] = reference.normative_angle
    joints: tuple[JointName, ...] = reference.WINTER_JOINTS
    cycle_time = reference.WINTER_CYCLE_TIME
    if name != WINTER:
        kind, _, text = name.partition("@")
        speed, height = number_of(text) / reference.KILOMETRES_PER_HOUR, Patient().height
        expected = f"{WINTER}, or {KOOPMAN}@ and the speed in km/h"
        require(kind == KOOPMAN and math.isfinite(speed), "log", expected, name)
        curve = partial(reference.reference_curve, speed=speed, height=height)
        joints, cycle_time = tuple(JointName), reference.reference_cycle_time(speed, height)
    time = np.arange(round(strides * cycle_time / TICK)) * TICK
    angles = {}
    for side, lead in ((Side.LEFT, 0.0), (Side.RIGHT, 0.5)):
        percent = reference.CYCLE * np.mod(time / cycle_time + lead, 1.0)
        angles[side] = {str(joint): curve(joint, percent) for joint in joints}
    return Recording(name, 0.0, angles, {}, {})


DEFAULT_TABLE = "treadmill"


def replay_log(
    log: str,
    *,
    table: str | None = None,
    log_format: LogFormat | None = None,
    speed: float | None = None,
    mass: float | None = None,
    start_phases: Mapping[Side, str] | None = None,
    progress: Progress = lambda done, total: None,
) -> Replay:
    """Replay a walk.

    ``log``: run directory, log file, or a walk from the literature such as ``koopman@1.5``; ``table``:
    packaged table or file, by default that of a run, or ``treadmill``; ``log_format``: columns, units and
    signs of the log; ``speed`` of the belt in [m] / [s] that the table is scaled to, by default that of a
    run, or else the table is taken as it is written; ``mass`` of wearer and device in [kg], for guards on the
    load of the foot, by default that of a run; ``start_phases``: phase of each leg at the first tick, where
    it is to be another than the recorded one; ``progress``: called with ticks done and ticks in all, now and
    then. Raises TwinGaitError if log, table or options have a mistake, or do not fit each other.
    """
    for name, value in (("speed", speed), ("mass", mass)):
        if value is not None:
            POSITIVE.require(name, value)
    recording, experiment = _open(log, log_format or LogFormat())
    chosen = _table(table, speed, experiment)
    weight, starts = None if mass is None else mass * PlantParameters().gravity, dict(start_phases or {})
    postures, time_constant = dict[int, str](), SensorParameters().fast_time_constant
    if experiment is not None:
        world, time_constant = experiment.build_world(), experiment.sensors.fast_time_constant
        told, postures = _told(experiment, chosen, recording)
        recording = replace(recording, device={**recording.device, **told})
        known = {side: str(phase) for side, phase in world.initial_phases.items() if phase in chosen.phases}
        weight, starts = weight or world.body_weight, {**known, **starts}
    return replay(
        recording,
        chosen,
        body_weight=weight,
        start_phases=starts,
        postures=postures,
        fast_time_constant=time_constant,
        progress=progress,
    )


def _open(log: str, log_format: LogFormat) -> tuple[Recording, Experiment | None]:
    """The recording, and the experiment if it is of a run."""
    path = Path(log).expanduser()
    if log == WINTER or log.startswith(f"{KOOPMAN}@"):
        if log_format != LogFormat():
            raise ParameterError(f"{log}: has no columns to choose; leave columns, units, convention out")
        return normative_walk(log), None
    if not path.is_dir():
        return read_recording(path, log_format), None
    for name in (EXPERIMENT_FILE, LOG_FILE):
        if not (path / name).is_file():
            raise RunDirectoryError(f"{path}: not a run directory: it has no {name}")
    recording = read_recording(path / LOG_FILE, log_format)
    # What a run does not log of the device stayed as at first: nothing in it moved the signal.
    still = {signal.name: np.full(recording.n_ticks, signal.first) for signal in DEVICE_SIGNALS}
    experiment = load_experiment(path / EXPERIMENT_FILE).experiment
    return replace(recording, source=str(path), device={**still, **recording.device}), experiment


def _told(
    experiment: Experiment, table: GaitTable, recording: Recording
) -> tuple[dict[str, np.ndarray], dict[int, str]]:
    """What the legs of a run were told, by signal, and the phases that modes sent both into, by tick."""
    modes, walking = experiment.modes, experiment.scenario.walking
    if modes is not None:
        replace(experiment, table=table)  # refuses a table that does not offer their postures
        log = pd.read_parquet(Path(recording.source) / LOG_FILE, columns=["mode"])[: recording.n_ticks]
        first = modes.phase_index(experiment.initial_mode or modes.phase_names[0])
        codes, known = log["mode"].to_numpy(int), list(modes.phases.values())
        entries = np.flatnonzero(np.diff(codes, prepend=first))
        sent = {tick: known[codes[tick]].posture for tick in entries.tolist()}
        told = {WALK.name: [mode.walk for mode in known], STEP.name: [mode.step for mode in known]}
        signals = {name: np.array(values, dtype=float)[codes] for name, values in told.items()}
        return signals, {tick: posture for tick, posture in sent.items() if posture is not None}
    if walking is None or walking.belt.ramp == 0.0:
        return {}, {}
    start, stop = walking.belt.start, walking.belt.stop
    return {WALK.name: np.array([walk_command(time, start, stop) for time in recording.time])}, {}


def _table(name: str | None, speed: float | None, experiment: Experiment | None) -> GaitTable:
    """The table asked for, else that of the run, scaled as guards need it: to the speed and the wearer."""
    if name is not None or experiment is None:
        table = load_gait_table(name or DEFAULT_TABLE)
    else:
        table = experiment.table
    height = None
    if experiment is not None and experiment.scenario.walking is not None:
        speed, known = speed or experiment.scenario.walking.speed, experiment.known_patient
        height = None if known is None else known.height
    return scale_table(table, carried_mass=None, speed=speed, height=height)
