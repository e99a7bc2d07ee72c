"""What the controller of an experiment knows and may do."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from twin_gait import parameters
from twin_gait.control import Controller, PathParameters
from twin_gait.control.controllers import CONTROLLERS
from twin_gait.control.controllers.assistance import Assistance, AssistanceParameters
from twin_gait.gait.table import TICK
from twin_gait.parameters.quantities import SHARE, Parameters, Range, Ratio, Time, Torque, require
from twin_gait.vocabulary import JointName
from twin_gait.worlds import BENCH_FRICTION

DELAYS = Range(0.0, 0.01, words=f"a multiple of {TICK:g} s from 0 to 0.01 s")

# Which controller decides on k, b, θ0, G and the gravity share.
ControlMode = StrEnum("ControlMode", {name.upper(): name for name in CONTROLLERS})  # type: ignore[misc]

_USUAL = ControlMode("impedance")


@dataclass(frozen=True, kw_only=True)
class ControlParameters(Parameters):
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

    mode: ControlMode = _USUAL
    assistance: AssistanceParameters = field(default_factory=AssistanceParameters)
    path: PathParameters = field(default_factory=PathParameters)
    friction_model: Mapping[JointName, parameters.FrictionParameters] = field(
        default_factory=BENCH_FRICTION.copy
    )
    inertia_compensation: Annotated[Ratio, SHARE] = 0.0
    target_torque: Mapping[JointName, Torque] = field(
        default_factory=lambda: {JointName.HIP: 0.0, JointName.KNEE: 0.0}
    )
    limits: parameters.LimitParameters = field(default_factory=parameters.LimitParameters)
    safety: parameters.SafetyParameters = field(default_factory=parameters.SafetyParameters)
    patient: parameters.Patient | None = None
    delay: Annotated[Time, DELAYS] = 0.0

    def __post_init__(self) -> None:
        """Check the ranges, and that the delay is one of whole ticks."""
        super().__post_init__()
        require(abs(self.delay - self.delay_ticks * TICK) < 1e-9, "delay", DELAYS.expected, self.delay)

    def controller(self, own: Controller | None = None) -> Controller:
        """The controller of the mode, or one of the user's own, with its assistance.

        A controller that ships has for its fields the parameters here of the same name.
        """
        kind = CONTROLLERS[self.mode]
        settings = {name: getattr(self, name) for name in getattr(kind, "__dataclass_fields__", ())}
        acting = kind(**settings) if own is None else own
        return acting if self.assistance.is_full else Assistance(self.assistance, acting)

    @property
    def delay_ticks(self) -> int:
        """Delay in ticks."""
        return round(self.delay / TICK)
