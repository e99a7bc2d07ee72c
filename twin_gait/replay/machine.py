"""The gait state machine over a recorded walk: what the controller would have decided.

The recorded angles pass through the velocity estimator of the firmware and the evaluator of the state
machine, tick by tick in the order of the engines: measure, then advance both legs on one snapshot. A walk
that lacks a signal which a guard reads is refused.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from twin_gait.core.control_tick import measure_joint, new_encoder
from twin_gait.core.estimation import first_order_gain
from twin_gait.exceptions import GaitTableError
from twin_gait.gait import TICK, GaitTable, compile_guards
from twin_gait.gait.guards import PhaseMembership, atoms
from twin_gait.gait.machine import POSTURE, GaitStateMachine, PhaseSwitch
from twin_gait.gait.signals import ANGLE, LOAD, OTHER, OTHER_TIME, TIME, VELOCITY, is_device, signal_of
from twin_gait.parameters import SensorParameters
from twin_gait.replay.recording import Recording
from twin_gait.vocabulary import Side

PROGRESS_TICKS = 500
OTHER_PHASE = f"{OTHER}phase"
Signals = dict[str, np.ndarray]  # by name in SI, shape ``(n,)``
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Replay:
    """A recorded walk with the phases that a table gives it."""

    table: GaitTable  # the gait table
    recording: Recording  # the walk
    # fast velocity estimate of each recorded joint of the table in [rad] / [s], shape ``(n,)``
    velocities: Mapping[Side, Mapping[str, np.ndarray]]
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
    progress: Progress = lambda done, total: None,
) -> Replay:
    """Run the state machines of the recorded legs over a walk.

    ``body_weight`` of wearer and device in [N], only for guards on the load of the foot; ``start_phases``:
    phase of each leg at tick 0, by default the recorded one, or else the first of the table; ``postures``:
    phases into which operating modes sent both legs, by tick; ``fast_time_constant`` of the fast velocity
    estimate in [s], by default the firmware's; ``progress``: called with ticks done and ticks in all, now and
    then. Raises GaitTableError if the guards need a signal that was not recorded, or there is no such start
    phase.
    """
    own = {side: _own(recording, table, side, body_weight, fast_time_constant) for side in recording.sides}
    signals = {side: _heard(recording, own, side) for side in recording.sides}
    assumed = _assumed(recording, table, signals)
    program, total, sides = compile_guards(table), recording.n_ticks, recording.sides
    machines = [
        GaitStateMachine(
            table, side, initial_phase=_start(recording, table, side, start_phases or {}), program=program
        )
        for side in sides
    ]
    read = [_columns(table, signals[side], total) for side in sides]
    time, other_time = table.signals.index(TIME), table.signals.index(OTHER_TIME)
    phase, switches = np.zeros((total, len(machines)), dtype=int), list[PhaseSwitch]()
    for tick in range(total):
        if tick % PROGRESS_TICKS == 0:
            progress(tick, total)
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
    progress(total, total)
    velocities = {
        side: {joint: own[side][VELOCITY.of(joint)] for joint in table.joints if joint in joints}
        for side, joints in recording.angles.items()
    }
    phases = {side: phase[:, leg] for leg, side in enumerate(sides)}
    return Replay(table, recording, velocities, phases, tuple(switches), assumed)


def _own(
    recording: Recording, table: GaitTable, side: Side, body_weight: float | None, time_constant: float
) -> Signals:
    """Recorded signals of a leg: angles as its boards have them, fast estimates of velocities, the load."""
    sensors, found = SensorParameters(), Signals()
    gain = first_order_gain(TICK, time_constant)
    for joint in (joint for joint in table.joints if joint in recording.angles[side]):
        encoder, measured = new_encoder(0.0, 0.0, sensors.window), np.zeros((2, recording.n_ticks))
        for tick, value in enumerate(recording.angles[side][joint].tolist()):
            measure_joint(encoder, tick, value, TICK, gain, sensors.decimation)
            measured[:, tick] = encoder.angle, encoder.velocity_fast
        found[ANGLE.of(joint)], found[VELOCITY.of(joint)] = measured
    if body_weight and side in recording.loads:
        found[LOAD.name] = recording.loads[side] / body_weight
    return found


def _heard(recording: Recording, own: Mapping[Side, Signals], side: Side) -> Signals:
    """What is known to the guards of a leg, but for times in a phase."""
    others = {OTHER + name: item for other in own if other is not side for name, item in own[other].items()}
    return {**recording.device, **own[side], **others}


def _columns(table: GaitTable, known: Signals, ticks: int) -> np.ndarray:
    """Signals in the order of the table, shape ``(ticks, n_signals)``; unknown ones as at first, or 0."""
    unknown = {name: np.full(ticks, np.nan_to_num(signal_of(name).first)) for name in table.signals}
    return np.column_stack([known.get(name, unknown[name]) for name in table.signals])


def _start(recording: Recording, table: GaitTable, side: Side, start_phases: Mapping[Side, str]) -> str:
    asked = start_phases.get(side)
    if asked is not None and asked not in table.phases:
        known = ", ".join(table.phases)
        raise GaitTableError(
            f"start phase of the {side} leg: the table {table.name} has no {asked!r}; there are {known}"
        )
    recorded = str(recording.phases[side][0]) if side in recording.phases else ""
    return asked or (recorded if recorded in table.phases else table.phase_names[0])


def _read_by_guards(table: GaitTable) -> Iterator[tuple[str, str]]:
    """Signals that the guards of a table read, each with a transition that does."""
    for item in table.transitions:
        for atom in atoms(item.guard):
            names = (OTHER_PHASE,) if isinstance(atom, PhaseMembership) else atom.names
            yield from ((name, f"{item.source} → {item.target} ({item.cause})") for name in names)


def _assumed(recording: Recording, table: GaitTable, signals: Mapping[Side, Signals]) -> dict[str, float]:
    """What was told and is in no log, and what it is taken for; refuses a walk that lacks anything else."""
    counted = {TIME} if len(signals) == 1 else {TIME, OTHER_TIME, OTHER_PHASE}
    assumed = {}
    for name, reader in _read_by_guards(table):
        for side in (side for side, known in signals.items() if name not in counted and name not in known):
            if name == OTHER_PHASE or not is_device(name) or signal_of(name).column:
                raise GaitTableError(
                    f"{recording.source}: the table {table.name} reads {name} in {reader}, not known of the "
                    f"{side} leg: name its column with --columns (of {LOAD.name} add --total-mass KG; of "
                    f"{OTHER}… name those of both legs), or take another table"
                )
            assumed[name] = signal_of(name).first / signal_of(name).unit.factor
    return assumed
