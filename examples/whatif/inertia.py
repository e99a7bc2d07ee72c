"""Inertia compensation of the knee: simulated on the bench, and as the matrix of one tick.

The linear joint is motor and link, with a rigid or a compliant gear, viscous friction, and a hand that holds
the link or none. In a tick the firmware estimates the acceleration, sets a torque and holds it while
the joint moves exactly. The columns of the matrix are the responses to each unit of the state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from whatif.bench import (
    DEGREE,
    HAND_AMPLITUDE,
    HAND_FREQUENCY,
    JOINT,
    LEVEL,
    MODEL,
    THESIS_RATIO,
    Row,
    controlled,
    holding_torque,
    inertia,
    knee,
    outcome,
    root_mean_square,
)

from twin_gait.checking.hanging_leg import friction_slope
from twin_gait.checking.stability import largest_stable
from twin_gait.configuration.bench_device import BENCH_SENSORS
from twin_gait.core.estimation import first_order_gain
from twin_gait.gait.table import TICK
from twin_gait.parameters.drives import SensorParameters
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.simulation.bench_joint.loop import BenchRun, simulate_bench
from twin_gait.worlds.bench_joint import BenchFriction, BenchJoint, InertialSensor, InertialUnit, Torsion
from twin_gait.worlds.bench_leg import ImposedMotionParameters

LOAD = 2.0  # [kg]
THESIS_GAIN = 0.35  # G, the thesis's best
START_SPEED = 0.5  # [rad/s] of the joint that the hand catches
DURATION, SPAN = 12.0, 3.0  # [s]
APPARENT_FREQUENCY, APPARENT_AMPLITUDE = 1.0, 0.2  # [Hz], [rad]
LARGEST_SHARE = 1.5
DOUBLINGS = 20  # 2^20 ticks: a quarter of an hour
TINY = 1e-6  # [rad/s], start of a linear run
LARGE = 1e-5  # [rad]; a linear motion that has come to this is unstable, and may not be linear any more
EARLY = (2.0, 3.0)  # [s]
ROUNDING = 1e-13  # [rad]


class Source(StrEnum):
    """Sensor from which the acceleration is estimated."""

    ENCODER = "encoder"  # on the motor, differentiated twice
    GYROSCOPE = "gyroscope"  # on the link, differentiated once
    ACCELEROMETER = "accelerometer"  # on the link


class Setting(NamedTuple):
    """Joint with inertia compensation."""

    source: Source
    time_constant: float  # of each filter behind the sensor in [s]; the encoder has two
    delay: int = 0  # ticks between a sample of a unit and its use; 0 for the encoder
    share: float = 0.0  # of the inertia that is compensated
    compliant: bool = False  # the gear
    held: bool = True  # by a hand, at the link
    noise: float = 1.0  # factor on the noise of the sensor; 0 for an ideal one


# ---------------------------------------------------------------------- the bench

SENSORS = {Source.GYROSCOPE: InertialSensor.GYROSCOPE, Source.ACCELEROMETER: InertialSensor.ACCELEROMETER}


def bench_of(setting: Setting, friction: FrictionParameters, **control: float) -> BenchJoint:
    """Return the bench of a setting with a true friction law and a hand at rest."""
    bench = knee(
        LOAD,
        friction=BenchFriction(law=friction),
        sensors=sensors_of(setting),
        inertial_unit=unit_of(setting),
        torsion=Torsion() if setting.compliant else None,
        imposed_motion=ImposedMotionParameters(joint=JOINT, amplitude=0.0) if setting.held else None,
    )
    wanted = {"inertia_compensation": setting.share, "target_torque": holding_torque(bench), **control}
    return replace(bench, control=controlled(MODEL, **wanted))


def sensors_of(setting: Setting) -> SensorParameters:
    firmware = BENCH_SENSORS
    filtered = setting.time_constant if setting.source is Source.ENCODER else firmware.fast_time_constant
    if setting.noise == 0.0:
        return replace(firmware, ideal=True, fast_time_constant=filtered)
    counts = round(firmware.encoder_counts / setting.noise)
    return replace(firmware, fast_time_constant=filtered, encoder_counts=counts)


def unit_of(setting: Setting) -> InertialUnit | None:
    if setting.source is Source.ENCODER:
        return None
    sensor = SENSORS[setting.source]
    unit, gyroscope = BENCH_SENSORS.trunk, sensor is InertialSensor.GYROSCOPE
    sample = unit.gyroscope_noise if gyroscope else unit.accelerometer_noise  # at 1 kHz
    noise = setting.noise * sample
    return InertialUnit(sensor=sensor, noise=noise, delay=setting.delay, time_constant=setting.time_constant)


def linear_bench(setting: Setting, **control: float) -> BenchJoint:
    """Return the bench with the slope of its friction at 1 rad/s, and without friction compensation."""
    slope = friction_slope(MODEL.scaled(THESIS_RATIO), 1.0)
    viscous = FrictionParameters(
        breakaway_torque=0.0, coulomb_friction=0.0, breakaway_velocity=1.0, viscous_friction=slope
    )
    return bench_of(setting, viscous, friction_compensation_gain=0.0, **control)


# ---------------------------------------------------------------------- the matrix of a tick


@dataclass(frozen=True, kw_only=True)
class InertiaLoop:
    """Linear joint with inertia compensation; inertias in [kg·m²], all else in SI units."""

    source: Source
    share: float
    delay: int
    time_constant: float
    motor_inertia: float
    link_inertia: float
    friction: float  # viscous, on the motor
    hand_stiffness: float = 0.0
    hand_damping: float = 0.0
    gear_stiffness: float = 0.0  # 0 for a rigid gear
    gear_damping: float = 0.0

    @property
    def filter_gain(self) -> float:
        """Return the gain of the first-order filters."""
        return first_order_gain(TICK, self.time_constant)

    @property
    def command(self) -> float:
        """Return the torque per estimated acceleration in [kg·m²]."""
        return self.share * (self.motor_inertia + self.link_inertia)


def loop_of(setting: Setting) -> InertiaLoop:
    """Return the linear loop of :func:`linear_bench`, for its matrix."""
    bench = linear_bench(setting)
    hand, torsion = bench.imposed_motion, bench.torsion
    return InertiaLoop(
        source=setting.source,
        share=setting.share,
        delay=setting.delay,
        time_constant=setting.time_constant,
        motor_inertia=bench.actuator.armature,
        link_inertia=bench.link.total_inertia,
        friction=bench.friction.law.viscous_friction,
        hand_stiffness=0.0 if hand is None else hand.stiffness,
        hand_damping=0.0 if hand is None else hand.damping,
        gear_stiffness=0.0 if torsion is None else torsion.stiffness,
        gear_damping=0.0 if torsion is None else torsion.damping,
    )


def mean_delay(loop: InertiaLoop) -> float:
    r"""Return the mean delay of the estimated acceleration in [s], without the tick that holds a torque.

    Half a tick for each difference, :math:`(1-\alpha)/\alpha` ticks for each filter of gain :math:`\alpha`,
    and the transmission delay of the samples. It is the slope of the phase at low frequencies.
    """
    filtering = (1.0 - loop.filter_gain) / loop.filter_gain
    ticks = {
        Source.ENCODER: 1.0 + 2.0 * filtering,
        Source.GYROSCOPE: 0.5 + filtering + loop.delay,
        Source.ACCELEROMETER: filtering + loop.delay,
    }
    return ticks[loop.source] * TICK


def rates(loop: InertiaLoop) -> np.ndarray:
    r"""Return the matrix of the joint under a constant torque: :math:`\dot x = A x` with the torque in x.

    Returns:
        Rates of angles, velocities and the constant torque: shape ``(3, 3)`` for a rigid gear, else
        ``(5, 5)`` with motor before link.
    """
    if loop.gear_stiffness == 0.0:
        mass = loop.motor_inertia + loop.link_inertia
        stiffness, damping = loop.hand_stiffness / mass, (loop.hand_damping + loop.friction) / mass
        return np.array([[0.0, 1.0, 0.0], [-stiffness, -damping, 1.0 / mass], [0.0, 0.0, 0.0]])
    masses = np.array([[loop.motor_inertia], [loop.link_inertia]])
    between = np.array([[1.0, -1.0], [-1.0, 1.0]])
    whole = np.zeros((5, 5))
    whole[:2, 2:4] = np.eye(2)
    whole[2:4, :2] = -(loop.gear_stiffness * between + np.diag([0.0, loop.hand_stiffness])) / masses
    whole[2:4, 2:4] = -(loop.gear_damping * between + np.diag([loop.friction, loop.hand_damping])) / masses
    whole[2, 4] = 1.0 / loop.motor_inertia
    return whole


class TickMatrix:
    """Transition matrix of a loop over one tick, and response to the sensor noise.

    The state: angles, velocities and torque of :func:`rates`; the last angle, the fast velocity and the
    estimated acceleration of the firmware; the samples of the unit, newest first.

    Attributes:
        matrix: Of the state over a tick, shape ``(n, n)``.
        noise: Response of the state to a unit of sensor noise, shape ``(n,)``.
        estimate: Index of the estimated acceleration in the state.
    """

    def __init__(self, loop: InertiaLoop) -> None:
        """Compute the matrix column by column."""
        self._loop, self._rates = loop, rates(loop)
        self._moves = expm(TICK * self._rates)
        self._joint = len(self._rates)
        self.estimate = self._joint + 2
        size = self._joint + 3 + loop.delay + 2
        self.matrix = np.array([self._tick(unit, 0.0) for unit in np.eye(size)]).T
        self.noise = self._tick(np.zeros(size), 1.0)

    def _tick(self, state: np.ndarray, noise: float) -> np.ndarray:
        loop, joint = self._loop, self._joint
        moving, firmware, samples = state[:joint], state[joint : joint + 3], state[joint + 3 :]
        last, fast, estimate = firmware
        gain = loop.filter_gain
        angle = moving[0] + (noise if loop.source is Source.ENCODER else 0.0)
        faster = fast + gain * ((angle - last) / TICK - fast)
        samples = np.concatenate([[self._sample(moving, noise)], samples[:-1]])
        late, later = samples[loop.delay], samples[loop.delay + 1]
        seen = {
            Source.ENCODER: (faster - fast) / TICK,
            Source.GYROSCOPE: (late - later) / TICK,
            Source.ACCELEROMETER: late,
        }[loop.source]
        estimate += gain * (seen - estimate)
        held = np.concatenate([moving[:-1], [loop.command * estimate]])
        return np.concatenate([self._moves @ held, [angle, faster, estimate], samples])

    def _sample(self, moving: np.ndarray, noise: float) -> float:
        """Return velocity or acceleration of the link, with the torque of the last tick."""
        link = self._joint // 2
        if self._loop.source is Source.ACCELEROMETER:
            return float(self._rates[2 * link - 1] @ moving + noise)
        return float(moving[2 * link - 1] + noise)


def growth_rate(loop: InertiaLoop) -> float:
    """Return the rate of the fastest growing mode in [1/s]: below 0 all decay; a free joint has one at 0."""
    return float(np.log(np.abs(np.linalg.eigvals(TickMatrix(loop).matrix)).max()) / TICK)


def torque_noise(loop: InertiaLoop, deviation: float) -> float:
    r"""Compute the standard deviation in [N·m] of the torque from white sensor noise in the closed loop.

    The covariance of the state solves :math:`P = A P A^T + \sigma^2 b b^T`.

    Args:
        loop: Stable and held loop: a free joint would drift.
        deviation: σ of a sample: [rad], [rad/s] or [rad/s²], by the source.
    """
    found = TickMatrix(loop)
    covariance = deviation * deviation * np.outer(found.noise, found.noise)
    passed = found.matrix
    # P = Σ A^k Q A^kᵀ, twice as many terms each time: the samples under way make a direct solution singular.
    for _ in range(DOUBLINGS):
        covariance = covariance + passed @ covariance @ passed.T
        passed = passed @ passed
    return float(loop.command * np.sqrt(covariance[found.estimate, found.estimate]))


def apparent_inertia(loop: InertiaLoop, frequency: float) -> float:
    r"""Return the apparent inertia of the joint at a frequency in [Hz] over the true one.

    With the response :math:`H` of the estimate to the true acceleration it is
    :math:`1 - \alpha\,\mathrm{Re}\,H(j\omega)`; for a rigid gear and frequencies at which the torque that is
    held for a tick is as good as a continuous one.
    """
    turn = 2.0 * np.pi * frequency * TICK
    z, gain = np.exp(1j * turn), loop.filter_gain
    filtered = gain / (1.0 - (1.0 - gain) / z)
    difference = (1.0 - 1.0 / z) / (1j * turn)
    responses = {
        Source.ENCODER: difference**2 * filtered**2,
        Source.GYROSCOPE: difference * filtered * z**-loop.delay,
        Source.ACCELEROMETER: filtered * z**-loop.delay,
    }
    hold = (1.0 - 1.0 / z) / (1j * turn)
    return float(1.0 - loop.share * np.real(responses[loop.source] * hold))


def sample_deviation(setting: Setting) -> float:
    """Return the standard deviation of a sample in its unit; for the encoder a count over √12."""
    unit = unit_of(setting)
    if unit is None:
        count = 2.0 * math.pi / (sensors_of(setting).encoder_counts * knee().actuator.gear_ratio)
        return count / math.sqrt(12.0)
    return unit.noise / unit.lever if unit.sensor is InertialSensor.ACCELEROMETER else unit.noise


# ---------------------------------------------------------------------- rows of the tables


def setting_columns(setting: Setting) -> Row:
    return {
        "source": str(setting.source),
        "filter_ms": 1e3 * setting.time_constant,
        "bus_delay_ms": 1e3 * TICK * setting.delay,
        "mean_delay_ms": round(1e3 * mean_delay(loop_of(setting)), 3),
        "gear": "compliant" if setting.compliant else "rigid",
        "held": setting.held,
    }


def stability_row(setting: Setting) -> Row:
    """Predict instability, run the linear joint, and run the joint with its friction; the sensor is ideal."""
    ideal, law = setting._replace(noise=0.0), MODEL.scaled(THESIS_RATIO)
    true = bench_of(ideal, law, friction_compensation_gain=THESIS_GAIN)
    run = simulate_bench(replace(true, start_velocity=START_SPEED, duration=DURATION))
    ending, amplitude = outcome(run, SPAN)
    torque = run.column("motor_torque_Nm")[-round(SPAN / TICK) :]
    return {
        **setting_columns(setting),
        "share": setting.share,
        "growth_rate_per_s": round(growth_rate(loop_of(setting)), 4),
        "linear_run_is_unstable": linear_run_is_unstable(setting),
        "ending": str(ending),
        "amplitude_deg": round(amplitude / DEGREE, 4),
        "torque_amplitude_Nm": round(0.5 * float(np.ptp(torque)), 3),
    }


def linear_run_is_unstable(setting: Setting) -> bool:
    """Return whether a small motion of the linear joint becomes large, or is larger at the end than early."""
    bench = linear_bench(setting._replace(noise=0.0), target_torque=0.0)
    test = replace(bench, gravity=0.0, start_velocity=TINY, duration=DURATION)
    angle = simulate_bench(test).column("motor_angle_rad") - LEVEL
    first, last = (round(time / TICK) for time in EARLY)
    early, late = (float(np.ptp(part)) for part in (angle[first:last], angle[first - last :]))
    return bool(np.abs(angle).max() > LARGE) or late > max(early, ROUNDING)


def largest_share(setting: Setting) -> float:
    """Return the largest stable share, at most ``LARGEST_SHARE``, by the eigenvalues of a tick."""
    loop = loop_of(setting)

    def radius(share: float) -> float:
        return math.exp(growth_rate(replace(loop, share=share)) * TICK)

    found = largest_stable(radius, 0.0, LARGEST_SHARE)
    return math.nan if found is None else found


def limit_row(setting: Setting) -> Row:
    return {**setting_columns(setting), "largest_share": round(largest_share(setting), 4)}


def noise_row(setting: Setting) -> Row:
    """Return torque noise and apparent inertia of a held rigid joint: linear run and closed form."""
    loop = loop_of(setting)
    return {
        **setting_columns(setting),
        "share": setting.share,
        "noise_factor": setting.noise,
        "torque_noise_Nm": round(simulated_noise(setting), 5),
        "linear_torque_noise_Nm": round(torque_noise(loop, sample_deviation(setting)), 5),
        "apparent_inertia": round(simulated_inertia(setting), 4),
        "closed_apparent_inertia": round(apparent_inertia(loop, APPARENT_FREQUENCY), 4),
    }


def moved(setting: Setting, amplitude: float, frequency: float, cycles: float) -> BenchRun:
    hand = ImposedMotionParameters(joint=JOINT, amplitude=amplitude, frequency=frequency)
    return simulate_bench(replace(linear_bench(setting), imposed_motion=hand, duration=cycles / frequency))


def simulated_noise(setting: Setting) -> float:
    """Return the RMS of the noise of the compensating torque without the first second, in [N·m]."""
    runs = [
        moved(item, HAND_AMPLITUDE, HAND_FREQUENCY, 1.5) for item in (setting, setting._replace(noise=0.0))
    ]
    noisy, ideal = (run.column("inertia_compensation_torque_Nm")[round(1.0 / TICK) :] for run in runs)
    return root_mean_square(noisy - ideal)


def simulated_inertia(setting: Setting) -> float:
    """Return the apparent over the true inertia from the torque of the hand, fitted over two cycles."""
    run = moved(setting._replace(noise=0.0), APPARENT_AMPLITUDE, APPARENT_FREQUENCY, 4.0)
    cycles = slice(-round(2.0 / APPARENT_FREQUENCY / TICK), None)
    names = (
        "motor_acceleration_rad_per_s2",
        "motor_velocity_rad_per_s",
        "imposed_motion_torque_Nm",
        "load_torque_Nm",
    )
    acceleration, velocity, hand, load = (run.column(name)[cycles] for name in names)
    causes = np.column_stack([acceleration, velocity, np.ones_like(velocity)])
    found = np.linalg.lstsq(causes, hand + load, rcond=None)[0]
    return float(found[0] / inertia(run.test))
