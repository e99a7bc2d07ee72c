"""What a phase asks of the motors: a jump at the switch, and stiffness that the limits cannot serve."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from twin_gait.checking.finding import CheckCase, Finding, Severity, about, rule
from twin_gait.checking.hanging_leg import HangingLeg, friction_torque, hanging_legs
from twin_gait.checking.postures import Postures, command_at_rest, first_rests, postures
from twin_gait.checking.signals import signal_space
from twin_gait.core.blending import blend, blend_share
from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.core.impedance import damping_ratio_of, impedance_torque
from twin_gait.gait.signals import ANGLE, VELOCITY
from twin_gait.gait.table import TICK, Transition

# A step of a quarter of the limit within a millisecond is felt as a knock (an assumption).
KNOCK = 0.25
_MOST_TICKS = 500


class Jump(NamedTuple):
    """Largest change of the commanded torque of one joint over the postures of a switch."""

    joint: int  # position of the joint
    whole: float  # change from the old phase to the new one, without blending, in [N m]
    tick: float  # largest change in one tick with blending, the posture held, in [N m]
    # posture of the larger of the two, measured against its bound, in [rad], shape ``(n_joints,)``
    angles: np.ndarray
    velocities: np.ndarray  # its velocities in [rad] / [s], shape ``(n_joints,)``


def _length(leg: HangingLeg, phase: int) -> int:
    table = leg.problem.table
    return table.blend_ticks(table.phases_of(leg.side)[table.phase_names[phase]])


def _blend(leg: HangingLeg, phase: int) -> tuple[np.ndarray, np.ndarray]:
    """Ticks of the blend into a phase, from the one before the switch on, and its share in each."""
    length = _length(leg, phase)
    # Long blends are sampled: their steps are small and change slowly.
    ticks = np.unique(np.linspace(0.0, length, min(length, _MOST_TICKS) + 1).round())
    shares = [
        blend_share(tick / length if length else 1.0, leg.problem.table.blending.law.code)
        for tick in ticks.tolist()
    ]
    return np.array([-1.0, *ticks]), np.array([0.0, *shares])


def _commands(leg: HangingLeg, old: int, new: int, joint: int, samples: Postures) -> np.ndarray:
    """Commanded torque of a joint through a blend, postures held, in [N m], ``(n_samples, n_ticks)``."""
    law = leg.problem.experiment.control.friction_model[leg.joints[joint]]
    gravity = np.array([leg.modelled_gravity(posture)[joint] for posture in samples.angles])
    angles, velocities = samples.angles[:, joint], samples.velocities[:, joint]
    friction = np.array([friction_torque(law, velocity) for velocity in velocities.tolist()])
    columns = [leg.column(which)[:, joint] for which in (STIFFNESS, DAMPING, EQUILIBRIUM, GAIN)]
    commands = []
    for share in _blend(leg, new)[1].tolist():
        k, b, zero, gain = (blend(column[old], column[new], share) for column in columns)
        carried = blend(leg.gravity_shares[old], leg.gravity_shares[new], share)
        # The law is linear: arrays of postures pass as numbers do.
        impedance = np.asarray(impedance_torque(angles, velocities, k, b, zero))  # type: ignore[arg-type]
        commands.append(impedance + gain * friction + carried * gravity)
    return np.array(commands).T


def largest_jumps(leg: HangingLeg, transition: Transition, samples: Postures) -> list[Jump]:
    """Largest change of the commanded torque (impedance, gravity and friction compensation), per joint."""
    table = leg.problem.table
    old, new = table.phase_index(transition.source), table.phase_index(transition.target)
    jumps = []
    for joint, limit in enumerate(leg.torque_limits().tolist()):
        commands = _commands(leg, old, new, joint, samples)
        whole = np.abs(commands[:, -1] - commands[:, 0])
        tick = np.abs(np.diff(commands, axis=1) / np.diff(_blend(leg, new)[0])).max(axis=1)
        worst = int(np.argmax(np.maximum(whole / limit, tick / (KNOCK * limit))))
        angles, velocities = samples.angles[worst], samples.velocities[worst]
        jumps.append(Jump(joint, float(whole.max()), float(tick.max()), angles, velocities))
    return jumps


@rule
def torque_jump(case: CheckCase) -> Iterator[Finding]:
    """A switch changes the commanded torque by more than the limit, or too much of it in one tick.

    Over the postures of the guard that lie on the way through the phase that is left. A warning if the whole
    change, before blending, exceeds the torque limit, or its largest step in a tick, after blending, a
    quarter of the limit; an error if a single step exceeds the limit.
    """
    space = signal_space(case)
    for leg in hanging_legs(case):
        for index, item in enumerate(space.table.transitions):
            jumps = [
                jump
                for rest in first_rests(space, leg, item.source)
                if (samples := postures(space, index, leg, rest)) is not None
                for jump in largest_jumps(leg, item, samples)
            ]
            yield from _too_large(leg, item, jumps)


def _too_large(leg: HangingLeg, item: Transition, jumps: list[Jump]) -> Iterator[Finding]:
    limits = leg.torque_limits()
    worst = max(jumps, key=lambda jump: max(jump.whole, jump.tick / KNOCK) / limits[jump.joint], default=None)
    if worst is None:
        return
    limit = float(limits[worst.joint])
    if worst.whole <= limit and worst.tick <= KNOCK * limit:
        return
    length = _length(leg, leg.problem.table.phase_index(item.target))
    reason = (
        f"the commanded {leg.joints[worst.joint]} torque changes by up to {worst.whole:.0f} Nm, with a blend "
        f"of {1e3 * TICK * length:g} ms by up to {worst.tick:.1f} Nm in a tick; the limit is {limit:.0f} Nm"
    )
    suggestion = "bring stiffness and equilibrium of the two phases closer, or blend for longer"
    severity = Severity.ERROR if worst.tick > limit else Severity.WARNING
    found: dict[str, float] = {}
    for joint, angle, velocity in zip(leg.joints, worst.angles, worst.velocities, strict=True):
        found[ANGLE.of(joint)] = round(math.degrees(angle), 2)
        found[VELOCITY.of(joint)] = round(math.degrees(velocity), 1)
    yield about(item, severity, reason, suggestion, side=leg.shown_side, counterexample=found)


def release_speed(deflection: float, stiffness: float, damping: float, inertia: float) -> float:
    r"""Largest speed of a damped spring and mass that are let go at rest.

    From :math:`\ddot x + 2 \zeta \omega_0 \dot x + \omega_0^2 x = 0`:

    .. math::

        v = A\,\omega_0\,\exp\left(-\frac{\zeta}{\sqrt{1-\zeta^2}} \arccos \zeta\right), \qquad
        \omega_0 = \sqrt{k / I}

    and its continuation beyond :math:`\zeta = 1`.

    A in [rad], k in [N m] / [rad], b in [N m s] / [rad], I in [kg m²]; the speed in [rad] / [s], 0 or more.
    """
    if stiffness == 0.0 or deflection == 0.0:
        return 0.0
    ratio = damping_ratio_of(damping, stiffness, inertia)
    if ratio < 1.0:
        exponent = ratio / math.sqrt(1.0 - ratio * ratio) * math.acos(ratio)
    elif ratio > 1.0:
        exponent = ratio / math.sqrt(ratio * ratio - 1.0) * math.acosh(ratio)
    else:
        exponent = 1.0
    return abs(deflection) * math.sqrt(stiffness / inertia) * math.exp(-exponent)


@rule
def stiffness_not_served(case: CheckCase) -> Iterator[Finding]:
    """A spring asks for more than the torque or current limit gives, or faster than the voltage allows.

    Looked at where the phase is first entered on the way through the one before, with the joints at rest.
    """
    space = signal_space(case)
    suggestion = "lower the stiffness, or begin the phase closer to its equilibrium"
    for leg in hanging_legs(case):
        for number, phase in enumerate(leg.phases):
            starts = [rest.start for rest in first_rests(space, leg, phase)]
            reasons = [
                reason
                for joint in range(len(leg.joints))
                for look in (_too_much_torque, _too_fast)
                if (reason := look(leg, number, joint, starts))
            ]
            if reasons:
                text = "; ".join(reasons)
                yield Finding(Severity.WARNING, text, suggestion, phase=phase, side=leg.shown_side)


def _too_much_torque(leg: HangingLeg, phase: int, joint: int, starts: list[np.ndarray]) -> str:
    """What a spring asks for at the worst of some postures of entry in [rad], if that is too much."""
    asked = [(float(command_at_rest(leg, phase, start)[joint]), float(start[joint])) for start in starts]
    torque, angle = max(asked, key=lambda pair: abs(pair[0]))
    name = leg.joints[joint]
    torque_limit = leg.problem.experiment.control.limits.torque
    current_limit = leg.current_limited_torque(name)
    limit = min(torque_limit, current_limit)
    if abs(torque) <= limit:
        return ""
    named = "torque limit" if torque_limit <= current_limit else "current limit"
    stiffness = math.radians(leg.column(STIFFNESS)[phase, joint])
    serves = f", {limit / stiffness:.0f}° of its {stiffness:.3g} Nm/deg" if stiffness > 0.0 else ""
    return (
        f"the {name} asks for {torque:.0f} Nm where it enters at {math.degrees(angle):.1f}°; the {named} "
        f"gives {limit:.0f} Nm{serves}"
    )


def _too_fast(leg: HangingLeg, phase: int, joint: int, starts: list[np.ndarray]) -> str:
    """The speed that a spring would reach from the worst of some postures, if that is too fast."""
    k, b, zero = (float(leg.column(which)[phase, joint]) for which in (STIFFNESS, DAMPING, EQUILIBRIUM))
    speed = max(release_speed(start[joint] - zero, k, b, leg.mass(start)[joint, joint]) for start in starts)
    fastest = leg.no_load_speed(leg.joints[joint])
    if speed <= fastest:
        return ""
    return (
        f"the {leg.joints[joint]} would reach {math.degrees(speed):.0f} deg/s; the voltage allows "
        f"{math.degrees(fastest):.0f} deg/s without load"
    )


RULES = (torque_jump, stiffness_not_served)
