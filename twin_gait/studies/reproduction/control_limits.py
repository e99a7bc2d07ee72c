"""Gain at which the compensated joint becomes unstable, against the ratio of true to modelled friction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twin_gait.checking.hanging_leg import friction_slope
from twin_gait.checking.linear_loop import LinearLoop, leg_motion, spectral_radius, transition_matrix
from twin_gait.core.estimation import first_order_gain
from twin_gait.scenario.bench_joint import BenchJoint
from twin_gait.simulation.bench_joint import TICK, BenchRun, simulate_bench
from twin_gait.studies.reproduction.control_bench import (
    EQUILIBRIUM,
    FRICTION_RATIO,
    MODEL,
    knee_test,
    torque_control,
    with_ideal_current,
)
from twin_gait.studies.reproduction.control_delay import PRINTED_DELAY
from twin_gait.studies.reproduction.control_impedance import STIFFNESS

RATIOS = (0.4, 0.5, 0.6, 0.8, 1.0)  # s
PUSH = 0.3  # [rad] / [s]; velocity that the joint without a spring is given
RELEASE = math.radians(45.0)  # from θ0, where the joint with a spring begins
STEPS = 8  # of a bisection
LOWEST, HIGHEST = 0.8, 1.3  # limits are looked for between these, times s
RESOLUTION = 0.5 * (HIGHEST - LOWEST) / 2**STEPS  # of a limit, times s
_ROUNDING = 1e-7  # by which a spectral radius of 1 may be missed


class Limit(NamedTuple):
    """Gains at which a joint becomes unstable.

    Attributes:
        ratio: s.
        free: Without a spring, in a simulated push.
        spring: With the thesis's spring, in a simulated release.
        linear: With that spring, by the eigenvalues of the loop at rest.
    """

    ratio: float
    free: float
    spring: float
    linear: float


def bisect(unstable: Callable[[float], bool], low: float, high: float, steps: int = STEPS) -> float:
    """Value at which something becomes true.

    Args:
        unstable: False below and true above.
        low: Where it is false.
        high: Where it is true.
        steps: Halvings.

    Returns:
        Middle of the last interval; near ``high`` if it never becomes true.
    """
    for _ in range(steps):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return 0.5 * (low + high)


def pushed(gain: float, ratio: float, *, window: int | None = None) -> BenchJoint:
    """The transparent knee, given a push and left alone.

    Args:
        gain: G.
        ratio: s.
        window: Samples that the slow velocity averages; the firmware's if None.

    Returns:
        The test.
    """
    test = knee_test(
        torque_control(gain),
        ratio=ratio,
        start_angle=math.radians(10.0),
        start_velocity=PUSH,
        duration=2.5,
    )
    return with_ideal_current(_with_window(test, window))


def released(gain: float, ratio: float, *, window: int | None = None) -> BenchJoint:
    """The knee on the thesis's spring, let go beside θ0.

    Args:
        gain: G.
        ratio: s.
        window: As above.

    Returns:
        The test: four swings.
    """
    test = knee_test(
        torque_control(gain, stiffness=STIFFNESS),
        ratio=ratio,
        start_angle=EQUILIBRIUM + RELEASE,
        duration=28.0,
    )
    return with_ideal_current(_with_window(test, window))


def _with_window(test: BenchJoint, window: int | None) -> BenchJoint:
    return test if window is None else replace(test, sensors=replace(test.sensors, window=window))


def runs_on(run: BenchRun) -> bool:
    """Whether a pushed joint becomes faster by itself.

    Args:
        run: A push; it may end at the stop.

    Returns:
        True if it is faster, while away from the stop, than when the filter had filled.
    """
    filled = 1.5 * TICK * run.test.sensors.window * run.test.sensors.decimation
    free = np.cumsum(np.abs(run.column("stop_torque_Nm"))) == 0.0
    velocity = np.abs(run.column("motor_velocity_rad_per_s"))[free]
    start = min(round(filled / TICK), len(velocity) - 1)
    return bool(velocity[-1] >= velocity[start])


def swing_grows(run: BenchRun) -> bool:
    """Whether a released joint swings at least as far at the end as before.

    Args:
        run: A release.

    Returns:
        True if it does, or hits a stop.
    """
    angle = run.column("motor_angle_rad")
    if run.column("stop_torque_Nm").any():
        return True
    half, quarter = len(angle) // 2, len(angle) // 4
    return bool(np.ptp(angle[half + quarter :]) >= np.ptp(angle[half : half + quarter]))


def linear_radius(gain: float, ratio: float, stiffness: float) -> float:
    """Largest eigenvalue of the knee's loop over a frame of the filter, linearised at rest.

    Args:
        gain: G.
        ratio: s.
        stiffness: k in [N m] / [rad].

    Returns:
        Below 1 if everything decays.
    """
    test = knee_test(torque_control(gain), ratio=ratio)
    slope = friction_slope(MODEL, 0.0)
    inertia = test.actuator.armature + test.link.total_inertia
    loop = LinearLoop(
        motion=leg_motion(np.array([[inertia]]), np.zeros((1, 1)), np.array([ratio * slope])),
        stiffness=np.array([stiffness]),
        damping=np.zeros(1),
        gain=np.array([gain]),
        modelled_friction=np.array([slope]),
        feed_forward=np.zeros((1, 1)),
        fast_gain=first_order_gain(TICK, test.sensors.fast_time_constant),
        decimation=test.sensors.decimation,
        window=test.sensors.window,
    )
    return spectral_radius(transition_matrix(loop))


def limits_of(ratio: float) -> Limit:
    """Find the gains at which the knee becomes unstable.

    Args:
        ratio: s.

    Returns:
        The gains.
    """
    low, high = LOWEST * ratio, HIGHEST * ratio
    return Limit(
        ratio=ratio,
        free=bisect(lambda gain: runs_on(simulate_bench(pushed(gain, ratio))), low, high),
        spring=bisect(lambda gain: swing_grows(simulate_bench(released(gain, ratio))), low, high),
        linear=bisect(
            lambda gain: linear_radius(gain, ratio, STIFFNESS) > 1.0 + _ROUNDING, low, high, steps=16
        ),
    )


def late_limits(ratio: float) -> tuple[float, float]:
    """The same gains for a filter that is as late as the thesis prints.

    Args:
        ratio: s.

    Returns:
        Without and with a spring.
    """
    window = late_window(ratio)
    low, high = LOWEST * ratio, 2.0 * ratio
    return (
        bisect(lambda gain: runs_on(simulate_bench(pushed(gain, ratio, window=window))), low, high),
        bisect(lambda gain: swing_grows(simulate_bench(released(gain, ratio, window=window))), low, high),
    )


def late_window(ratio: float = FRICTION_RATIO) -> int:
    """Samples of the moving average that would be late by ``PRINTED_DELAY``."""
    sensors = knee_test(torque_control(0.0), ratio=ratio).sensors
    return round(2.0 * PRINTED_DELAY / (sensors.decimation * TICK)) + 1


def growth(run: BenchRun) -> float:
    """Largest swing of a release over the distance that it began with.

    Args:
        run: A release.

    Returns:
        Ratio of the largest distance from θ0 to the first one.
    """
    distance = np.abs(run.column("motor_angle_rad") - EQUILIBRIUM)
    return float(distance.max() / distance[0])
