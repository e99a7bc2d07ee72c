"""The tests behind the figures of the controllers, and what is read from their logs.

The thesis prints G, k and θ0 of these tests, but neither the path nor the speed of the hand. All tests here
stay within what it does print: the range of the knee, and the fastest velocity of its friction figures.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from twin_gait.checking.hanging_leg import friction_torque
from twin_gait.control import Controller
from twin_gait.core.actuator import current_to_torque
from twin_gait.core.motor_drive import current_loop_gains
from twin_gait.scenario.bench_joint import (
    BENCH_FRICTION,
    BenchFriction,
    BenchJoint,
    CurrentLoop,
    LinkParameters,
    TorqueControl,
    bench_joint,
)
from twin_gait.scenario.bench_leg import HandParameters
from twin_gait.simulation.bench_joint import TICK, BenchRun
from twin_gait.vocabulary import JointName

KNEE = JointName.KNEE
MODEL = BENCH_FRICTION[KNEE]  # of the compensator: table 3.1

# Thesis, chapter 4: G was set between 0.20 and 0.60, beyond that the joint is unstable. It becomes so when G
# reaches the ratio s of true to modelled friction, hence this s: calibrated, like all that follows from it.
USABLE_GAINS = (0.20, 0.60)
FRICTION_RATIO = USABLE_GAINS[1]
GAINS = (0.35, 0.40, 0.45)  # of figure 3.7
STIFFNESS_PER_DEG = 0.05  # k in [N m] / [deg] (thesis 2.4)
MEASURED_SLOPE = 0.0493  # in [N m] / [deg] (thesis 3.6)
EQUILIBRIUM = math.radians(60.0)  # θ0 of the knee (thesis 2.4)
# Greatest velocity of the hand in [rad] / [s]: the middle and the end of the axis of figures 3.2 and 3.3. The
# first is used where one will do.
HAND_VELOCITIES = (0.3, 0.6)
# The range of the knee is -4° to 122° (thesis 2.4), 63° to either side; 7° are left before the stops.
REACH = math.radians(56.0)
SHORT_REACH = math.radians(20.0)  # the bench's usual path, 40° there and back


def frequency_of(reach: float, fastest: float = HAND_VELOCITIES[0]) -> float:
    """Frequency of a path that swings so far to either side and is so fast in its middle.

    Args:
        reach: Half of the path in [rad].
        fastest: Velocity in the middle in [rad] / [s].

    Returns:
        In [Hz].
    """
    return fastest / (2.0 * math.pi * reach)


def torque_control(gain: float, *, stiffness: float = 0.0) -> TorqueControl:
    """Friction compensation (2.16), or impedance control (2.18) if there is a stiffness.

    Args:
        gain: G.
        stiffness: k in [N m] / [rad].

    Returns:
        The controller.
    """
    return TorqueControl(
        controller=Controller(friction_model=MODEL),
        friction_compensation_gain=gain,
        stiffness=stiffness,
        equilibrium_angle=EQUILIBRIUM,
    )


def knee_test(control: TorqueControl, *, ratio: float = FRICTION_RATIO, **changes: object) -> BenchJoint:
    """The knee without a weight, so that friction and spring are alone.

    Args:
        control: Controller.
        ratio: s, true friction over table 3.1.
        changes: Other attributes of :class:`BenchJoint` that differ.

    Returns:
        The test.
    """
    chosen: dict[str, object] = {
        "friction": BenchFriction(law=MODEL.scaled(ratio)),
        "link": LinkParameters(mass=0.0),
        "control": control,
        **changes,
    }
    return bench_joint(KNEE, **chosen)


def led_by_hand(
    control: TorqueControl,
    *,
    reach: float = REACH,
    fastest: float = HAND_VELOCITIES[0],
    ratio: float = FRICTION_RATIO,
    periods: float = 2.0,
) -> BenchJoint:
    """A hand leads the knee to and fro about θ0, from the side of flexion.

    Args:
        control: Controller.
        reach: To either side in [rad].
        fastest: Velocity at θ0 in [rad] / [s].
        ratio: s.
        periods: How often; the first one holds the start.

    Returns:
        The test.
    """
    frequency = frequency_of(reach, fastest)
    return knee_test(
        control,
        ratio=ratio,
        start_angle=EQUILIBRIUM + reach,
        hand=HandParameters(amplitude=-2.0 * reach, frequency=frequency),
        duration=periods / frequency,
    )


def pushed_and_let_go(control: TorqueControl, *, ratio: float = FRICTION_RATIO) -> BenchJoint:
    """A hand pushes the knee away from θ0 into extension and lets go at the end of its way.

    Args:
        control: Controller.
        ratio: s.

    Returns:
        The test: half a period of the hand, then 12 s without it.
    """
    frequency = frequency_of(REACH)
    way = 0.5 / frequency
    return knee_test(
        control,
        ratio=ratio,
        start_angle=EQUILIBRIUM,
        hand=HandParameters(amplitude=-REACH, frequency=frequency, release_time=way),
        duration=way + 12.0,
    )


def with_ideal_current(test: BenchJoint) -> BenchJoint:
    """The same test with a current that follows at once, stepped once a tick; twenty times faster."""
    drive = replace(test.drive, loop=CurrentLoop.IDEAL, rate=1.0 / TICK, noise=0.0, ripple=0.0, delay=0)
    return replace(test, drive=drive)


def last_period(run: BenchRun) -> slice:
    """Rows of the last period of the hand, shape of a slice; the first holds the start from rest.

    Args:
        run: A test with a hand that never lets go.

    Returns:
        The rows.
    """
    hand = run.test.hand
    assert hand is not None
    return slice(len(run.rows) - round(1.0 / (hand.frequency * TICK)), len(run.rows))


def electromechanical_torque(run: BenchRun, column: str = "target_current_A") -> np.ndarray:
    """T_em = K_t τ I of a log in [N m], I being the target current of the log as in the thesis (2.12).

    Args:
        run: The test.
        column: Another current in [A].

    Returns:
        Shape ``(n_ticks,)``.
    """
    motor, current = run.test.actuator, run.column(column)
    per_ampere = current_to_torque(1.0, motor.torque_constant, motor.gear_ratio, motor.gear_efficiency)
    return np.asarray(per_ampere * current)


def work(run: BenchRun, torque: np.ndarray, rows: slice) -> float:
    """Area of the loop of a torque over the angle, the work that it does, in [J].

    Args:
        run: The test.
        torque: In [N m], shape ``(n_ticks,)``.
        rows: A whole period.

    Returns:
        Positive if the torque drives the joint.
    """
    return float(np.sum(torque[rows] * run.column("motor_velocity_rad_per_s")[rows]) * TICK)


def slope_per_deg(run: BenchRun, torque: np.ndarray, rows: slice) -> float:
    """Linear regression of a restoring torque over the angle, with its sign turned.

    Args:
        run: The test.
        torque: In [N m], shape ``(n_ticks,)``.
        rows: A whole period.

    Returns:
        In [N m] / [deg].
    """
    angle = np.degrees(run.column("position_rad")[rows])
    return -float(np.polyfit(angle, torque[rows], 1)[0])


def model_torque(velocity: np.ndarray) -> np.ndarray:
    """Friction torque of the compensator's model, equation (3.1) with table 3.1.

    Args:
        velocity: In [rad] / [s], shape ``(n,)``.

    Returns:
        In [N m], shape ``(n,)``.
    """
    return np.array([friction_torque(MODEL, float(value)) for value in velocity])


def lag_of_current_loop(test: BenchJoint) -> float:
    r"""Current that the PI loop lacks per joint acceleration, in [A s²] / [rad].

    At a constant acceleration :math:`\alpha` the back-EMF is a ramp, after which an integral gain
    :math:`K_i` runs with the steady error :math:`K_e \tau \alpha / K_i`.

    Args:
        test: Its motor and drive.

    Returns:
        The lag.
    """
    motor, drive = test.actuator, test.drive
    _, integral = current_loop_gains(motor.resistance, drive.inductance, drive.bandwidth)
    return motor.torque_constant * motor.gear_ratio / integral
