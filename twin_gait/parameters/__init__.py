"""Frozen parameters in SI units, checked when they are made.

Every number that a user can change lives in one of these dataclasses, with its source beside it.
"""

from twin_gait.parameters.checks import (
    require,
    require_count,
    require_non_negative,
    require_positive,
    require_share,
)
from twin_gait.parameters.drives import (
    HARD_TORQUE_LIMIT,
    HIP_ACTUATOR,
    KNEE_ACTUATOR,
    ActuatorParameters,
    BatteryParameters,
    LimitParameters,
    SensorParameters,
)
from twin_gait.parameters.friction import (
    HIGHEST_LOAD_FRICTION,
    HIP_FRICTION,
    KNEE_FRICTION,
    FrictionParameters,
)
from twin_gait.parameters.safety import SafetyParameters
from twin_gait.parameters.surroundings import (
    AnkleParameters,
    BeltProfile,
    BraceParameters,
    ContactParameters,
    SpringDamper,
    StopParameters,
    SupportParameters,
)
from twin_gait.parameters.wearer import HEAVIEST_WEARER, JointCondition, Patient

__all__ = [
    "HARD_TORQUE_LIMIT",
    "HEAVIEST_WEARER",
    "HIGHEST_LOAD_FRICTION",
    "HIP_ACTUATOR",
    "HIP_FRICTION",
    "KNEE_ACTUATOR",
    "KNEE_FRICTION",
    "ActuatorParameters",
    "AnkleParameters",
    "BatteryParameters",
    "BeltProfile",
    "BraceParameters",
    "ContactParameters",
    "FrictionParameters",
    "JointCondition",
    "LimitParameters",
    "Patient",
    "SafetyParameters",
    "SensorParameters",
    "SpringDamper",
    "StopParameters",
    "SupportParameters",
    "require",
    "require_count",
    "require_non_negative",
    "require_positive",
    "require_share",
]
