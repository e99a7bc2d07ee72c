"""The tests on the joint bench that the studies have in common.

All are on the knee, weight held level at 90°, with a quiet and ideal current loop: what is asked here is
asked of friction, filters and sensors, not of the inverter.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twin_gait.checking.hanging_leg import friction_slope, friction_torque
from twin_gait.checking.linear_loop import LinearLoop, leg_motion
from twin_gait.control import Controller
from twin_gait.core.estimation import first_order_gain
from twin_gait.core.friction_models import REFERENCE_TEMPERATURE
from twin_gait.gait.table import TICK
from twin_gait.measures.assistance import root_mean_square
from twin_gait.parameters import FrictionParameters, SensorParameters
from twin_gait.scenario.bench_joint import (
    BENCH_FRICTION,
    BENCH_INDUCTANCE,
    HORIZONTAL,
    BenchFriction,
    BenchJoint,
    CurrentLoop,
    DriveParameters,
    LinkParameters,
    TorqueControl,
    bench_joint,
)
from twin_gait.scenario.bench_leg import HandParameters
from twin_gait.simulation.bench_joint import BenchRun, simulate_bench
from twin_gait.simulation.run import RunStatus
from twin_gait.studies.loop_stability.loop_stability import Ending, classify
from twin_gait.vocabulary import JointName

JOINT = JointName.KNEE
MODEL = BENCH_FRICTION[JOINT].normalised()  # table 3.1, the compensator's model unless said otherwise
# One period of the current loop in a tick: an ideal loop gains nothing from more.
DRIVE = DriveParameters(
    inductance=BENCH_INDUCTANCE[JOINT],
    rate=1.0 / TICK,
    loop=CurrentLoop.IDEAL,
    noise=0.0,
    ripple=0.0,
    delay=0,
)

# The hand that leads the joint there and back; its highest speed is near that of the thesis's falls.
HAND_AMPLITUDE = math.radians(-40.0)
HAND_FREQUENCY = 0.25  # [Hz]
HAND_CYCLES = 2  # the second is measured

LEVEL = HORIZONTAL  # where the joint is held
PUSHED_DURATION = 32.0  # [s]; what shrinks to a limit cycle takes its time
SPAN = 6.0  # [s]; the last two of this length are compared


def controlled(model: FrictionParameters = MODEL, **settings: object) -> TorqueControl:
    """Torque control with a friction model.

    Args:
        model: The compensator's.
        settings: Attributes of :class:`TorqueControl`.

    Returns:
        The controller.
    """
    return TorqueControl(controller=Controller(friction_model=model), **settings)  # type: ignore[arg-type]


def rig(mass: float = 0.0, **changes: object) -> BenchJoint:
    """The knee bench with a quiet drive and a weight.

    Args:
        mass: In [kg].
        changes: Attributes of :class:`BenchJoint` that differ.

    Returns:
        The test; it ends where the link touches the upper stop.
    """
    chosen = {"drive": DRIVE, "link": LinkParameters(mass=mass), "rest_at_stop": 0.0, **changes}
    return bench_joint(JOINT, **chosen)


def holding_torque(test: BenchJoint) -> float:
    """Torque that holds the weight level in [N m]."""
    return -test.gravity * test.link.total_moment


def inertia(test: BenchJoint) -> float:
    """Of motor, gear, link and weight about the joint in [kg m²]."""
    return test.actuator.armature + test.link.total_inertia


def mean_delay(sensors: SensorParameters) -> float:
    r"""Mean delay of the slow velocity in [s].

    Half a frame for the difference, :math:`(W-1)/2` frames for the average of :math:`W`, and half of what
    a sample is held: :math:`(N W + N - 1)/2` ticks with :math:`N` ticks in a frame.

    Args:
        sensors: With decimation N and window W.

    Returns:
        The delay.
    """
    frame = sensors.decimation
    return 0.5 * (frame * sensors.window + frame - 1) * TICK


# ---------------------------------------------------------------------- friction


def law_in(friction: BenchFriction, load: float = 0.0) -> FrictionParameters:
    """The rotational law that a bench friction is under its temperature and a steady load.

    What temperature and load add has the shapes of two terms of equation (3.1), so that the sum is such a
    law again.

    Args:
        friction: With the parts that depend on conditions.
        load: Load torque in [N m].

    Returns:
        The law, normalised.
    """
    law = friction.law.normalised()
    warmer = friction.temperature - REFERENCE_TEMPERATURE
    level = friction.coulomb_per_load * abs(load) + friction.coulomb_per_kelvin * warmer
    return replace(
        law,
        breakaway_torque=law.breakaway_torque + level,
        coulomb_friction=law.coulomb_friction + level,
        viscous_friction=law.viscous_friction + friction.viscous_per_kelvin * warmer,
    )


def torques(law: FrictionParameters, velocity: np.ndarray) -> np.ndarray:
    """Friction torques of a law.

    Args:
        law: The law.
        velocity: In [rad] / [s], shape ``(n,)``.

    Returns:
        In [N m], with the sign of the velocity, shape ``(n,)``.
    """
    return np.array([friction_torque(law, float(value)) for value in velocity])


def torque_ratio(true: FrictionParameters, model: FrictionParameters, velocity: np.ndarray) -> np.ndarray:
    """True friction over the model's, whose limit at rest is the ratio of their slopes.

    Args:
        true: Law of the plant.
        model: Law of the compensator.
        velocity: In [rad] / [s], 0 or more, shape ``(n,)``.

    Returns:
        Ratios, shape ``(n,)``.
    """

    def ratio(speed: float) -> float:
        if speed == 0.0:
            return friction_slope(true, 0.0) / friction_slope(model, 0.0)
        return friction_torque(true, speed) / friction_torque(model, speed)

    return np.array([ratio(float(speed)) for speed in velocity])


def linear_loop(test: BenchJoint, velocity: float, load: float = 0.0) -> LinearLoop:
    """The loop of a test, linearised at 90° and a velocity, for the closed-loop transition matrix.

    Args:
        test: Under torque control.
        velocity: In [rad] / [s].
        load: At which the friction is taken in [N m].

    Returns:
        The loop; the weight has no slope where the link is level.
    """
    control, sensors = test.control, test.sensors
    assert isinstance(control, TorqueControl)  # the studies make no other
    true = friction_slope(law_in(test.friction, load), velocity)
    zero = np.zeros((1, 1))
    return LinearLoop(
        motion=leg_motion(zero + inertia(test), zero, np.array([true])),
        stiffness=np.array([control.stiffness]),
        damping=np.array([control.damping]),
        gain=np.array([control.friction_compensation_gain]),
        modelled_friction=np.array([friction_slope(control.controller.friction_model, velocity)]),
        feed_forward=zero,
        fast_gain=first_order_gain(TICK, sensors.fast_time_constant),
        decimation=sensors.decimation,
        window=sensors.window,
    )


# ---------------------------------------------------------------------- a push


def push(speed: float, frequency: float = HAND_FREQUENCY) -> HandParameters:
    """A hand that brings the joint to a speed, away from the near stop, and lets go there.

    Args:
        speed: At which it lets go, the highest of its path, in [rad] / [s].
        frequency: Of the path in [Hz].

    Returns:
        The hand.
    """
    return HandParameters(
        joint=JOINT,
        amplitude=-speed / (math.pi * frequency),
        frequency=frequency,
        release_time=0.25 / frequency,
    )


class Outcome(NamedTuple):
    """What became of a joint after a push.

    Attributes:
        ending: Rest, limit cycle or runaway.
        amplitude: Half the range of the angle at the end in [rad]; of a runaway, since it was let go.
    """

    ending: Ending
    amplitude: float


def outcome(run: BenchRun, span: float = SPAN) -> Outcome:
    """Judge what became of a joint by its motion in the last two spans of a test.

    Args:
        run: A test that ends at the upper stop.
        span: In [s].

    Returns:
        Rest, a limit cycle, or a runaway: a stop was touched.
    """
    angle = run.column("link_angle_rad")
    ticks = round(run.test.duration / TICK)
    early = len(angle) < ticks
    if early or run.status is RunStatus.DIVERGED or run.column("stop_torque_Nm").any():
        return Outcome(Ending.RUNAWAY, 0.5 * float(np.ptp(angle)))
    length = round(span / TICK)
    before, end = angle[-2 * length : -length], angle[-length:]
    return Outcome(*classify(before[:, None], end[:, None], at_stop=False))


# ---------------------------------------------------------------------- a hand that leads


class HandFeeling(NamedTuple):
    """What a hand feels that leads the joint through a whole cycle.

    Attributes:
        rms: Of its torque in [N m].
        friction: RMS of what is left of its torque without inertia and weight, in [N m].
        work: That it does in a cycle in [J]; negative if the joint pushes it.
    """

    rms: float
    friction: float
    work: float


def feeling(test: BenchJoint) -> HandFeeling:
    """Lead the joint by hand and measure the last cycle.

    Args:
        test: The test; hand and duration are put in.

    Returns:
        What the hand feels.
    """
    hand = HandParameters(joint=JOINT, amplitude=HAND_AMPLITUDE, frequency=HAND_FREQUENCY)
    run = simulate_bench(replace(test, hand=hand, duration=HAND_CYCLES / HAND_FREQUENCY))
    cycle = slice(-round(1.0 / HAND_FREQUENCY / TICK), None)
    names = ("hand_torque_Nm", "load_torque_Nm", "motor_acceleration_rad_per_s2", "motor_velocity_rad_per_s")
    torque, load, acceleration, velocity = (run.column(name)[cycle] for name in names)
    left = torque + load + holding_torque(test) - inertia(test) * acceleration
    return HandFeeling(root_mean_square(torque), root_mean_square(left), float(torque @ velocity) * TICK)


def hand_velocity() -> np.ndarray:
    """Velocity of the hand over a cycle in [rad] / [s], one value per tick."""
    time = np.arange(round(1.0 / HAND_FREQUENCY / TICK)) * TICK
    peak = math.pi * HAND_FREQUENCY * HAND_AMPLITUDE
    return np.asarray(peak * np.sin(2.0 * math.pi * HAND_FREQUENCY * time))


# ---------------------------------------------------------------------- thresholds

HIGHEST_GAIN = 2.5
_BISECTIONS = 9


def largest_resting_gain(rests: Callable[[float], bool]) -> float:
    """Bisect for the largest gain at which a joint comes to rest.

    Args:
        rests: Whether it does at a gain.

    Returns:
        The gain, to 0.0025; ``HIGHEST_GAIN`` if it rests there too.
    """
    low, high = 0.0, HIGHEST_GAIN
    if rests(high):
        return high
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rests(middle) else (low, middle)
    return 0.5 * (low + high)


def least_torque_ratio(true: FrictionParameters, model: FrictionParameters, speed: float) -> float:
    """Least ratio of true friction to model from rest up to a speed.

    A free joint that slows down gently passes through all of these speeds; at one at which G is above the
    ratio, the compensator gives more than friction takes.

    Args:
        true: Law of the plant.
        model: Law of the compensator.
        speed: In [rad] / [s].

    Returns:
        The gain from which on a free joint does not come to rest, if the filter is fast.
    """
    return float(torque_ratio(true, model, np.linspace(0.0, speed, 201)).min())
