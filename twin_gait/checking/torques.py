"""Rules on the torques of a phase: a jump at the switch, and stiffness that the limits do not allow."""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from twin_gait.checking.finding import CheckCase, Finding, Severity, rule, transition_finding
from twin_gait.checking.hanging_leg import HangingLeg, friction_torque, hanging_legs
from twin_gait.checking.postures import command_at_rest, exit_postures, first_rests
from twin_gait.checking.signals import signal_space
from twin_gait.core.blending import blend, blend_share
from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.core.impedance import impedance_torque, ratio_from_damping
from twin_gait.gait.table import TICK, Transition
from twin_gait.parameters.friction import FrictionLaw

# A step of a quarter of the torque limit within a millisecond is perceived as a knock (an assumption).
KNOCK = 0.25
_MOST_TICKS = 500


class Jump(NamedTuple):
    """Largest change of the commanded torque of one joint over the postures of a switch."""

    joint: str
    limit: float  # limit of the joint's torque in [N·m]
    whole: float  # change from the old phase to the new one, without blending, in [N·m]
    tick: float  # largest change in one tick with blending, at constant posture, in [N·m]
    at: dict[str, float]  # signals of the posture of the larger change, each relative to its bound

    @property
    def excess(self) -> float:
        """The larger of both changes, as a fraction of the accepted one."""
        return max(self.whole, self.tick / KNOCK) / self.limit


@lru_cache(maxsize=32)  # several transitions lead into a phase, by several ways
def _blend(leg: HangingLeg, phase: int) -> tuple[np.ndarray, list[float]]:
    """Return the ticks of the blend into a phase, from the tick before the switch, and its share in each."""
    table = leg.setup.table
    length = table.blend_ticks(table.phases_of(leg.side)[table.phase_names[phase]])
    # Long blends are sampled: their steps are small and change slowly.
    ticks = np.unique(np.linspace(0.0, length, min(length, _MOST_TICKS) + 1).round())
    law = table.blending.law.code
    shares = [blend_share(tick / length if length else 1.0, law) for tick in ticks.tolist()]
    return np.array([-1.0, *ticks]), [0.0, *shares]


def largest_jumps(leg: HangingLeg, transition: Transition, samples: np.ndarray) -> list[Jump]:
    """Compute the largest change of the commanded torque at a switch, for each joint.

    The command is the sum of impedance, gravity compensation and friction compensation. ``samples``: angles
    and velocities of :func:`exit_postures`.
    """
    table, laws = leg.setup.table, leg.setup.experiment.control.friction_model
    old, new = table.phase_index(transition.source), table.phase_index(transition.target)
    ticks, shares = _blend(leg, new)
    angles, velocities = samples[:, 0], samples[:, 1]
    held, inverse = np.unique(angles, axis=0, return_inverse=True)  # many samples have the same posture
    gravity = np.array([leg.modelled_gravity(posture) for posture in held])[inverse]
    speeds = zip(leg.joints, velocities.T, strict=True)
    friction = np.array([_friction(laws[name], row) for name, row in speeds]).T
    columns = [leg.column(which) for which in (STIFFNESS, DAMPING, EQUILIBRIUM, GAIN)]
    columns.append(leg.gravity_shares[:, None])
    # The laws are linear, so that they take arrays over ticks, samples and joints.
    share: Any = np.array(shares)[:, None, None]
    k, b, zero, gain, carried = (blend(column[old], column[new], share) for column in columns)
    impedance = np.asarray(impedance_torque(angles, velocities, k, b, zero))  # type: ignore[arg-type]
    commands = impedance + gain * friction + carried * gravity
    whole = np.abs(commands[-1] - commands[0])
    tick = np.abs(np.diff(commands, axis=0) / np.diff(ticks)[:, None, None]).max(axis=0)
    worst = np.argmax(np.maximum(whole, tick / KNOCK), axis=0)
    at = [leg.signals(*samples[sample]) for sample in worst]
    jumps = zip(leg.joints, leg.torque_limits(), whole.max(axis=0), tick.max(axis=0), at, strict=True)
    return [Jump(*jump) for jump in jumps]


def _friction(law: FrictionLaw, velocities: np.ndarray) -> np.ndarray:
    """Return the friction torques in [N·m] at velocities in [rad/s]; equal ones are computed once."""
    speeds, inverse = np.unique(velocities, return_inverse=True)
    return np.array([friction_torque(law, speed) for speed in speeds.tolist()])[inverse]


