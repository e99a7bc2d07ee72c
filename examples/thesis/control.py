"""Statements of the thesis on its controllers, measured on the simulated knee."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from thesis.bench import (
    EQUILIBRIUM,
    GAINS,
    HAND_VELOCITIES,
    PRINTED_DELAY,
    RATIO,
    REACH,
    SEED,
    SHORT_REACH,
    STIFFNESS,
    STIFFNESS_PER_DEG,
    USABLE_GAINS,
    electromechanical_torque,
    last_period,
    model_torque,
    moved_by_hand,
    slope_per_deg,
    torque_control,
    torque_per_ampere,
    with_ideal_current,
    work,
)
from thesis.friction import rms
from thesis.velocity import closed_delay

from twin_gait.core.friction_models import coulomb_viscous_tanh_torque
from twin_gait.gait.table import TICK
from twin_gait.identification.signals import moving_average
from twin_gait.simulation.bench_joint.loop import BenchRun, simulate_bench
from twin_gait.worlds.bench_control import OldFrictionModel

OLD = OldFrictionModel()
SLOW, QUICK = (math.radians(5.0), 0.15), (REACH, 2.5)  # reach in [rad] and velocity in [rad/s] of a hand
AXIS_VELOCITY, AXIS_TORQUE = 6.0, 10.0  # [rad/s] and [N·m]; the axes of figure 2.12
SPRING_ANGLE = 20.0  # [deg]; where k was chosen so that the spring has 1 N·m (thesis 2.4)
OFF_LINE_RMSE = 0.0035  # [A], target current and the one computed after the test (thesis 3.5)
MEASURED_SLOPE = 0.0493  # [N·m/deg] (thesis 3.6)
SLOPE_SHARE = 0.02  # of k, by which the slope may fall short
# Velocities of the hand in [rad/s] for the slope against it, to the fastest of the thesis's logs.
VELOCITIES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
OTHER_RATIO = 0.5  # of a second joint, to show that the loop of the motor does not depend on the joint
GAIN_GRID = (0.0, USABLE_GAINS[0], *GAINS, USABLE_GAINS[1], 0.7)


# ---------------------------------------------------------------------- figures 2.12 and 2.20


def old_model_test(reach: float, fastest: float, seed: int = SEED) -> BenchRun:
    """Impose a motion on the knee with the friction of table 3.1; the old model compensates, G = 1."""
    control = replace(torque_control(1.0), old_model=OLD)
    test = moved_by_hand(control, reach=reach, fastest=fastest, ratio=1.0)
    return simulate_bench(with_ideal_current(test), seed=seed)


def old_law(velocity: np.ndarray) -> np.ndarray:
    """Compute the old friction model in [N·m], equation (2.5)."""
    law = OLD.coulomb, OLD.viscous, OLD.steepness
    return np.array([coulomb_viscous_tanh_torque(speed, *law) for speed in velocity.tolist()])


def seen_steepness(run: BenchRun) -> float:
    r"""Return the steepness of the old model in [s/rad] from a log.

    Median of κ in :math:`T = F_s \tanh(\kappa\omega) + F_v\omega` over every row of the last period between
    a fifth and four fifths of F_s.
    """
    rows = last_period(run)
    velocity = run.column("motor_velocity_rad_per_s")[rows]
    share = (electromechanical_torque(run)[rows] - OLD.viscous * velocity) / OLD.coulomb
    used = (np.abs(share) > 0.2) & (np.abs(share) < 0.8)
    return float(np.median(np.arctanh(share[used]) / velocity[used]))


def old_model_numbers(slow: BenchRun) -> dict[str, float]:
    """Return the measured steepness, the excess torque of the old model, and the largest joint speed."""
    motor, velocity = slow.test.actuator, np.linspace(0.02, 0.6, 400)
    surplus = old_law(velocity) - model_torque(velocity)
    return {
        "steepness": seen_steepness(slow),
        "surplus": float(surplus.max()),
        "surplus_velocity": float(velocity[np.argmax(surplus)]),
        "end_of_axis": float(old_law(np.array([AXIS_VELOCITY]))[0]),
        "no_load_speed": slow.test.battery.voltage / (motor.torque_constant * motor.gear_ratio),
    }


def spring_test(gain: float = 0.0, seed: int = SEED) -> BenchRun:
    """Impose a motion on the knee against the thesis's spring."""
    return simulate_bench(moved_by_hand(torque_control(gain, stiffness=STIFFNESS)), seed=seed)


# ---------------------------------------------------------------------- figure 3.5


class Hand(NamedTuple):
    """Motion imposed by hand: amplitude in [rad], velocity in the middle in [rad/s]."""

    reach: float
    fastest: float

    @property
    def words(self) -> str:
        """Format the motion for a legend."""
        return f"{2.0 * math.degrees(self.reach):.0f}°, up to {self.fastest} rad/s"


