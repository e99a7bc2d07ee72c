"""How much of the joint's inertia can be compensated, by a differentiated encoder or an inertial unit?

Three parts: what becomes of a joint that a hand holds still, over source, delay and share, for a rigid and
a compliant gear; the largest stable shares by eigenvalues alone; and the noise of the torque beside the
inertia that a hand still feels. The joint is in :mod:`twin_gait.studies.whatif.inertia_joint`, the linear
witness in :mod:`twin_gait.studies.whatif.inertia_map`.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from twin_gait.checking.stability import largest_stable
from twin_gait.gait.table import TICK
from twin_gait.measures.effort import root_mean_square
from twin_gait.scenario.bench_leg import HandParameters
from twin_gait.simulation.bench_joint import BenchRun, simulate_bench
from twin_gait.studies.whatif.friction_joint import DEGREE, THESIS_RATIO
from twin_gait.studies.whatif.inertia_joint import Setting, bench_of, linear_bench, loop_of, sample_deviation
from twin_gait.studies.whatif.inertia_map import Source, felt_inertia, growth, mean_delay, torque_noise
from twin_gait.studies.whatif.rig import HAND_AMPLITUDE, HAND_FREQUENCY, JOINT, LEVEL, MODEL, inertia, outcome
from twin_gait.studies.whatif.work import Job, Means, Row, tables_of

SHARES = tuple(round(0.1 * step, 1) for step in range(1, 12))
# The encoder's delay is that of its filters; that of a unit lies between sample and use.
TIME_CONSTANTS = (0.001, 0.002, 0.005, 0.010, 0.020)  # [s]; 5 ms is the firmware's
DELAYS = (0, 2, 5, 10, 20)  # [ticks]
BUS_DELAY = 2  # [ticks], a bus of 500 Hz
THESIS_GAIN = 0.35  # G, the thesis's best
START_SPEED = 0.5  # [rad] / [s] of the joint that the hand catches
DURATION, SPAN = 12.0, 3.0  # [s]
UNDECIDED = 0.1  # [1] / [s]; slower growth or decay than this is not judged in a linear run
NOISE_SHARES = (0.25, 0.5, 0.75)
NOISE_FACTORS = (1.0, 10.0)  # on the noise of a common unit, and on the angle of an encoder count
FELT_FREQUENCY, FELT_AMPLITUDE = 1.0, 0.2  # [Hz], [rad]
_TINY = 1e-6  # [rad] / [s], start of a linear run
_LARGE = 1e-5  # [rad]; a linear motion that has come to this has grown, and may not be linear any more
_EARLY = (2.0, 3.0)  # [s]
_ROUNDING = 1e-13  # [rad]
_LARGEST_SHARE = 1.5


# ---------------------------------------------------------------------- who grows


def stability_row(setting: Setting) -> Row:
    """Predict whether a small motion grows, run it, and run the joint with its friction.

    Args:
        setting: The setting; its sensor is taken as ideal.

    Returns:
        A row.
    """
    ideal, law = setting._replace(noise=0.0), MODEL.scaled(THESIS_RATIO)
    true = bench_of(ideal, law, friction_compensation_gain=THESIS_GAIN)
    run = simulate_bench(replace(true, start_velocity=START_SPEED, duration=DURATION))
    ending, amplitude = outcome(run, SPAN)
    torque = run.column("motor_torque_Nm")[-round(SPAN / TICK) :]
    return {
        **_where(setting),
        "share": setting.share,
        "growth_per_s": round(growth(loop_of(setting)), 4),
        "linear_run_grows": linear_run_grows(setting),
        "ending": str(ending),
        "amplitude_deg": round(amplitude / DEGREE, 4),
        "torque_amplitude_Nm": round(0.5 * float(np.ptp(torque)), 3),
    }


def _where(setting: Setting) -> Row:
    return {
        "source": str(setting.source),
        "filter_ms": 1e3 * setting.time_constant,
        "bus_delay_ms": 1e3 * TICK * setting.delay,
        "mean_delay_ms": round(1e3 * mean_delay(loop_of(setting)), 3),
        "gear": "compliant" if setting.compliant else "rigid",
        "held": setting.held,
    }


def linear_run_grows(setting: Setting) -> bool:
    """Whether a small motion of the linear joint grows in the simulation.

    Args:
        setting: The setting; its sensor is taken as ideal.

    Returns:
        True if it becomes large, or is larger at the end than early on.
    """
    bench = linear_bench(setting._replace(noise=0.0), target_torque=0.0)
    test = replace(bench, gravity=0.0, start_velocity=_TINY, duration=DURATION)
    angle = simulate_bench(test).column("motor_angle_rad") - LEVEL
    first, last = (round(time / TICK) for time in _EARLY)
    early, late = (float(np.ptp(part)) for part in (angle[first:last], angle[first - last :]))
    return bool(np.abs(angle).max() > _LARGE) or late > max(early, _ROUNDING)


def largest_share(setting: Setting) -> float:
    """Largest stable share by the eigenvalues of the tick map.

    Args:
        setting: The setting; its share is put in.

    Returns:
        The share, at most ``1.5``.
    """
    loop = loop_of(setting)

    def radius(share: float) -> float:
        return math.exp(growth(replace(loop, share=share)) * TICK)

    found = largest_stable(radius, 0.0, _LARGEST_SHARE)
    return math.nan if found is None else found


def limit_row(setting: Setting) -> Row:
    """The largest stable share.

    Args:
        setting: Without a share.

    Returns:
        A row.
    """
    return {**_where(setting), "largest_share": round(largest_share(setting), 4)}


# ---------------------------------------------------------------------- noise and use


def noise_row(setting: Setting) -> Row:
    """Noise of the torque, and the inertia that a hand still feels: linear run beside closed form.

    Args:
        setting: With a rigid gear, held.

    Returns:
        A row.
    """
    loop = loop_of(setting)
    return {
        **_where(setting),
        "share": setting.share,
        "noise_factor": setting.noise,
        "torque_noise_Nm": round(_seen_noise(setting), 5),
        "linear_torque_noise_Nm": round(torque_noise(loop, sample_deviation(setting)), 5),
        "felt_inertia_share": round(_seen_inertia(setting), 4),
        "closed_felt_inertia_share": round(felt_inertia(loop, FELT_FREQUENCY), 4),
    }


def _led(setting: Setting, amplitude: float, frequency: float, cycles: float) -> BenchRun:
    hand = HandParameters(joint=JOINT, amplitude=amplitude, frequency=frequency)
    return simulate_bench(replace(linear_bench(setting), hand=hand, duration=cycles / frequency))


def _seen_noise(setting: Setting) -> float:
    """RMS of what noise adds to the compensating torque, the first second left out, in [N m]."""
    runs = [
        _led(item, HAND_AMPLITUDE, HAND_FREQUENCY, 1.5) for item in (setting, setting._replace(noise=0.0))
    ]
    noisy, ideal = (run.column("inertia_compensation_torque_Nm")[round(1.0 / TICK) :] for run in runs)
    return root_mean_square(noisy - ideal)


def _seen_inertia(setting: Setting) -> float:
    """Inertia over the true one in the hand's torque, by least squares over the last two of four cycles."""
    run = _led(setting._replace(noise=0.0), FELT_AMPLITUDE, FELT_FREQUENCY, 4.0)
    cycles = slice(-round(2.0 / FELT_FREQUENCY / TICK), None)
    names = ("motor_acceleration_rad_per_s2", "motor_velocity_rad_per_s", "hand_torque_Nm", "load_torque_Nm")
    acceleration, velocity, hand, load = (run.column(name)[cycles] for name in names)
    causes = np.column_stack([acceleration, velocity, np.ones_like(velocity)])
    found = np.linalg.lstsq(causes, hand + load, rcond=None)[0]
    return float(found[0] / inertia(run.test))


