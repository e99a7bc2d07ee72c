"""What the controller of an experiment knows and may do."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from twin_gait.gait.table import TICK
from twin_gait.parameters import (
    HIP_FRICTION,
    KNEE_FRICTION,
    FrictionParameters,
    LimitParameters,
    Patient,
    SafetyParameters,
    require,
    require_non_negative,
    require_share,
)
from twin_gait.vocabulary import JointName

LONGEST_DELAY = 0.01  # [s]
# In the mode ``position``, whose path was found on TWIN (twin_gait.experiment.path).
PATH_JOINTS = (JointName.HIP, JointName.KNEE)


class ControlMode(StrEnum):
    """Where k, b, θ0, G and the gravity share come from."""

    IMPEDANCE = "impedance"  # the phases of the gait table
    TRANSPARENT = "transparent"  # G and gravity shares of the table, no impedance
    GRAVITY = "gravity"  # gravity carried in full and G of the table, no impedance (TWIN's gravity mode)
    CONSTANT = "constant"  # one impedance for the whole stride: the mean of the table's
    POSITION = "position"  # a stiff spring that follows a predetermined path (TWIN's walk mode)


@dataclass(frozen=True, kw_only=True)
class AssistanceParameters:
    """How much of the impedance the legs are given.

    Attributes:
        share: Of k and b per joint, 0 to 1 (TwinCare's assistance); where adaptive, at the start.
        adaptive: Whether the share of each joint changes from stride to stride, see
            :func:`twin_gait.core.assistance.adapted_assistance`.
        forgetting: f (assumption: assistance halves in seven strides without an error).
        gain: g in 1 / [rad] (assumption: an error of 10° beyond the allowance keeps full assistance).
        allowance: e_0 in [rad] (assumption: somewhat below the error of the shipped gait).
        least: α_min (assumption).
    """

    share: Mapping[JointName, float] = field(
        default_factory=lambda: {JointName.HIP: 1.0, JointName.KNEE: 1.0}
    )
    adaptive: bool = False
    forgetting: float = 0.9
    gain: float = 0.6
    allowance: float = math.radians(4.0)
    least: float = 0.2

    def __post_init__(self) -> None:
        """Check the ranges."""
        for joint, share in self.share.items():
            require_share(f"assistance share of the {joint}", share)
        require_share("assistance forgetting", self.forgetting)
        require_non_negative("assistance gain", self.gain)
        require_non_negative("assistance allowance", self.allowance)
        require_share("assistance least", self.least)

    @property
    def is_full(self) -> bool:
        """Whether the impedance is given as it is."""
        return not self.adaptive and all(share == 1.0 for share in self.share.values())


@dataclass(frozen=True, kw_only=True)
class PathParameters:
    """Spring and damper that follow the predetermined path in the mode ``position``.

    Attributes:
        stiffness: In [N m] / [rad], per joint (assumption: the hip stiffer than in any phase of the shipped
            table, so that the default wearer follows to 2°; the knee to 6° with 4 N m/deg, where the limits
            cut 2 % of the ticks; with 7 it would be 4° and four times as many).
        damping_ratio: ζ of the joint on this spring.
        friction_compensation_gain: G.
        gravity_compensation: Share of gravity compensation.
    """

    stiffness: Mapping[JointName, float] = field(
        default_factory=lambda: {JointName.HIP: math.degrees(9.0), JointName.KNEE: math.degrees(4.0)}
    )
    damping_ratio: float = 0.7
    friction_compensation_gain: float = 0.35
    gravity_compensation: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        for joint, stiffness in self.stiffness.items():
            require_non_negative(f"path stiffness of the {joint}", stiffness)
        require_non_negative("path damping_ratio", self.damping_ratio)
        require_share("path friction_compensation_gain", self.friction_compensation_gain)
        require_share("path gravity_compensation", self.gravity_compensation)


@dataclass(frozen=True, kw_only=True)
class ControlParameters:
    """What the controller knows and may do.

    Attributes:
        mode: Where the parameters of the joints come from.
        assistance: How much of the impedance the legs are given.
        path: Of the mode ``position``.
        friction_model: The compensator's own friction model (thesis, table 3.1).
        inertia_compensation: Gain g_in of the inertia term; off by default, because a differentiated
            encoder is noisy (thesis 2.4.2).
        target_torque: Added to the command in [N m] (thesis, equation 2.16).
        limits: Of torque and current.
        safety: The monitor between controller and motor.
        patient: The wearer that gravity compensation assumes; None takes the true one.
        delay: From a measurement to the current that answers it, in [s], a whole number of ticks; 0 for a
            firmware that answers within the tick. Nothing is asked of the drives before the first command
            arrives; what holds a leg after a trip comes as late.
    """

    mode: ControlMode = ControlMode.IMPEDANCE
    assistance: AssistanceParameters = field(default_factory=AssistanceParameters)
    path: PathParameters = field(default_factory=PathParameters)
    friction_model: Mapping[JointName, FrictionParameters] = field(
        default_factory=lambda: {JointName.HIP: HIP_FRICTION, JointName.KNEE: KNEE_FRICTION}
    )
    inertia_compensation: float = 0.0
    target_torque: Mapping[JointName, float] = field(
        default_factory=lambda: {JointName.HIP: 0.0, JointName.KNEE: 0.0}
    )
    limits: LimitParameters = field(default_factory=LimitParameters)
    safety: SafetyParameters = field(default_factory=SafetyParameters)
    patient: Patient | None = None
    delay: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_share("inertia_compensation", self.inertia_compensation)
        require(
            0.0 <= self.delay <= LONGEST_DELAY and abs(self.delay - self.delay_ticks * TICK) < 1e-9,
            "delay",
            f"a multiple of {TICK:g} s from 0 to {LONGEST_DELAY:g} s",
            self.delay,
        )

    @property
    def delay_ticks(self) -> int:
        """Delay in ticks."""
        return round(self.delay / TICK)
