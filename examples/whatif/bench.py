"""Knee on its bench: common part of the what-if studies.

The weight is held level at 90°, and the current loop is noise-free and ideal: the studies examine friction,
filters and sensors, not the inverter.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from whatif.endings import Ending, classify

from twin_gait import JointName, RunStatus
from twin_gait.checking.hanging_leg import friction_slope, friction_torque
from twin_gait.checking.linear_loop import LinearLoop, leg_motion
from twin_gait.configuration.bench_device import BENCH_ACTUATORS, BENCH_FRICTION, bench_joint
from twin_gait.core.estimation import first_order_gain
from twin_gait.gait.table import TICK
from twin_gait.parameters.drives import SensorParameters
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.simulation.bench_joint.loop import BenchRun, simulate_bench
from twin_gait.worlds.bench_control import TorqueControl
from twin_gait.worlds.bench_joint import (
    HORIZONTAL,
    BenchFriction,
    BenchJoint,
    CurrentLoop,
    DriveParameters,
    LinkParameters,
)
from twin_gait.worlds.bench_leg import ImposedMotionParameters

Row = dict[str, Any]

JOINT = JointName.KNEE
DEGREE = math.pi / 180.0
LEVEL = HORIZONTAL  # where the joint is held
MODEL = BENCH_FRICTION[JOINT].normalised()  # table 3.1, the default model of the compensator
THESIS_RATIO = 0.55  # about what the true friction was, if its compensator was unstable above G = 0.60
SPRING = 0.5 / DEGREE  # [N·m/rad] that holds the joint; the softest of the thesis sags under a weight
# One period of the current loop in a tick: an ideal loop gains nothing from more.
DRIVE = DriveParameters(
    inductance=BENCH_ACTUATORS[JOINT].inductance,
    rate=1.0 / TICK,
    loop=CurrentLoop.IDEAL,
    noise=0.0,
    ripple=0.0,
    delay=0,
)


def controlled(model: FrictionParameters = MODEL, **settings: Any) -> TorqueControl:
    """Return torque control with a friction model and further attributes of :class:`TorqueControl`."""
    return TorqueControl(friction_model=model, **settings)


def knee(mass: float = 0.0, **changes: Any) -> BenchJoint:
    """Return the knee bench with a quiet drive and a weight in [kg]; a test ends at the upper stop."""
    chosen = {"drive": DRIVE, "link": LinkParameters(mass=mass), "rest_at_stop": 0.0, **changes}
    return bench_joint(JOINT, **chosen)


def holding_torque(test: BenchJoint) -> float:
    """Return the torque that holds the weight level in [N·m]."""
    return -test.gravity * test.link.total_moment


def inertia(test: BenchJoint) -> float:
    """Return the inertia of motor, gear, link and weight about the joint in [kg·m²]."""
    return test.actuator.armature + test.link.total_inertia


def mean_delay(sensors: SensorParameters) -> float:
    r"""Return the mean delay of the slow velocity in [s].

    Half a frame for the difference, :math:`(W-1)/2` frames for the average of :math:`W`, and half of what
    a sample is held: :math:`(N W + N - 1)/2` ticks with :math:`N` ticks in a frame.
    """
    frame = sensors.decimation
    return 0.5 * (frame * sensors.window + frame - 1) * TICK


def root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values * values)))


# ---------------------------------------------------------------------- friction


def law_in(friction: BenchFriction, load: float = 0.0) -> FrictionParameters:
    """Return the law of a bench friction at its temperature and a steady load in [N·m].

    The changes by temperature and load have the form of two terms of equation (3.1): the sum is such a
    law again.
    """
    law = friction.law.normalised()
    warmer = friction.temperature - BenchFriction(law=law).temperature
    level = friction.coulomb_per_load * abs(load) + friction.coulomb_per_kelvin * warmer
    return replace(
        law,
        breakaway_torque=law.breakaway_torque + level,
        coulomb_friction=law.coulomb_friction + level,
        viscous_friction=law.viscous_friction + friction.viscous_per_kelvin * warmer,
    )


def torques(law: FrictionParameters, velocity: np.ndarray) -> np.ndarray:
    """Compute the friction torques of a law in [N·m], with the sign of the velocity in [rad/s]."""
    return np.array([friction_torque(law, float(value)) for value in velocity])


def torque_ratio(true: FrictionParameters, model: FrictionParameters, speed: np.ndarray) -> np.ndarray:
    """Compute true friction over modelled friction at speeds of 0 or more; at rest the ratio of slopes."""

    def ratio(value: float) -> float:
        law = friction_torque if value > 0.0 else friction_slope
        return law(true, value) / law(model, value)

    return np.array([ratio(float(value)) for value in speed])


def least_torque_ratio(true: FrictionParameters, model: FrictionParameters, speed: float) -> float:
    """Return the least ratio of true friction to model from rest up to a speed in [rad/s].

    A free joint that slows down passes through all of these speeds; at a speed at which G is above the
    ratio, the compensator adds more power than friction dissipates. From this gain on the joint does not
    come to rest, if the filter is fast.
    """
    return float(torque_ratio(true, model, np.linspace(0.0, speed, 201)).min())


def linear_loop(test: BenchJoint, velocity: float, load: float = 0.0) -> LinearLoop:
    """Return the loop of a test under torque control, linearised at 90°, for its transition matrix.

    Args:
        test: The test; the weight has no slope where the link is level.
        velocity: Velocity of the linearisation in [rad/s].
        load: Load for the friction in [N·m].
    """
    control, sensors, zero = test.control, test.sensors, np.zeros((1, 1))
    true = friction_slope(law_in(test.friction, load), velocity)
    return LinearLoop(
        motion=leg_motion(zero + inertia(test), zero, np.array([true])),
        stiffness=np.array([control.stiffness]),
        damping=np.array([control.damping]),
        gain=np.array([control.friction_compensation_gain]),
        modelled_friction=np.array([friction_slope(control.friction_model, velocity)]),
        feed_forward=zero,
        fast_gain=first_order_gain(TICK, sensors.fast_time_constant),
        decimation=sensors.decimation,
        window=sensors.window,
    )


# ---------------------------------------------------------------------- a push

HAND_AMPLITUDE = math.radians(-40.0)
HAND_FREQUENCY = 0.25  # [Hz]; the highest speed of an imposed motion is near that of the thesis's falls
PUSH = 0.3  # [rad/s], half of what a fall of the thesis reaches
PUSHED_DURATION = 32.0  # [s]; the convergence to a limit cycle is slow
SPAN = 6.0  # [s]; the last two of this length are compared


def push(speed: float, frequency: float = HAND_FREQUENCY) -> ImposedMotionParameters:
    """Return a hand that moves the joint away from the near stop, and releases it at a speed in [rad/s]."""
    amplitude = -speed / (math.pi * frequency)
    return ImposedMotionParameters(
        joint=JOINT, amplitude=amplitude, frequency=frequency, release_time=0.25 / frequency
    )


class Outcome(NamedTuple):
    """Ending of a motion after a push."""

    ending: Ending
    amplitude: float  # half the range of the angle at the end in [rad]; of a runaway, of the whole test


def outcome(run: BenchRun, span: float = SPAN) -> Outcome:
    """Return the ending of a test by its motion in the last two spans [s]; reaching a stop is a runaway."""
    angle = run.column("link_angle_rad")
    early = len(angle) < round(run.test.duration / TICK)
    if early or run.status is RunStatus.DIVERGED or run.column("stop_torque_Nm").any():
        return Outcome(Ending.RUNAWAY, 0.5 * float(np.ptp(angle)))
    length = round(span / TICK)
    before, end = angle[-2 * length : -length], angle[-length:]
    return Outcome(*classify(before[:, None], end[:, None], at_stop=False))


def pushed(test: BenchJoint, speed: float = PUSH) -> Outcome:
    """Push and release a joint, and return the ending."""
    return outcome(simulate_bench(replace(test, imposed_motion=push(speed), duration=PUSHED_DURATION)))


HIGHEST_GAIN = 2.5
BISECTIONS = 9


def largest_resting_gain(rests: Callable[[float], bool]) -> float:
    """Return the largest gain at which a joint comes to rest, to 0.0025; at most ``HIGHEST_GAIN``."""
    low, high = 0.0, HIGHEST_GAIN
    if rests(high):
        return high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rests(middle) else (low, middle)
    return 0.5 * (low + high)


# ---------------------------------------------------------------------- an imposed motion


class Effort(NamedTuple):
    """Effort of imposing a cycle of motion on a joint."""

    torque: float  # RMS in [N·m]
    friction: float  # RMS of the residual friction without inertia and weight in [N·m]
    work: float  # in [J]; negative if the joint drives the hand


def imposed_motion(test: BenchJoint) -> Effort:
    """Impose two cycles on the joint through a spring and damper, and measure the second."""
    hand = ImposedMotionParameters(joint=JOINT, amplitude=HAND_AMPLITUDE, frequency=HAND_FREQUENCY)
    run = simulate_bench(replace(test, imposed_motion=hand, duration=2.0 / HAND_FREQUENCY))
    cycle = slice(-round(1.0 / HAND_FREQUENCY / TICK), None)
    names = (
        "imposed_motion_torque_Nm",
        "load_torque_Nm",
        "motor_acceleration_rad_per_s2",
        "motor_velocity_rad_per_s",
    )
    torque, load, acceleration, velocity = (run.column(name)[cycle] for name in names)
    left = torque + load + holding_torque(test) - inertia(test) * acceleration
    return Effort(root_mean_square(torque), root_mean_square(left), float(torque @ velocity) * TICK)


def imposed_velocity() -> np.ndarray:
    """Return the velocity of the hand over a cycle in [rad/s], one value per tick."""
    time = np.arange(round(1.0 / HAND_FREQUENCY / TICK)) * TICK
    return math.pi * HAND_FREQUENCY * HAND_AMPLITUDE * np.sin(2.0 * math.pi * HAND_FREQUENCY * time)
