"""A share of the impedance that another controller asks for: fixed, or as much as is needed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from twin_gait.control.controller import Controller, Path, Plan, TickFunction, cycle_place
from twin_gait.control.gait_controller import JOINTS_PER_LEG, ControllerState
from twin_gait.parameters.quantities import NOT_NEGATIVE, SHARE, Angle, Inline, Parameters, PerAngle, Ratio
from twin_gait.vocabulary import JointName

# What a loop is bound to: whether the shares change from stride to stride, and the other controller has a
# tick.
ADAPTS = ASSISTED_ACTS = False


@dataclass(frozen=True, kw_only=True)
class AssistanceParameters(Parameters):
    """How much of the impedance the legs are given.

    Attributes:
        share: Of k and b per joint, 0 to 1 (TwinCare's assistance); where adaptive, at the start.
        adaptive: Whether the share of each joint changes from stride to stride, see
            :func:`~twin_gait.control.controllers.assistance.adapted_assistance`.
        forgetting: f (assumption: assistance halves in seven strides without an error).
        gain: g in 1 / [rad] (assumption: an error of 10° beyond the allowance keeps full assistance).
        allowance: e_0 in [rad] (assumption: somewhat below the error of the shipped gait).
        least: α_min (assumption).
    """

    share: Annotated[Mapping[JointName, Ratio], SHARE, Inline()] = field(
        default_factory=lambda: {JointName.HIP: 1.0, JointName.KNEE: 1.0}
    )
    adaptive: bool = False
    forgetting: Annotated[Ratio, SHARE] = 0.9
    gain: Annotated[PerAngle, NOT_NEGATIVE] = 0.6
    allowance: Annotated[Angle, NOT_NEGATIVE] = math.radians(4.0)
    least: Annotated[Ratio, SHARE] = 0.2

    @property
    def is_full(self) -> bool:
        """Whether the impedance is given as it is."""
        return not self.adaptive and all(share == 1.0 for share in self.share.values())


def adapted_assistance(settings: AssistanceParameters, assistance: float, error: float) -> float:
    r"""Assistance level for the next stride, after the tracking error of the last one.

    :math:`\alpha_{n+1} = f\,\alpha_n + g\,\max(0, e_n - e_0), \qquad \alpha_{min} \le \alpha \le 1`

    with the mean absolute error e_n in [rad]. Assistance decays by the factor f and comes back where tracking
    is worse than the allowance, after J. L. Emken, J. E. Bobrow, D. J. Reinkensmeyer: Robotic movement
    training as an optimization problem, IEEE ICORR (2005) 307-312.
    """
    excess = max(0.0, error - settings.allowance)
    wanted = settings.forgetting * assistance + settings.gain * excess
    return min(1.0, max(settings.least, wanted))


@dataclass(slots=True)
class AssistedJoint:
    """A joint that is assisted."""

    share: float  # of k and b that it is given
    tracking: float = 0.0  # sum of the absolute errors of the stride in [rad]


@dataclass(slots=True)
class AssistedLeg:
    """The stride of a leg that is assisted."""

    stride_ticks: int  # length of the last stride
    stride_start: int = 0  # tick in which its stride began


@dataclass(slots=True)
class AssistanceMemory:
    """What assistance keeps."""

    other: object  # memory of the controller whose impedance is shared
    assisted: list[AssistedJoint]  # leg by leg: left hip, left knee, right hip, …
    strides: list[AssistedLeg]  # of the legs; none where the shares stay
    path: Path  # against which the error is measured; none where the shares stay
    settings: AssistanceParameters


def assisted_tick(memory: Any, device: Any, tick: int, period: float) -> None:
    """Tick of the other controller; see :class:`twin_gait.control.Controller`."""
    raise NotImplementedError


def assist(memory: AssistanceMemory, device: ControllerState, tick: int, period: float) -> None:
    """Let the other controller act, adapt the shares at the end of a stride, and apply them."""
    if ASSISTED_ACTS:
        assisted_tick(memory.other, device, tick, period)
    if ADAPTS:
        for number in range(len(device.legs)):
            leg = device.legs[number]
            if tick > 0 and leg.phase == 0 and leg.entry_tick == tick:
                _end_stride(memory, number, tick)
            _add_errors(memory, device, number, tick)
    for number in range(len(device.joints)):
        asked, share = device.joints[number].demand, memory.assisted[number].share
        asked.stiffness *= share
        asked.damping *= share


class Assistance(Controller):
    """A share of the impedance that another controller asks for; in all else it is that controller."""

    tick = staticmethod(assist)

    def __init__(self, parameters: AssistanceParameters, other: Controller) -> None:
        """Take ``parameters`` for the shares, and all that is not said here from the other controller."""
        self.parameters, self.other = parameters, other
        for name in ("by_phases", "refusal", "setpoints", "start", "walk"):
            setattr(self, name, getattr(other, name))
        adaptive = "control.assistance.adaptive: true is not printed; set false, and a share"
        self.unprinted = other.unprinted or (adaptive if parameters.adaptive else "")

    @property
    def name(self) -> str:
        """That of the other controller."""
        return self.other.name

    def memory(self, plan: Plan) -> AssistanceMemory:
        """That of the other controller, the shares, and the walk against which the error is measured."""
        settings = self.parameters
        path = self.walk(plan) if settings.adaptive else Path([], 0, [])
        shares = [settings.share.get(JointName(name), 1.0) for _ in plan.sides for name in plan.joints]
        assisted = [AssistedJoint(share) for share in shares]
        strides = [AssistedLeg(path.cycle_ticks) for _ in path.starts]
        return AssistanceMemory(self.other.memory(plan), assisted, strides, path, settings)

    def constants(self) -> dict[str, int]:
        """With whether the shares adapt."""
        acts = self.other.tick is not None
        return {**super().constants(), "ADAPTS": self.parameters.adaptive, "ASSISTED_ACTS": acts}

    def functions(self) -> dict[str, TickFunction]:
        """With the tick of the other controller."""
        other = {} if self.other.tick is None else {"assisted_tick": self.other.tick}
        return {**super().functions(), **other}


def _add_errors(memory: AssistanceMemory, device: ControllerState, number: int, tick: int) -> None:
    """Add the tracking errors of this tick to those of a leg's stride."""
    stride, angles = memory.strides[number], memory.path.angles
    progress = (tick - stride.stride_start) / stride.stride_ticks
    if stride.stride_start == 0:
        progress += memory.path.starts[number]
    before, share = cycle_place(progress, len(angles))
    for position in range(JOINTS_PER_LEG):
        place = number * JOINTS_PER_LEG + position
        start = angles[before][position]
        wanted = start + share * (angles[before + 1][position] - start)
        memory.assisted[place].tracking += abs(device.joints[place].measurement.angle - wanted)


def _end_stride(memory: AssistanceMemory, number: int, tick: int) -> None:
    """Adapt the shares of one leg to the errors of the stride that has ended."""
    stride = memory.strides[number]
    duration = tick - stride.stride_start
    for place in range(number * JOINTS_PER_LEG, (number + 1) * JOINTS_PER_LEG):
        joint = memory.assisted[place]
        joint.share = adapted_assistance(memory.settings, joint.share, joint.tracking / duration)
        joint.tracking = 0.0
    if stride.stride_start > 0:  # the first stride may have begun half-way
        stride.stride_ticks = duration
    stride.stride_start = tick