@rule
def torque_jump(case: CheckCase) -> Iterator[Finding]:
    """Find switches that change the commanded torque by more than the limit, or by too much in one tick.

    The change is taken over the postures of the guard that lie on the way through the phase that is left. The
    finding is a warning if the whole change, before blending, exceeds the torque limit, or if its largest
    step in a tick, after blending, exceeds a quarter of the limit. It is an error if a single step exceeds
    the limit.
    """
    space = signal_space(case)
    for leg in hanging_legs(case):
        for index, item in enumerate(space.table.transitions):
            jumps = [
                jump
                for rest in first_rests(space, leg, item.source)
                if len(samples := exit_postures(space, index, leg, rest))
                for jump in largest_jumps(leg, item, samples)
            ]
            worst = max(jumps, key=lambda jump: jump.excess, default=None)
            if worst is None or worst.excess <= 1.0:
                continue
            length = _blend(leg, space.table.phase_index(item.target))[0][-1]
            reason = (
                f"the commanded {worst.joint} torque changes by up to {worst.whole:.0f} N·m, with a blend of "
                f"{1e3 * TICK * length:g} ms by up to {worst.tick:.1f} N·m in a tick; the limit is "
                f"{worst.limit:.0f} N·m"
            )
            suggestion = "bring stiffness and equilibrium of the two phases closer, or use a longer blending"
            severity = Severity.ERROR if worst.tick > worst.limit else Severity.WARNING
            shown = {"side": leg.shown_side, "counterexample": worst.at}
            yield transition_finding(item, severity, reason, suggestion, **shown)


def release_speed(deflection: float, stiffness: float, damping: float, inertia: float) -> float:
    r"""Compute the largest speed of a damped spring and mass that are released at rest.

    The solution of :math:`\ddot x + 2 \zeta \omega_0 \dot x + \omega_0^2 x = 0` gives

    .. math::

        v = A\,\omega_0\,\exp\left(-\frac{\zeta}{\sqrt{1-\zeta^2}} \arccos \zeta\right), \qquad
        \omega_0 = \sqrt{k / I}

    and its continuation beyond :math:`\zeta = 1`.

    ``deflection``: A in [rad]. ``stiffness``: k in [N·m/rad]. ``damping``: b in [N·m·s/rad].
    ``inertia``: I in [kg·m²]. Returns the speed in [rad/s], 0 or more.
    """
    if stiffness == 0.0 or deflection == 0.0:
        return 0.0
    ratio = ratio_from_damping(damping, stiffness, inertia)
    if ratio < 1.0:
        exponent = ratio / math.sqrt(1.0 - ratio * ratio) * math.acos(ratio)
    elif ratio > 1.0:
        exponent = ratio / math.sqrt(ratio * ratio - 1.0) * math.acosh(ratio)
    else:
        exponent = 1.0
    return abs(deflection) * math.sqrt(stiffness / inertia) * math.exp(-exponent)


@rule
def stiffness_beyond_limits(case: CheckCase) -> Iterator[Finding]:
    """Find springs that exceed the torque or current limit, or the speed that the voltage allows.

    The rule is applied at the posture at which the phase is first entered on the way through the phase
    before, with the joints at rest.
    """
    space = signal_space(case)
    suggestion = "lower the stiffness, or enter the phase closer to its equilibrium"
    for leg in hanging_legs(case):
        for number, phase in enumerate(leg.phases):
            starts = [rest.start for rest in first_rests(space, leg, phase)]
            text = "; ".join(_not_served(leg, number, starts))
            if text:
                yield leg.finding(phase, Severity.WARNING, text, suggestion)


def _not_served(leg: HangingLeg, phase: int, starts: list[np.ndarray]) -> Iterator[str]:
    """Describe where the springs of a phase exceed the limits, at the worst of some postures in [rad]."""
    commands = np.array([command_at_rest(leg, phase, start) for start in starts])
    limits = leg.setup.experiment.control.limits
    for joint, (name, limit) in enumerate(zip(leg.joints, leg.torque_limits().tolist(), strict=True)):
        worst = int(np.argmax(np.abs(commands[:, joint])))
        if abs(commands[worst, joint]) > limit:
            yield (
                f"the spring of the {name} needs {commands[worst, joint]:.0f} N·m at the entry at "
                f"{math.degrees(starts[worst][joint]):.1f}°; the "
                f"{'torque' if limit == limits[name].torque else 'current'} limit gives {limit:.0f} N·m"
            )
        k, b, zero = (float(leg.column(which)[phase, joint]) for which in (STIFFNESS, DAMPING, EQUILIBRIUM))
        released = ((start[joint] - zero, leg.mass(start)[joint, joint]) for start in starts)
        speed = max(release_speed(deflection, k, b, inertia) for deflection, inertia in released)
        fastest = leg.no_load_speed(name)
        if speed > fastest:
            yield (
                f"the {name} would reach {math.degrees(speed):.0f} deg/s; the voltage allows "
                f"{math.degrees(fastest):.0f} deg/s without load"
            )


RULES = (torque_jump, stiffness_beyond_limits)
