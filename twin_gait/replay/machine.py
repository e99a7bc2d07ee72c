"""The gait state machine over a recorded walk: what the controller would have decided.

The recorded angles pass through the velocity estimator of the firmware and the evaluator of the state
machine, tick by tick in the order of the engines: measure, then advance both legs on one snapshot. A walk
that lacks a signal which a guard reads is refused.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from twin_gait.core.control_tick import measure_joint, new_encoder
from twin_gait.core.estimation import first_order_gain
from twin_gait.core.guards import OP_COMPARE, OP_PHASE
from twin_gait.exceptions import GaitTableError
from twin_gait.gait import TICK, GaitTable, compile_guards
from twin_gait.gait import signals as declared
from twin_gait.gait.machine import POSTURE, GaitStateMachine, PhaseSwitch
from twin_gait.gait.signals import ANGLE, LOAD, OTHER, OTHER_TIME, TIME, TIME_IN_PHASE, VELOCITY, signal_of
from twin_gait.parameters import SensorParameters
from twin_gait.replay.recording import Recording
from twin_gait.vocabulary import Side

PROGRESS_TICKS = 500


@dataclass(frozen=True, eq=False)
class Replay:
    """A recorded walk with the phases that a table gives it."""

    table: GaitTable  # the gait table
    recording: Recording  # the walk
    # fast velocity estimate of each joint of the table in [rad] / [s], shape ``(n,)``
    velocities: Mapping[Side, Mapping[str, np.ndarray]]
    phases: Mapping[Side, np.ndarray]  # index of the phase of each leg at each tick, shape ``(n,)``, integers
    switches: tuple[PhaseSwitch, ...]  # every change of phase with its cause


def replay(
    recording: Recording,
    table: GaitTable,
    *,
    body_weight: float | None = None,
    start_phases: Mapping[Side, str] | None = None,
    postures: Mapping[int, str] | None = None,
    fast_time_constant: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Replay:
    """Run the state machines of the recorded legs over a walk.

    ``body_weight`` of wearer and device in [N], only for guards on the load of the foot; ``start_phases``:
    phase of each leg at tick 0, by default the recorded one, or else the first of the table; ``postures``:
    phases into which operating modes sent both legs, by tick; ``fast_time_constant`` of the fast velocity
    estimate in [s], by default the firmware's; ``progress``: called with ticks done and ticks in all, now and
    then. Raises GaitTableError if the guards need a signal that was not recorded, or there is no such start
    phase.
    """
    _check_signals(recording, table, body_weight)
    program, total, sides = compile_guards(table), recording.n_ticks, recording.sides
    nothing, own = np.zeros(total), dict[Side, dict[str, np.ndarray]]()
    for side, joints in recording.angles.items():
        own[side] = {LOAD.name: recording.loads.get(side, nothing) / (body_weight or math.inf)}
        for name in table.joints:
            measured = _measured(joints.get(name, nothing), fast_time_constant)
            own[side][ANGLE.of(name)], own[side][VELOCITY.of(name)] = measured
    time, other_time = table.signals.index(TIME), table.signals.index(OTHER_TIME)
    starts = {side: _start(recording, table, side, start_phases or {}) for side in sides}
    machines = [
        GaitStateMachine(table, side, initial_phase=start, program=program) for side, start in starts.items()
    ]
    read = [_read(recording, table, own, side) for side in sides]
    phase, switches = np.zeros((total, len(machines)), dtype=int), list[PhaseSwitch]()
    for tick in range(total):
        if progress is not None and tick % PROGRESS_TICKS == 0:
            progress(tick, total)
        posture = (postures or {}).get(tick)
        for machine in machines:
            if posture is not None and machine.phase != posture:
                switches.append(PhaseSwitch(tick, machine.side, machine.phase, posture, POSTURE, -1))
                machine.enter(posture, tick)
        times = [machine.time_in_phase(tick) for machine in machines]
        before = [machine.phase_index for machine in machines]
        for leg, machine in enumerate(machines):
            others, signals = len(machines) - 1 - leg, read[leg][tick].tolist()
            signals[time] = times[leg]
            if others != leg:
                signals[other_time] = times[others]
            switch = machine.advance(tick, signals, -1 if others == leg else before[others])
            if switch is not None:
                switches.append(switch)
        phase[tick] = [machine.phase_index for machine in machines]
    if progress is not None:
        progress(total, total)
    estimated = {side: {name: own[side][VELOCITY.of(name)] for name in table.joints} for side in sides}
    phases = {side: phase[:, leg] for leg, side in enumerate(sides)}
    return Replay(table, recording, estimated, phases, tuple(switches))


def _read(
    recording: Recording, table: GaitTable, own: Mapping[Side, Mapping[str, np.ndarray]], side: Side
) -> np.ndarray:
    """What the guards of a leg read, without times in a phase; shape ``(n, n_signals)``, in SI.

    As at first where it was not recorded: who walks was told to.
    """
    known = {**recording.device, **own[side]}
    for other in (other for other in own if other is not side):
        known |= {OTHER + name: values for name, values in own[other].items()}
    unknown = {name: np.full(recording.n_ticks, signal_of(name).first) for name in table.signals}
    return np.column_stack([known.get(name, unknown[name]) for name in table.signals])


def _measured(angle: np.ndarray, time_constant: float | None) -> np.ndarray:
    """Angle of a joint as its board has it, 0 if no guard reads it, and the fast estimate of its velocity."""
    sensors = SensorParameters()
    gain = first_order_gain(TICK, sensors.fast_time_constant if time_constant is None else time_constant)
    encoder, found = new_encoder(0.0, 0.0, sensors.window), np.zeros((2, len(angle)))
    for tick, value in enumerate(angle.tolist()):
        measure_joint(encoder, tick, value, TICK, gain, sensors.decimation)
        found[:, tick] = encoder.angle, encoder.velocity_fast
    return found


def _start(recording: Recording, table: GaitTable, side: Side, start_phases: Mapping[Side, str]) -> str:
    asked = start_phases.get(side)
    if asked is not None and asked not in table.phases:
        known = ", ".join(table.phases)
        raise GaitTableError(
            f"start phase of the {side} leg: the table {table.name} has no {asked!r}; there are {known}"
        )
    recorded = str(recording.phases[side][0]) if side in recording.phases else ""
    return asked or (recorded if recorded in table.phases else table.phase_names[0])


OTHER_PHASE = f"{OTHER}phase"


def needed_signals(table: GaitTable) -> dict[str, list[str]]:
    """Signals that the guards of a table read, and which transitions read them; off the compiled guards."""
    program, names = compile_guards(table), declared.all_signal_names(table.joints)
    needed: dict[str, dict[str, None]] = {}
    for item, rule in zip(table.transitions, program.transitions, strict=True):
        label = f"{item.source} → {item.target} ({item.cause})"
        for node in program.nodes[rule.first_node : rule.end_node]:
            found = [OTHER_PHASE] if node.operation == OP_PHASE else []
            if node.operation == OP_COMPARE:
                comparison = program.comparisons[node.operand]
                found = [names[comparison.signal_a]]
                found += [names[comparison.signal_b]] if comparison.factor_b != 0.0 else []
            for signal in found:
                needed.setdefault(signal, {})[label] = None
    return {signal: list(readers) for signal, readers in needed.items()}


_HEARD = (ANGLE, VELOCITY, LOAD, TIME_IN_PHASE)  # without which no log is replayed


def assumed_signals(recording: Recording, table: GaitTable) -> dict[str, float]:
    """Signals that guards read and nothing recorded, with what they stay at in the unit of the table."""
    needed = {name: signal_of(name) for name in needed_signals(table) if name != OTHER_PHASE}
    return {
        name: signal.first / signal.unit.factor
        for name, signal in needed.items()
        if signal not in _HEARD and name not in recording.device
    }


def _check_signals(recording: Recording, table: GaitTable, body_weight: float | None) -> None:
    """Refuse a walk that lacks a signal which a guard reads."""
    for signal, readers in needed_signals(table).items():
        problem = _lacking(recording, signal, body_weight)
        if problem:
            reads = f"the table {table.name} reads {signal} in {'; '.join(readers)}"
            raise GaitTableError(f"{recording.source}: {reads}, but {problem}")


def _lacking(recording: Recording, signal: str, body_weight: float | None) -> str:
    """Why a signal cannot be had; empty if it can."""
    if signal.startswith(OTHER) and len(recording.sides) < 2:
        return "the log has one leg: add --mirror to make the other one of it, or take another table"
    if signal == OTHER_PHASE:
        return ""
    said = signal_of(signal)
    if said is LOAD:
        lacking = [side for side in recording.sides if side not in recording.loads]
        if lacking:
            return f"the log has no {lacking[0]}_foot_normal_force_N: name it in --columns"
        return "" if body_weight else "the weight is not known: add --total-mass KG"
    if said.column and signal not in recording.device:
        return f"the log has no {said.column}: name it in --columns"
    joint = declared.part_of(signal.removeprefix(OTHER)) if said.scope is declared.Scope.JOINT else ""
    for side, joints in recording.angles.items():
        if joint and joint not in joints:
            return f"the log has no angle of the {side} {joint}: name its column in --columns"
    return ""
