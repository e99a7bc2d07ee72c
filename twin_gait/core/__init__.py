"""The laws, each once: pure typed functions on plain numbers and arrays.

Nothing here imports anything but :mod:`math` and :mod:`numpy`, keeps state, reads a clock or draws
a random number. The Pinocchio engine calls these functions as Python; the compiled engine registers
the very same functions with numba from outside, so there is no second copy of a law to drift.
Scalars use :mod:`math` and plain products, because numpy's tanh and powers differ in the last bit.
"""

from twin_gait.core.estimation import first_order_gain
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.friction_models import coulomb_viscous_tanh_torque
from twin_gait.core.impedance import damping_from_ratio
from twin_gait.core.motor_drive import breakaway_duty, drive_efficiency, viscous_duty

__all__ = [
    "breakaway_duty",
    "coulomb_viscous_tanh_torque",
    "damping_from_ratio",
    "drive_efficiency",
    "first_order_gain",
    "rotational_friction_torque",
    "viscous_duty",
]
