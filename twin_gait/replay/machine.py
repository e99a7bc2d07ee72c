"""The gait state machine over a recorded walk, of a log or of a run: what the controller would have decided.

The recorded angles pass through the velocity estimator of the firmware and the evaluator of the state
machine, tick by tick in the order of the engines: measure, then advance both legs on one snapshot. A walk
that lacks a signal which a guard reads is refused.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from twin_gait.configuration import load_experiment, load_gait_table
from twin_gait.core.belt import walk_command
from twin_gait.core.control_tick import measure_joint, new_encoder
from twin_gait.core.estimation import first_order_gain
from twin_gait.exceptions import GaitTableError, ParameterError
from twin_gait.experiment import Experiment, PlantParameters
from twin_gait.gait import TICK, GaitTable, compile_guards, signals
from twin_gait.gait.guards import PhaseMembership, atoms
from twin_gait.gait.machine import POSTURE, GaitStateMachine, PhaseSwitch
from twin_gait.gait.scaling import scale_table
from twin_gait.parameters import SensorParameters
from twin_gait.parameters.quantities import POSITIVE
from twin_gait.replay.recording import LogFormat, Recording, is_normative, normative_walk, read_recording
from twin_gait.runs.record import EXPERIMENT_FILE, LOG_FILE
from twin_gait.vocabulary import Side

OTHER_PHASE = f"{signals.OTHER}phase"
Signals = dict[str, np.ndarray]  # by name in SI, shape ``(n,)``
DEFAULT_TABLE = "treadmill"


@dataclass(frozen=True, eq=False)
class Replay:
    """A recorded walk with the phases that a table gives it."""

    table: GaitTable  # the gait table
    recording: Recording  # the walk
    # fast velocity estimate of each recorded joint of the table in [rad] / [s], shape ``(n,)``
    velocities: Mapping[tuple[Side, str], np.ndarray]
    phases: Mapping[Side, np.ndarray]  # index of the phase of each leg at each tick, shape ``(n,)``, integers
    switches: tuple[PhaseSwitch, ...]  # every change of phase with its cause
    # what guards read and nothing recorded, with what it stayed at in the unit of the table
    assumed: Mapping[str, float]


def replay(
    recording: Recording,
    table: GaitTable,
    *,
    body_weight: float | None = None,
    start_phases: Mapping[Side, str] | None = None,
    postures: Mapping[int, str] | None = None,
    fast_time_constant: float = SensorParameters.fast_time_constant,
) -> Replay:
    """Run the state machines of the recorded legs over a walk.

    ``body_weight`` of wearer and device in [N], only for guards on the load of the foot; ``start_phases``:
    phase of the table of each leg at tick 0, by default the recorded one, or else the first; ``postures``:
    phases into which operating modes sent both legs, by tick; ``fast_time_constant`` of the fast velocity
    estimate in [s], by default the firmware's. Raises GaitTableError if the guards need a signal that was not
    recorded.
    """
    own = {side: _own(recording, table, side, body_weight, fast_time_constant) for side in recording.sides}
    heard = {side: _heard(recording, own, side) for side in recording.sides}
    assumed = _assumed(recording, table, heard)
    program, total, sides = compile_guards(table), recording.n_ticks, recording.sides
    starts = {**{side: _start(recording, table, side) for side in sides}, **(start_phases or {})}
    machines = [GaitStateMachine(table, side, initial_phase=starts[side], program=program) for side in sides]
    read = [_columns(table, heard[side], total) for side in sides]
    time, other_time = table.signals.index(signals.TIME), table.signals.index(signals.OTHER_TIME)
    phase, switches = np.zeros((total, len(machines)), dtype=int), list[PhaseSwitch]()
    for tick in range(total):
        posture = (postures or {}).get(tick)
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
    velocities = {(side, joint): own[side][signals.VELOCITY.of(joint)] for side, joint in driven}
    phases = {side: phase[:, leg] for leg, side in enumerate(sides)}
    return Replay(table, recording, velocities, phases, tuple(switches), assumed)


def _own(
    recording: Recording, table: GaitTable, side: Side, body_weight: float | None, time_constant: float
) -> Signals:
    """Recorded signals of a leg: angles as its boards have them, fast estimates of velocities, the load."""
    sensors, found = SensorParameters(), Signals()
    gain = first_order_gain(TICK, time_constant)
    for joint in (joint for joint in table.joints if (side, joint) in recording.angles):
        encoder, measured = new_encoder(0.0, 0.0, sensors.window), np.zeros((2, recording.n_ticks))
        for tick, value in enumerate(recording.angles[side, joint].tolist()):
            measure_joint(encoder, tick, value, TICK, gain, sensors.decimation)
            measured[:, tick] = encoder.angle, encoder.velocity_fast
        found[signals.ANGLE.of(joint)], found[signals.VELOCITY.of(joint)] = measured
    if body_weight and side in recording.loads:
        found[signals.LOAD.name] = recording.loads[side] / body_weight
    return found


def _heard(recording: Recording, own: Mapping[Side, Signals], side: Side) -> Signals:
    """What is known to the guards of a leg, but for times in a phase."""
    others = {
        signals.OTHER + name: item for other in own if other is not side for name, item in own[other].items()
    }
    return {**recording.device, **own[side], **others}


def _columns(table: GaitTable, known: Signals, ticks: int) -> np.ndarray:
    """Signals in the order of the table, shape ``(ticks, n_signals)``; unknown ones as at first, or 0."""
    unknown = {name: np.full(ticks, np.nan_to_num(signals.signal_of(name).first)) for name in table.signals}
    return np.column_stack([known.get(name, unknown[name]) for name in table.signals])


def _start(recording: Recording, table: GaitTable, side: Side) -> str:
    recorded = str(recording.phases[side][0]) if side in recording.phases else ""
    return recorded if recorded in table.phases else table.phase_names[0]


def _read_by_guards(table: GaitTable) -> Iterator[tuple[str, str]]:
    """Signals that the guards of a table read, each with a transition that does."""
    for item in table.transitions:
        for atom in atoms(item.guard):
            names = (OTHER_PHASE,) if isinstance(atom, PhaseMembership) else atom.names
            yield from ((name, f"{item.source} → {item.target} ({item.cause})") for name in names)


def _assumed(recording: Recording, table: GaitTable, heard: Mapping[Side, Signals]) -> dict[str, float]:
    """What was told and is in no log, and what it is taken for; refuses a walk that lacks anything else."""
    counted = {signals.TIME} if len(heard) == 1 else {signals.TIME, signals.OTHER_TIME, OTHER_PHASE}
    assumed = {}
    for name, reader in _read_by_guards(table):
        for side in (side for side, known in heard.items() if name not in counted and name not in known):
            if name == OTHER_PHASE or name not in signals.DEVICE_NAMES or signals.signal_of(name).column:
                raise GaitTableError(
                    f"{recording.source}: the table {table.name} reads {name} in {reader}, not known of the "
                    f"{side} leg: name its column with --columns (of {signals.LOAD.name} add --total-mass "
                    f"KG; of {signals.OTHER}… name those of both legs), or take another table"
                )
            assumed[name] = signals.signal_of(name).first / signals.signal_of(name).unit.factor
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

    ``log``: run directory, log file, or a walk from the literature such as ``koopman@1.5``; ``table``:
    packaged table or file, by default that of a run, or ``treadmill``; ``log_format``: columns, units and
    signs of the log; ``speed`` of the belt in [m] / [s] that the table is scaled to, by default that of a
    run, or else the table is taken as it is written; ``mass`` of wearer and device in [kg], for guards on the
    load of the foot, by default that of a run. Raises TwinGaitError if log, table or options have a mistake,
    or do not fit each other.
    """
    for name, value in (("speed", speed), ("mass", mass)):
        if value is not None:
            POSITIVE.require(name, value)
    recording, experiment = _open(log, log_format or LogFormat())
    chosen = _table(table, speed, experiment)
    weight, starts = None if mass is None else mass * PlantParameters().gravity, dict[Side, str]()
    postures, time_constant = dict[int, str](), SensorParameters().fast_time_constant
    if experiment is not None:
        world, time_constant = experiment.build_world(), experiment.sensors.fast_time_constant
        told, postures = _told(experiment, chosen, recording)
        recording = replace(recording, device={**recording.device, **told})
        starts = {side: str(phase) for side, phase in world.initial_phases.items() if phase in chosen.phases}
        weight = weight or world.body_weight
    return replay(
        recording,
        chosen,
        body_weight=weight,
        start_phases=starts,
        postures=postures,
        fast_time_constant=time_constant,
    )


def _open(log: str, log_format: LogFormat) -> tuple[Recording, Experiment | None]:
    """The recording, and the experiment if it is of a run."""
    path = Path(log).expanduser()
    if is_normative(log):
        if log_format != LogFormat():
            raise ParameterError(f"{log}: has no columns to choose; leave columns, units, convention out")
        return normative_walk(log), None
    if not path.is_dir():
        return read_recording(path, log_format), None
    recording = read_recording(path / LOG_FILE, log_format)
    # What a run does not log of the device stayed as at first: nothing in it moved the signal.
    still = {signal.name: np.full(recording.n_ticks, signal.first) for signal in signals.DEVICE_SIGNALS}
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
        told = {
            signals.WALK.name: [mode.walk for mode in known],
            signals.STEP.name: [mode.step for mode in known],
        }
        commands = {name: np.array(values, dtype=float)[codes] for name, values in told.items()}
        return commands, {tick: posture for tick, posture in sent.items() if posture is not None}
    if walking is None or walking.belt.ramp == 0.0:
        return {}, {}
    start, stop = walking.belt.start, walking.belt.stop
    return {signals.WALK.name: np.array([walk_command(time, start, stop) for time in recording.time])}, {}


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