# ---------------------------------------------------------------------- study


def settings_by_delay(*, quick: bool = False) -> list[Setting]:
    """Settings of a joint that is held, without shares: gear, source, delay, in order.

    Args:
        quick: Two delays and a rigid gear.

    Returns:
        The settings; the delay of the encoder is that of its filters.
    """
    filters, delays = (TIME_CONSTANTS[1:4:2], DELAYS[1:4:2]) if quick else (TIME_CONSTANTS, DELAYS)
    found: list[Setting] = []
    for compliant, source in itertools.product((False,) if quick else (False, True), Source):
        if source is Source.ENCODER:
            lags = [(time_constant, 0) for time_constant in filters]
        else:
            lags = [(TIME_CONSTANTS[0], delay) for delay in delays]
        found += [Setting(source, lag, delay, compliant=compliant) for lag, delay in lags]
    return found


def settings_by_filter(*, quick: bool = False) -> list[Setting]:
    """Settings of a joint that is held, without shares: source, filter, noise, in order.

    Args:
        quick: Two filters and one noise.

    Returns:
        The settings, with a rigid gear; samples of a unit come over the bus.
    """
    filters = TIME_CONSTANTS[2:4] if quick else TIME_CONSTANTS
    return [
        Setting(source, value, 0 if source is Source.ENCODER else BUS_DELAY, noise=factor)
        for source, value in itertools.product(Source, filters)
        for factor in (NOISE_FACTORS[:1] if quick else NOISE_FACTORS)
    ]


@dataclass(frozen=True, eq=False)
class InertiaStudy:
    """Results of the study.

    Attributes:
        stability: One row per setting and share.
        limits: One row per setting, held and free.
        noise: One row per source, filter, noise and share; rigid gear.
    """

    stability: pd.DataFrame
    limits: pd.DataFrame
    noise: pd.DataFrame


def study_inertia(means: Means, *, quick: bool = False) -> InertiaStudy:
    """Run the whole study.

    Args:
        means: Processes, progress, interruption.
        quick: A small part of each grid.

    Returns:
        The tables.

    Raises:
        Interrupted: If it was stopped.
    """
    held = settings_by_delay(quick=quick)
    shares, noise_shares = (SHARES[3::4], NOISE_SHARES[1:2]) if quick else (SHARES, NOISE_SHARES)
    filtered = settings_by_filter(quick=quick)
    parts = (
        [Job(stability_row, item._replace(share=share)) for item in held for share in shares],
        [Job(limit_row, item._replace(held=kept)) for kept in (True, False) for item in held],
        [Job(noise_row, item._replace(share=share)) for item in filtered for share in noise_shares],
    )
    return InertiaStudy(*tables_of(parts, means))
