"""Replay of a recorded walk through the gait state machine: the decisions of the controller on it.

The walk is a log of a device or of a run. The recorded angles pass through the velocity estimator of the
firmware and the evaluator of the state machine, tick by tick in the order of the engines: measure, then
advance both legs on one snapshot. A walk that lacks a signal which a guard reads is rejected.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from twin_gait.configuration.experiments import load_experiment
from twin_gait.configuration.gait_table_file import load_gait_table
from twin_gait.core.belt import walk_command
from twin_gait.core.control_tick import measure_joint, new_encoder
from twin_gait.core.estimation import first_order_gain
from twin_gait.exceptions import GaitTableError, ParameterError
from twin_gait.experiment.device import PlantParameters
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait import signals
from twin_gait.gait.guards import PhaseMembership, atoms
from twin_gait.gait.machine import POSTURE, GaitStateMachine, PhaseSwitch
from twin_gait.gait.program import compile_guards
from twin_gait.gait.scaling import scale_table
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.parameters.quantities import POSITIVE
from twin_gait.replay.recording import LogFormat, is_normative, normative_walk, read_recording
from twin_gait.replay.samples import Recording
from twin_gait.runs.record import EXPERIMENT_FILE, LOG_FILE
from twin_gait.vocabulary import Side

OTHER_PHASE = f"{signals.OTHER}phase"
Signals = dict[str, np.ndarray]  # signals by name in SI units, shape ``(n,)``
# The thresholds of the table treadmill are for a trunk that pitches in straps, and slow healthy walking does
# not reach them (docs/reference/replay.md).
DEFAULT_TABLE = "treadmill_guided"


@dataclass(frozen=True, eq=False)
class Replay:
    """A recorded walk with the phases that a table assigns to it."""

    table: GaitTable  # the gait table
    recording: Recording  # the walk
    # fast velocity estimate of each recorded joint of the table in [rad/s], shape ``(n,)``
    velocities: Mapping[tuple[Side, str], np.ndarray]
    phases: Mapping[Side, np.ndarray]  # index of the phase of each leg at each tick, shape ``(n,)``, integers
    switches: tuple[PhaseSwitch, ...]  # every change of phase with its cause
    # signals that guards read but the log lacks, with their constant value in the unit of the table
    assumed: Mapping[str, float]


def replay(recording: Recording, table: GaitTable) -> Replay:
    """Run the state machines of the recorded legs over a walk.

    A leg begins in its recorded phase if the table has it, or else in the first phase of the table. Raises
    GaitTableError if the guards need a signal that was not recorded.
    """
    total, sides, program = recording.n_ticks, recording.sides, compile_guards(table)
    leg_signals = {side: _leg_signals(recording, table, side) for side in sides}
    known = {side: _available_signals(recording, leg_signals, side) for side in sides}
    assumed = _assumed_commands(recording, table, known)
    starts = {side: str(phases[0]) for side, phases in recording.phases.items()} | {**recording.starts}
    first = {side: phase for side, phase in starts.items() if phase in table.phases}
    machines = [
        GaitStateMachine(table, side, initial_phase=first.get(side, table.phase_names[0]), program=program)
        for side in sides
    ]
    read = [_columns(table, known[side], total) for side in sides]
    time, other_time = table.signals.index(signals.TIME), table.signals.index(signals.OTHER_TIME)
    phase, switches = np.zeros((total, len(machines)), dtype=int), list[PhaseSwitch]()
    for tick in range(total):
        posture = recording.postures.get(tick)
        for machine in machines:
            if posture is not None and machine.phase != posture:
                switches.append(PhaseSwitch(tick, machine.side, machine.phase, posture, POSTURE, -1))
                machine.enter(posture, tick)
        times = [machine.time_in_phase(tick) for machine in machines]
        before = [machine.phase_index for machine in machines]
        for leg, machine in enumerate(machines):
            others, values = len(machines) - 1 - leg, read[leg][tick].tolist()
            values[time], values[other_time] = times[leg], times[others]
            switch = machine.advance(tick, values, -1 if others == leg else before[others])
            if switch is not None:
                switches.append(switch)
        phase[tick] = [machine.phase_index for machine in machines]
    driven = [(side, joint) for side, joint in recording.angles if joint in table.joints]
    velocities = {
        (side, joint): leg_signals[side][signals.VELOCITY.joint_signal_name(joint)] for side, joint in driven
    }
    phases = {side: phase[:, leg] for leg, side in enumerate(sides)}
    return Replay(table, recording, velocities, phases, tuple(switches), assumed)


def _leg_signals(recording: Recording, table: GaitTable, side: Side) -> Signals:
    """Compute the signals of a leg: angles as its boards measure them, fast velocity estimates, the load."""
    found, slowest = Signals(), 1  # the slow velocity is not read
    gain = first_order_gain(TICK, recording.fast_time_constant)
    for joint in (joint for joint in table.joints if (side, joint) in recording.angles):
        encoder, measured = new_encoder(0.0, 0.0, slowest), np.zeros((2, recording.n_ticks))
        for tick, value in enumerate(recording.angles[side, joint].tolist()):
            measure_joint(encoder, tick, value, TICK, gain, slowest)
            measured[:, tick] = encoder.angle, encoder.velocity_fast
        angle, velocity = measured
        found[signals.ANGLE.joint_signal_name(joint)] = angle
        found[signals.VELOCITY.joint_signal_name(joint)] = velocity
    if recording.body_weight is not None and side in recording.loads:
        found[signals.LOAD.name] = recording.loads[side] / recording.body_weight
    return found


def _available_signals(recording: Recording, leg_signals: Mapping[Side, Signals], side: Side) -> Signals:
    """Return the signals that the guards of a leg can read; 0 for those that are counted tick by tick."""
    counted = [signals.TIME] if len(leg_signals) == 1 else [signals.TIME, signals.OTHER_TIME, OTHER_PHASE]
    others = {
        signals.OTHER + name: item
        for other in leg_signals
        if other is not side
        for name, item in leg_signals[other].items()
    }
    still = np.zeros(recording.n_ticks)
    return {**dict.fromkeys(counted, still), **recording.device, **leg_signals[side], **others}


def _columns(table: GaitTable, known: Signals, ticks: int) -> np.ndarray:
    """Arrange signals in the order of the table, shape ``(ticks, n_signals)``.

    Unknown signals have their initial value, or 0 if there is none.
    """
    unknown = {
        name: np.full(ticks, np.nan_to_num(signals.find_signal(name).initial_value)) for name in table.signals
    }
    return np.column_stack([known.get(name, unknown[name]) for name in table.signals])


def _assumed_commands(
    recording: Recording, table: GaitTable, known: Mapping[Side, Signals]
) -> dict[str, float]:
    """Return the commands that no log contains, with their assumed values.

    Raises GaitTableError if the walk lacks any other signal that a guard reads.
    """
    assumed = {}
    for item, side in product(table.transitions, known):
        for atom in atoms(item.guard):
            read = (OTHER_PHASE,) if isinstance(atom, PhaseMembership) else atom.names
            for name in (name for name in read if name not in known[side]):
                if (
                    name == OTHER_PHASE
                    or name not in signals.DEVICE_NAMES
                    or signals.find_signal(name).column
                ):
                    raise GaitTableError(
                        f"{recording.source}: the table {table.name} reads {name} in {item.source} → "
                        f"{item.target} ({item.cause}), not known of the {side} leg: name its column with "
                        f"--columns (of {signals.LOAD.name} add --total-mass KG; of {signals.OTHER}… name "
                        "those of both legs), or take another table"
                    )
                assumed[name] = (
                    signals.find_signal(name).initial_value / signals.find_signal(name).unit.factor
                )
    return assumed


def replay_log(
    log: str,
    *,
    table: str | None = None,
    log_format: LogFormat | None = None,
    speed: float | None = None,
    mass: float | None = None,
) -> Replay:
    """Replay a walk.

    ``log``: run directory, log file, or a walk from the literature such as ``koopman@1.5``. ``table``:
    packaged table or file; the default is the table of the run, or
    ``treadmill_guided``. ``log_format``: columns,
    units and signs of the log. ``speed``: speed of the belt in [m/s] to which the table is scaled; the
    default is the speed of the run, and without one the table is not scaled. ``mass``: mass of wearer and
    device in [kg], for guards on the load of the foot; the default is that of the run. Raises TwinGaitError
    if log, table or options have a mistake, or do not fit each other.
    """
    for name, value in (("speed", speed), ("mass", mass)):
        if value is not None:
            POSITIVE.require(name, value)
    recording, experiment = _open(log, log_format or LogFormat())
    height = None
    if experiment is None or table is not None:
        chosen = load_gait_table(table or DEFAULT_TABLE)
    else:
        chosen = experiment.table
    if experiment is not None:
        recording = _add_run_data(recording, experiment, chosen)
        walking, patient = experiment.scenario.walking, experiment.assumed_patient
        if walking is not None:
            speed, height = speed or walking.speed, None if patient is None else patient.height
    if mass is not None:
        recording = replace(recording, body_weight=mass * PlantParameters.gravity)
    return replay(recording, scale_table(chosen, carried_mass=None, speed=speed, height=height))


def _open(log: str, log_format: LogFormat) -> tuple[Recording, Experiment | None]:
    """Read the recording, and its experiment if it belongs to a run."""
    path = Path(log).expanduser()
    if is_normative(log):
        if replace(log_format, subject=None, task=None) != LogFormat():
            text = "is not a log; leave columns, units, convention, gaps and the time of a cycle out"
            raise ParameterError(f"{log}: {text}")
        return normative_walk(log), None
    if not path.is_dir():
        return read_recording(path, log_format), None
    if log_format.cycle_time is not None:
        raise ParameterError(f"cycle_time: {log} is a run, whose time is in seconds; leave it out")
    recording = replace(read_recording(path / LOG_FILE, log_format), source=log)
    return recording, load_experiment(path / EXPERIMENT_FILE).experiment


def _add_run_data(recording: Recording, experiment: Experiment, table: GaitTable) -> Recording:
    """Add the data of a run to the recording of the device's legs: initial phases, and received commands."""
    world, modes, walking = experiment.build_world(), experiment.modes, experiment.scenario.walking
    # A signal of the device that a run does not log kept its initial value: nothing in the run changed it.
    device = {item.name: np.full(recording.n_ticks, item.initial_value) for item in signals.DEVICE_SIGNALS}
    device, postures = device | {**recording.device}, dict[int, str]()
    if modes is not None:
        replace(experiment, table=table)  # rejects a table that lacks their postures
        log = pd.read_parquet(Path(recording.source).expanduser() / LOG_FILE, columns=["mode"])
        codes, modes_by_code = log["mode"].to_numpy(int)[: recording.n_ticks], list(modes.phases.values())
        first = modes.phase_index(experiment.initial_mode or modes.phase_names[0])
        for tick in np.flatnonzero(np.diff(codes, prepend=first)).tolist():
            posture = modes_by_code[codes[tick]].posture
            if posture is not None:
                postures[tick] = posture
        device[signals.WALK.name] = np.array([mode.walk for mode in modes_by_code], dtype=float)[codes]
        device[signals.STEP.name] = np.array([mode.step for mode in modes_by_code], dtype=float)[codes]
    elif walking is not None and walking.belt.ramp > 0.0:
        start, stop = walking.belt.start, walking.belt.stop
        device[signals.WALK.name] = np.array([walk_command(time, start, stop) for time in recording.time])
    sides = experiment.sides  # the wearer may have another leg, which the table does not control
    return replace(
        recording,
        angles={key: values for key, values in recording.angles.items() if key[0] in sides},
        loads={side: values for side, values in recording.loads.items() if side in sides},
        phases={side: values for side, values in recording.phases.items() if side in sides},
        device=device,
        body_weight=world.body_weight,
        starts={side: str(phase) for side, phase in world.initial_phases.items()},
        postures=postures,
        fast_time_constant=experiment.sensors.fast_time_constant,
    )
