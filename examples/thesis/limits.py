"""Gain at which the compensated knee becomes unstable, against the ratio of true to modelled friction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from thesis.bench import (
    EQUILIBRIUM,
    MODEL,
    PRINTED_DELAY,
    RATIO,
    STIFFNESS,
    knee_test,
    torque_control,
    with_ideal_current,
)

from twin_gait.checking.hanging_leg import friction_slope
from twin_gait.checking.linear_loop import LinearLoop, leg_motion, spectral_radius, transition_matrix
from twin_gait.core.estimation import first_order_gain
from twin_gait.gait.table import TICK
from twin_gait.simulation.bench_joint.loop import BenchRun, simulate_bench
from twin_gait.worlds.bench_joint import BenchJoint

RATIOS = (0.4, 0.5, 0.6, 0.8, 1.0)  # s
PUSH = 0.3  # [rad/s]; velocity that the joint without a spring is given
RELEASE = math.radians(45.0)  # from θ0, where the joint with a spring begins
STEPS = 8  # of a bisection
LOWEST, HIGHEST = 0.8, 1.3  # limits are looked for between these, times s
RESOLUTION = 0.5 * (HIGHEST - LOWEST) / 2**STEPS  # of a limit, times s
ROUNDING = 1e-7  # by which a spectral radius of 1 may be missed


def bisect(unstable: Callable[[float], bool], low: float, high: float, steps: int = STEPS) -> float:
    """Return the value at which a condition that is false at ``low`` becomes true; near ``high`` if never."""
    for _ in range(steps):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return 0.5 * (low + high)


# ---------------------------------------------------------------------- the knee


class Limit(NamedTuple):
    """Gains at which a knee with s becomes unstable.

    ``free`` without a spring in a simulated push, ``spring`` with the thesis's in a simulated release,
    ``linear`` with that spring by the eigenvalues of the loop at rest.
    """

    ratio: float
    free: float
    spring: float
    linear: float


def pushed(gain: float, ratio: float, window: int | None = None) -> BenchJoint:
    """Return a test of the pushed transparent knee; ``window``: another window of the slow velocity."""
    start, control = math.radians(10.0), torque_control(gain)
    test = knee_test(control, ratio=ratio, start_angle=start, start_velocity=PUSH, duration=2.5)
    return with_ideal_current(_with_window(test, window))


def released(gain: float, ratio: float, window: int | None = None) -> BenchJoint:
    """Return a test of the knee on the thesis's spring, released for four swings; ``window`` likewise."""
    control = torque_control(gain, stiffness=STIFFNESS)
    test = knee_test(control, ratio=ratio, start_angle=EQUILIBRIUM + RELEASE, duration=28.0)
    return with_ideal_current(_with_window(test, window))


def _with_window(test: BenchJoint, window: int | None) -> BenchJoint:
    return test if window is None else replace(test, sensors=replace(test.sensors, window=window))


def runs_on(run: BenchRun) -> bool:
    """Return whether a pushed joint off the stop is faster at the end than when the filter has filled."""
    filled = 1.5 * TICK * run.test.sensors.window * run.test.sensors.decimation
    free = np.cumsum(np.abs(run.column("stop_torque_Nm"))) == 0.0
    velocity = np.abs(run.column("motor_velocity_rad_per_s"))[free]
    return bool(velocity[-1] >= velocity[min(round(filled / TICK), len(velocity) - 1)])


def keeps_swinging(run: BenchRun) -> bool:
    """Return whether a released joint swings at least as far at the end as before, or hits a stop."""
    angle = run.column("motor_angle_rad")
    half, quarter = len(angle) // 2, len(angle) // 4
    return bool(
        run.column("stop_torque_Nm").any()
        or np.ptp(angle[half + quarter :]) >= np.ptp(angle[half : half + quarter])
    )


def linear_radius(gain: float, ratio: float, stiffness: float) -> float:
    """Return the spectral radius of the loop of the knee over a frame, linearised at rest; k in [N·m/rad]."""
    test, slope = knee_test(torque_control(gain), ratio=ratio), friction_slope(MODEL, 0.0)
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


def simulated_limits(
    ratio: float, highest: float = HIGHEST, window: int | None = None
) -> tuple[float, float]:
    """Return the gains at which the knee becomes unstable without and with a spring, by bisection."""
    low, high = LOWEST * ratio, highest * ratio
    return (
        bisect(lambda gain: runs_on(simulate_bench(pushed(gain, ratio, window))), low, high),
        bisect(lambda gain: keeps_swinging(simulate_bench(released(gain, ratio, window))), low, high),
    )


def limits_of(ratio: float) -> Limit:
    """Return the limits by simulation, and the limit of the linear loop."""

    def unstable(gain: float) -> bool:
        return linear_radius(gain, ratio, STIFFNESS) > 1.0 + ROUNDING

    linear = bisect(unstable, LOWEST * ratio, HIGHEST * ratio, steps=16)
    return Limit(ratio, *simulated_limits(ratio), linear)


def growth(run: BenchRun) -> float:
    """Return the largest distance from θ0 in a release over the first one."""
    distance = np.abs(run.column("motor_angle_rad") - EQUILIBRIUM)
    return float(distance.max() / distance[0])


def limit_numbers(limits: list[Limit], fully_compensated: BenchRun) -> dict[str, float]:
    """Return the limits over s that are farthest from 1, and the limits with the printed filter delay."""
    sensors = fully_compensated.test.sensors
    window = round(2.0 * PRINTED_DELAY / (sensors.decimation * TICK)) + 1
    late_free, late_spring = simulated_limits(RATIO, highest=2.0, window=window)
    at_ratio = next(limit for limit in limits if limit.ratio == RATIO)
    shares = {name: [getattr(limit, name) / limit.ratio for limit in limits] for name in ("free", "spring")}
    return {
        **{f"{name}_share": max(of, key=lambda share: abs(share - 1.0)) for name, of in shares.items()},
        "share_low": 1.0 - RESOLUTION,
        "growth": growth(fully_compensated),
        "free": at_ratio.free,
        "spring": at_ratio.spring,
        "late_free": late_free,
        "late_spring": late_spring,
    }