HANDS = tuple(Hand(*values) for values in itertools.product((SHORT_REACH, REACH), HAND_VELOCITIES))


@dataclass(frozen=True, eq=False)
class CurrentErrors:
    """RMSE in [A] of target and measured current, and of target and recomputed one by phase of decimation."""

    hand: Hand
    run: BenchRun
    measured: float
    off_line: tuple[float, ...]


def off_line_current(run: BenchRun, phase: int) -> np.ndarray:
    """Compute the target current [A] after the test from the velocity of the log only.

    The post-processing of section 2.3.1 on the log's 1 kHz velocity, the friction model, equation (2.16);
    each value is held until the next one. The first sample kept is that of row ``phase``, 0 to 9: a log does
    not say at which of its rows the firmware took its samples.
    """
    sensors = run.test.sensors
    velocity = run.column("velocity_rad_per_s")[phase :: sensors.decimation]
    gain = run.test.control.friction_compensation_gain
    torque = gain * model_torque(moving_average(velocity, sensors.window))
    held = np.repeat(torque, sensors.decimation)[: len(run.log) - phase]
    return np.concatenate([np.zeros(phase), held]) / torque_per_ampere(run)


def current_errors(hand: Hand, seed: int = SEED) -> CurrentErrors:
    """Impose a motion on the transparent knee and compare its currents over the last period."""
    run = simulate_bench(moved_by_hand(torque_control(GAINS[0]), **hand._asdict()), seed=seed)
    rows, phases = last_period(run), range(run.test.sensors.decimation)
    target = run.column("target_current_A")[rows]
    off_line = tuple(rms(off_line_current(run, phase)[rows] - target) for phase in phases)
    return CurrentErrors(hand, run, rms(run.column("measured_current_A")[rows] - target), off_line)


def expected_rmse(run: BenchRun) -> float:
    r"""Compute the RMSE [A] of target and measured current from its parts.

    The noise of a sample and the lag of the loop: at an acceleration :math:`\alpha` the back-EMF is a ramp,
    which the integral gain :math:`\omega_b R` follows with the error :math:`K_e\,\tau\,\alpha/(\omega_b R)`.
    Ripple and delay are left out.
    """
    motor, drive = run.test.actuator, run.test.drive
    lag = motor.torque_constant * motor.gear_ratio / (drive.bandwidth * motor.resistance)
    return math.hypot(drive.noise, lag * rms(run.column("motor_acceleration_rad_per_s2")[last_period(run)]))


def geometric_mean_and_spread(values: Sequence[float]) -> tuple[float, float]:
    """Return the root of smallest times largest value, and the factor from it to both."""
    return math.sqrt(min(values) * max(values)), math.sqrt(max(values) / min(values))


def current_numbers(found: Sequence[CurrentErrors]) -> dict[str, Any]:
    """Return the errors of the currents over all motions, in [A] and [mA]."""
    measured, parts = [each.measured for each in found], [expected_rmse(each.run) for each in found]
    # Every phase is as likely as the others.
    off_line = [rms(np.array(each.off_line)) for each in found]
    ours, spread = geometric_mean_and_spread(off_line)
    target = found[0].run.column("target_current_A")[last_period(found[0].run)]
    return {
        "measured": geometric_mean_and_spread(measured)[0],
        "off_line": ours,
        "off_line_low": OFF_LINE_RMSE / spread,
        "off_line_high": OFF_LINE_RMSE * spread,
        "spread": spread,
        "noise": found[0].run.test.drive.noise,
        "share_percent": 1e2 * found[0].measured / rms(target),
        **{
            f"{name}_mA": [1e3 * min(values), 1e3 * max(values)]
            for name, values in (("measured", measured), ("parts", parts), ("off_line", off_line))
        },
    }


# ---------------------------------------------------------------------- figure 3.6


def closed_slope(gain: float, reach: float, fastest: float, delay: float) -> float:
    r"""Compute the slope of T_em over the angle for a rigid hand on a cosine path, with one integral.

    The compensation uses a velocity that is :math:`\delta` old: a part of it is in phase with the angle and
    reduces the slope of the spring:

    .. math::

        k - G\,\frac{\oint T_{fr}(\dot x(t-\delta))\,x\,dt}{\oint x^2\,dt}

    Args:
        gain: G.
        reach: Amplitude of the hand in [rad].
        fastest: Velocity of the hand in the middle in [rad/s].
        delay: δ in [s].

    Returns:
        The slope in [N·m/deg].
    """
    angle = 2.0 * math.pi * (np.arange(2000) + 0.5) / 2000
    position, velocity = reach * np.cos(angle), -fastest * np.sin(angle - fastest / reach * delay)
    lost = gain * float(np.dot(model_torque(velocity), position) / np.dot(position, position))
    return STIFFNESS_PER_DEG - math.radians(lost)


