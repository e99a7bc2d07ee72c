"""A test on the joint bench as plain arrays, and where in them everything lies."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]

# What drives the winding.
OPEN, IDEAL, PI, DUTY = 0.0, 1.0, 2.0, 3.0
# What the inertia compensation takes its acceleration from.
ENCODER, GYROSCOPE, ACCELEROMETER = 0.0, 1.0, 2.0

COLUMNS = (
    "time_s",
    "position_rad",
    "target_position_rad",
    "measured_current_A",
    "target_current_A",
    "bus_voltage_V",
    "target_torque_Nm",
    "velocity_rad_per_s",
    "duty",
    "motor_angle_rad",
    "motor_velocity_rad_per_s",
    "motor_acceleration_rad_per_s2",
    "link_angle_rad",
    "link_velocity_rad_per_s",
    "velocity_fast_rad_per_s",
    "velocity_slow_rad_per_s",
    "current_A",
    "voltage_V",
    "impedance_torque_Nm",
    "friction_compensation_torque_Nm",
    "inertia_compensation_torque_Nm",
    "motor_command_torque_Nm",
    "motor_torque_Nm",
    "friction_torque_Nm",
    "gear_loss_torque_Nm",
    "load_torque_Nm",
    "stop_torque_Nm",
    "imposed_motion_torque_Nm",
)

# Positions in a row.
(
    COLUMN_TIME,
    COLUMN_POSITION,
    COLUMN_TARGET_POSITION,
    COLUMN_MEASURED_CURRENT,
    COLUMN_TARGET_CURRENT,
    COLUMN_BUS_VOLTAGE,
    COLUMN_TARGET_TORQUE,
    COLUMN_VELOCITY,
    COLUMN_DUTY,
    COLUMN_MOTOR_ANGLE,
    COLUMN_MOTOR_VELOCITY,
    COLUMN_MOTOR_ACCELERATION,
    COLUMN_LINK_ANGLE,
    COLUMN_LINK_VELOCITY,
    COLUMN_VELOCITY_FAST,
    COLUMN_VELOCITY_SLOW,
    COLUMN_CURRENT,
    COLUMN_VOLTAGE,
    COLUMN_IMPEDANCE_TORQUE,
    COLUMN_FRICTION_COMPENSATION_TORQUE,
    COLUMN_INERTIA_COMPENSATION_TORQUE,
    COLUMN_MOTOR_COMMAND_TORQUE,
    COLUMN_MOTOR_TORQUE,
    COLUMN_FRICTION_TORQUE,
    COLUMN_GEAR_LOSS_TORQUE,
    COLUMN_LOAD_TORQUE,
    COLUMN_STOP_TORQUE,
    COLUMN_HAND_TORQUE,
) = range(len(COLUMNS))

# Positions in the numbers of a test, which do not change.
(
    PERIOD,
    LOOP_PERIOD,
    LOOPS,
    FAST_GAIN,
    DECIMATION,
    MODE,
    TORQUE_CONSTANT,
    GEAR_RATIO,
    GEAR_EFFICIENCY,
    RESISTANCE,
    INDUCTANCE,
    POLE_PAIRS,
    CURRENT_RIPPLE,
    CURRENT_NOISE,
    CURRENT_OFFSET,
    CURRENT_RESOLUTION,
    PROPORTIONAL_GAIN,
    INTEGRAL_GAIN,
    COUNTS,
    BATTERY_VOLTAGE,
    BATTERY_RESISTANCE,
    TORQUE_LIMIT,
    CURRENT_LIMIT,
    MOTOR_INERTIA,
    LINK_INERTIA,
    LINK_MOMENT,
    GRAVITY,
    HORIZONTAL_ANGLE,
    STOP_LOWER,
    STOP_UPPER,
    STOP_STIFFNESS,
    STOP_DISSIPATION,
    TORSION_STIFFNESS,
    TORSION_DAMPING,
    FRICTION_A,
    FRICTION_B,
    FRICTION_C,
    FRICTION_D,
    CONDITIONED,
    COULOMB_PER_LOAD,
    COULOMB_PER_KELVIN,
    VISCOUS_PER_KELVIN,
    FRICTION_TEMPERATURE,
    RIPPLE_COSINE,
    RIPPLE_SINE,
    RIPPLE_ORDER,
    LOSSY,
    GEAR_TEMPERATURE,
    EFFICIENCY_0,
    EFFICIENCY_1,
    EFFICIENCY_2,
    EFFICIENCY_3,
    EFFICIENCY_4,
    EFFICIENCY_5,
    LOSS_VELOCITY,
    IMPOSED_MOTION_START,
    IMPOSED_MOTION_AMPLITUDE,
    IMPOSED_MOTION_FREQUENCY,
    IMPOSED_MOTION_STIFFNESS,
    IMPOSED_MOTION_DAMPING,
    IMPOSED_MOTION_RELEASE,
    OLD_MODEL,
    MODEL_A,
    MODEL_B,
    MODEL_C,
    MODEL_D,
    COMPENSATION_GAIN,
    FOLLOWS_REFERENCE,
    DEAD_ZONE,
    TARGET_TORQUE,
    STIFFNESS,
    DAMPING,
    EQUILIBRIUM,
    INERTIA_SHARE,
    UNIT,
    UNIT_LEVER,
    UNIT_NOISE,
    UNIT_GAIN,
    PATH_AMPLITUDE,
    PATH_FREQUENCY,
    DUTY_AMPLITUDE,
    DUTY_FREQUENCY,
    DUTY_STEPS,
    DUTY_START,
    LOWEST_VELOCITY,
    TRANSPARENCY_GAIN,
    P0,
    P1,
    P2,
    DUTY_LIMIT,
    REST_TICKS,
    DIVERGED_VELOCITY,
) = range(92)
NUMBER_COUNT = DIVERGED_VELOCITY + 1

# Positions in the state, which a test changes.
(
    MOTOR_ANGLE,
    MOTOR_VELOCITY,
    LINK_ANGLE,
    LINK_VELOCITY,
    CURRENT,
    MEAN_CURRENT,
    INTEGRAL,
    VOLTAGE,
    SAMPLE,
    BUS_VOLTAGE,
    ENERGY,
    TARGET_CURRENT,
    DUTY_SHARE,
    RATE,
    LAST_SAMPLE,
    LAST_FAST,
    LAST_ANGLE,
    STOP_TICKS,
    DIVERGED,
) = range(19)
STATE_COUNT = DIVERGED + 1


class BenchArrays(NamedTuple):
    """A test on the joint bench as plain arrays.

    Attributes:
        numbers: See the positions above, shape ``(NUMBER_COUNT,)``.
        state: See the positions above, shape ``(STATE_COUNT,)``; changed in place.
        angles: Room for the motor angle, shape ``(1,)``.
        resolution: Encoder resolution in [rad], shape ``(1,)``.
        measured: Angle, fast and slow velocity, shape ``(1, 3)``.
        decimated_angle: Shape ``(1,)``.
        ring: Slow samples, shape ``(window, 1)``.
        delayed: Samples of the current that are under way, shape ``(delay + 1,)``.
        encoder_noise: Of every tick in [rad], shape ``(n_ticks,)``.
        loop_noise: Of every period of the current loop, standard normal, shape ``(n_ticks * loops,)``.
        inertial: Samples of the inertial unit that are under way, shape ``(delay + 1,)``.
        inertial_noise: Of every tick, standard normal, shape ``(n_ticks,)``; empty without a unit.
    """

    numbers: Array
    state: Array
    angles: Array
    resolution: Array
    measured: Array
    decimated_angle: Array
    ring: Array
    delayed: Array
    encoder_noise: Array
    loop_noise: Array
    inertial: Array
    inertial_noise: Array
