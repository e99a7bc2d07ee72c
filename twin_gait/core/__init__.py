"""The laws, each once: pure typed functions on plain numbers and arrays.

Nothing here imports anything but :mod:`math` and :mod:`numpy`, keeps state, reads a clock or draws
a random number. The reference engine calls these functions as plain Python, and the compiled engine compiles
the very same ones, so there is no second copy of a law to drift. Exponentials, sines and cosines are those of
:mod:`twin_gait.core.elementary`, squares are plain products: NumPy's and the C library's differ in the last
bit from one version and machine to the next.
"""

from twin_gait.core.actuator import (
    battery_power,
    current_to_torque,
    motor_electrical_power,
    sagged_bus_voltage,
    torque_to_current,
    voltage_limited_current,
)
from twin_gait.core.assistance import adapted_assistance
from twin_gait.core.belt import belt_speed, belt_travel, treadmill_speed, treadmill_travel
from twin_gait.core.blending import blend, blend_share
from twin_gait.core.contact import (
    anchored_friction_force,
    contact_friction_force,
    contact_normal_force,
    dragged_anchor,
    ground_contact_force,
    mechanical_stop_torque,
)
from twin_gait.core.dead_zone import dead_zone
from twin_gait.core.elementary import exponential, hyperbolic_tangent, settled_share, sine_cosine
from twin_gait.core.estimation import first_order_gain, first_order_step, quantise
from twin_gait.core.friction import (
    PlantFriction,
    advanced_deflection,
    friction_torque,
    gear_loss_torque,
    geared_friction_torque,
    rotational_friction_torque,
    steady_deflection,
)
from twin_gait.core.friction_models import (
    asymmetric_torque,
    bristle_rate,
    bristle_step,
    conditioned_torque,
    coulomb_viscous_tanh_torque,
    coulomb_viscous_torque,
    directional_viscous_torque,
    lugre_torque,
    ripple_torque,
    stribeck_level,
    stribeck_torque,
    two_velocity_torque,
)
from twin_gait.core.impedance import damping_from_ratio, damping_ratio_of, impedance_torque
from twin_gait.core.inertial import angular_acceleration, tangential_specific_force
from twin_gait.core.motor_drive import drive_efficiency
from twin_gait.core.transparency import breakaway_duty, viscous_duty
from twin_gait.core.wearer import passive_hip_torque, passive_knee_torque, spastic_torque

__all__ = [
    "PlantFriction",
    "adapted_assistance",
    "advanced_deflection",
    "anchored_friction_force",
    "angular_acceleration",
    "asymmetric_torque",
    "battery_power",
    "belt_speed",
    "belt_travel",
    "blend",
    "blend_share",
    "breakaway_duty",
    "bristle_rate",
    "bristle_step",
    "conditioned_torque",
    "contact_friction_force",
    "contact_normal_force",
    "coulomb_viscous_tanh_torque",
    "coulomb_viscous_torque",
    "current_to_torque",
    "damping_from_ratio",
    "damping_ratio_of",
    "dead_zone",
    "directional_viscous_torque",
    "dragged_anchor",
    "drive_efficiency",
    "exponential",
    "first_order_gain",
    "first_order_step",
    "friction_torque",
    "gear_loss_torque",
    "geared_friction_torque",
    "ground_contact_force",
    "hyperbolic_tangent",
    "impedance_torque",
    "lugre_torque",
    "mechanical_stop_torque",
    "motor_electrical_power",
    "passive_hip_torque",
    "passive_knee_torque",
    "quantise",
    "ripple_torque",
    "rotational_friction_torque",
    "sagged_bus_voltage",
    "settled_share",
    "sine_cosine",
    "spastic_torque",
    "steady_deflection",
    "stribeck_level",
    "stribeck_torque",
    "tangential_specific_force",
    "torque_to_current",
    "treadmill_speed",
    "treadmill_travel",
    "two_velocity_torque",
    "viscous_duty",
    "voltage_limited_current",
]