def simulated_slopes(gain: float = GAINS[0], seed: int = SEED) -> list[float]:
    """Return the slopes of simulations on the bench for hands of all ``VELOCITIES``."""
    control = torque_control(gain, stiffness=STIFFNESS)
    tests = [with_ideal_current(moved_by_hand(control, fastest=fastest)) for fastest in VELOCITIES]
    return [slope_per_deg(simulate_bench(test, seed=seed)) for test in tests]


def velocity_of_slope(slope: float, slopes: Sequence[float]) -> float:
    """Return the velocity of the hand [rad/s] that gives a slope on the bench; NaN if there is none."""
    return float(np.interp(-slope, -np.array(slopes), VELOCITIES, left=math.nan, right=math.nan))


def impedance_numbers(run: BenchRun, slopes: Sequence[float]) -> dict[str, float]:
    """Return slope and loops of the knee on its spring, and the change of the slope by a delayed filter."""
    rows, sensors, lowest = last_period(run), run.test.sensors, (1.0 - SLOPE_SHARE) * STIFFNESS_PER_DEG
    friction = model_torque(run.column("motor_velocity_rad_per_s")[rows])
    cycle = float(np.trapezoid(friction, run.column("motor_angle_rad")[rows]))
    left = (RATIO - GAINS[0]) * cycle
    velocity, filtered = HAND_VELOCITIES[0], closed_delay(sensors.window, sensors.decimation)
    return {
        "slope": slope_per_deg(run),
        "slope_low": lowest,
        "lowest_velocity": velocity_of_slope(lowest, slopes),
        "fastest_slope": slopes[-1],
        "velocity": velocity_of_slope(MEASURED_SLOPE, slopes),
        "motor": work(run, electromechanical_torque(run)),
        "motor_closed": GAINS[0] * cycle,
        "hand": work(run, run.column("imposed_motion_torque_Nm")),
        "hand_closed": left,
        "hand_low": 0.99 * left,
        "hand_high": 1.01 * left,
        "slope_printed_delay": closed_slope(GAINS[0], REACH, velocity, PRINTED_DELAY),
        "slope_filter_delay": closed_slope(GAINS[0], REACH, velocity, filtered),
        "filter_delay_ms": 1e3 * filtered,
    }


# ---------------------------------------------------------------------- figure 3.7


@dataclass(frozen=True)
class LoopAreas:
    """Work in [J] of motor and hand per cycle on a joint with s = ``ratio``, by gain of ``GAIN_GRID``."""

    ratio: float
    motor: tuple[float, ...]
    hand: tuple[float, ...]

    @property
    def vanishing_gain(self) -> float:
        """Return the gain at which the loop of the hand vanishes; NaN if it does not."""
        return float(np.interp(0.0, -np.array(self.hand), GAIN_GRID, left=np.nan, right=np.nan))


def loop_areas(ratio: float, seed: int = SEED) -> LoopAreas:
    """Impose the motion with every gain of ``GAIN_GRID`` and return the areas of the loops."""
    motor, hand = [], []
    for gain in GAIN_GRID:
        test = moved_by_hand(torque_control(gain, stiffness=STIFFNESS), ratio=ratio)
        run = simulate_bench(with_ideal_current(test), seed=seed)
        motor.append(work(run, electromechanical_torque(run)))
        hand.append(work(run, run.column("imposed_motion_torque_Nm")))
    return LoopAreas(ratio, tuple(motor), tuple(hand))


def overshoot(run: BenchRun) -> float:
    """Return the overshoot [deg] of a joint beyond θ0 after its release by the hand."""
    free = run.column("motor_angle_rad")[round(run.test.imposed_motion.release_time / TICK) :]
    return float(np.degrees(free.max() - EQUILIBRIUM))


def gain_numbers(areas: Sequence[LoopAreas], released: Sequence[BenchRun]) -> dict[str, Any]:
    """Return the loops of motor and hand with the gains of figure 3.7, and the swings after a release."""
    first, second = areas
    indices, swings = [GAIN_GRID.index(gain) for gain in GAINS], [overshoot(run) for run in released]
    motor, hand = ([loop[index] for index in indices] for loop in (first.motor, first.hand))
    return {
        "motor": motor,
        "hand": hand,
        "swings": swings,
        "motor_ratio": motor[-1] / motor[0],
        "hand_ratio": hand[-1] / hand[0],
        "vanishing": first.vanishing_gain / first.ratio,
        "vanishing_other": second.vanishing_gain / second.ratio,
        "largest_gain": first.vanishing_gain,
        "swing_ratio": swings[-1] / swings[0],
    }
