"""A share of the impedance of another controller: fixed, or adapted to the tracking error."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from twin_gait.control.controller import (
    Controller,
    Plan,
    ReferencePath,
    StrideClock,
    TickFunction,
    begin_stride,
    find_cycle_interval,
    stride_progress,
)
from twin_gait.control.gait_controller import N_JOINTS_PER_LEG, ControllerState
from twin_gait.parameters.quantities import NOT_NEGATIVE, SHARE, Angle, Inline, Parameters, PerAngle, Ratio
from twin_gait.vocabulary import JointName

# Build flags: whether the shares change from stride to stride, and whether the other controller has a tick.
WITH_ADAPTATION = WITH_ASSISTED_TICK = False


@dataclass(frozen=True, kw_only=True)
class AssistanceParameters(Parameters):
    """Share of the impedance that the legs receive.

    Attributes:
        share: Share of k and b per joint, 0 to 1 (TwinCare's assistance); if adaptive, the initial share.
        adaptive: Whether the share of each joint changes from stride to stride, see
            :func:`~twin_gait.control.controllers.assistance.adapted_assistance`.
        forgetting_factor: Forgetting factor f (assumption: assistance halves in seven strides without an
            error).
        gain: Gain g in 1 / [rad] (assumption: an error of 10° beyond the deadband keeps full assistance).
        error_deadband: Error deadband e_0 in [rad] (assumption: somewhat below the error of the shipped
            gait).
        min_assistance: Minimum assistance α_min (assumption).
    """

    share: Annotated[Mapping[JointName, Ratio], SHARE, Inline()] = field(
        default_factory=lambda: {JointName.HIP: 1.0, JointName.KNEE: 1.0}
    )
    adaptive: bool = False
    forgetting_factor: Annotated[Ratio, SHARE] = 0.9
    gain: Annotated[PerAngle, NOT_NEGATIVE] = 0.6
    error_deadband: Annotated[Angle, NOT_NEGATIVE] = math.radians(4.0)
    min_assistance: Annotated[Ratio, SHARE] = 0.2

    @property
    def is_full(self) -> bool:
        """Whether all shares are fixed at 1, so that the impedance is unchanged."""
        return not self.adaptive and all(share == 1.0 for share in self.share.values())


def adapted_assistance(settings: AssistanceParameters, assistance: float, error: float) -> float:
    r"""Compute the assistance level for the next stride from the tracking error of the last one.

    :math:`\alpha_{n+1} = f\,\alpha_n + g\,\max(0, e_n - e_0), \qquad \alpha_{min} \le \alpha \le 1`

    with the mean absolute error e_n in [rad]. Assistance decays by the factor f and increases again if the
    error is larger than the deadband, after J. L. Emken, J. E. Bobrow, D. J. Reinkensmeyer: Robotic movement
    training as an optimization problem, IEEE ICORR (2005) 307-312.
    """
    excess = max(0.0, error - settings.error_deadband)
    level = settings.forgetting_factor * assistance + settings.gain * excess
    return min(1.0, max(settings.min_assistance, level))


@dataclass(slots=True)
class AssistedJoint:
    """State of the assistance of a joint."""

    share: float  # Share of k and b that the joint receives.
    tracking: float = 0.0  # Sum of the absolute tracking errors of the stride in [rad].


@dataclass(slots=True)
class AssistanceMemory:
    """State of the assistance."""

    other: object  # Memory of the controller whose impedance is scaled.
    assisted: list[AssistedJoint]  # Joints, leg by leg: left hip, left knee, right hip, …
    strides: list[StrideClock]  # Strides of the legs; empty if the shares are fixed.
    path: ReferencePath  # Reference of the tracking error; empty if the shares are fixed.
    settings: AssistanceParameters


def assisted_tick(memory: Any, device: Any, tick: int, period: float) -> None:
    """Run the tick of the other controller; see :class:`twin_gait.control.controller.Controller`."""
    raise NotImplementedError


def assistance_tick(memory: AssistanceMemory, device: ControllerState, tick: int, period: float) -> None:
    """Run the other controller, adapt the shares at the end of a stride, and apply them."""
    if WITH_ASSISTED_TICK:
        assisted_tick(memory.other, device, tick, period)
    if WITH_ADAPTATION:
        for number in range(len(device.legs)):
            leg = device.legs[number]
            if tick > 0 and leg.phase == 0 and leg.entry_tick == tick:
                _end_stride(memory, number, tick)
            _add_errors(memory, device, number, tick)
    for number in range(len(device.joints)):
        setpoint, share = device.joints[number].setpoint, memory.assisted[number].share
        setpoint.stiffness *= share
        setpoint.damping *= share


class Assistance(Controller):
    """A share of the impedance of another controller, which provides everything else."""

    tick = staticmethod(assistance_tick)

    def __init__(self, parameters: AssistanceParameters, other: Controller) -> None:
        """Take the shares from ``parameters``, and everything not defined here from the other controller."""
        self.parameters, self.other = parameters, other
        for name in ("phase_driven", "check_joints", "setpoints", "initial_angles", "reference_path"):
            setattr(self, name, getattr(other, name))
        adaptive = "control.assistance.adaptive: true is not in the firmware; set false, and a share"
        self.unprinted_reason = other.unprinted_reason or (adaptive if parameters.adaptive else "")

    @property
    def name(self) -> str:
        """Name of the other controller."""
        return self.other.name

    def initial_memory(self, plan: Plan) -> AssistanceMemory:
        """Return the memory of the other controller, the shares, and the reference of the tracking error."""
        settings = self.parameters
        path = self.reference_path(plan) if settings.adaptive else ReferencePath([], 0, [])
        shares = [settings.share.get(JointName(name), 1.0) for _ in plan.sides for name in plan.joints]
        assisted = [AssistedJoint(share) for share in shares]
        strides = [StrideClock(path.cycle_ticks, start) for start in path.starts]
        return AssistanceMemory(self.other.initial_memory(plan), assisted, strides, path, settings)

    def build_flags(self) -> dict[str, int]:
        """Return the build flags, including whether the shares adapt."""
        acts = self.other.tick is not None
        return {
            **super().build_flags(),
            "WITH_ADAPTATION": self.parameters.adaptive,
            "WITH_ASSISTED_TICK": acts,
        }

    def tick_functions(self) -> dict[str, TickFunction]:
        """Return the functions, including the tick of the other controller."""
        other = {} if self.other.tick is None else {"assisted_tick": self.other.tick}
        return {**super().tick_functions(), **other}


def _add_errors(memory: AssistanceMemory, device: ControllerState, number: int, tick: int) -> None:
    """Add the tracking errors of this tick to those of a leg's stride."""
    angles = memory.path.angles
    before, share = find_cycle_interval(stride_progress(memory.strides[number], tick), len(angles))
    for position in range(N_JOINTS_PER_LEG):
        index = number * N_JOINTS_PER_LEG + position
        start = angles[before][position]
        reference = start + share * (angles[before + 1][position] - start)
        memory.assisted[index].tracking += abs(device.joints[index].measurement.angle - reference)


def _end_stride(memory: AssistanceMemory, number: int, tick: int) -> None:
    """Adapt the shares of one leg to the errors of its last stride."""
    duration = begin_stride(memory.strides[number], tick)
    for index in range(number * N_JOINTS_PER_LEG, (number + 1) * N_JOINTS_PER_LEG):
        joint = memory.assisted[index]
        joint.share = adapted_assistance(memory.settings, joint.share, joint.tracking / duration)
        joint.tracking = 0.0
