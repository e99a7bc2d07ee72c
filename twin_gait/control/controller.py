"""Controller of the legs: setpoints for each phase, a memory, and a function that runs in each tick.

The gait controller (:mod:`twin_gait.control.gait_controller`) blends into the impedance of a phase and writes
it, with the feed-forward torques, into the setpoint of each joint. A controller with a tick changes these
setpoints before the boards receive them. Its only state is its memory, which is part of the record of an
episode.
"""

import inspect
import math
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from twin_gait.control.gait_controller import controller_tick
from twin_gait.exceptions import ParameterError
from twin_gait.gait.scaling import InertiaAt
from twin_gait.gait.table import TICK
from twin_gait.vocabulary import JointName, Side

TickFunction = Callable[[Any, Any, int, float], None]
PATH_SAMPLES = 101  # Number of samples of a cycle: one for every percent.
_TRAILING_START = 0.5  # Share of the cycle at which the trailing leg begins.
_SETPOINT_FIELDS = ("stiffness", "damping", "equilibrium", "gain", "gravity", "inertia", "target")


@dataclass(slots=True)
class ReferencePath:
    """Reference walk to follow, or to compute the tracking error from; it may be a controller's memory."""

    # Angles over the cycle from foot contact in [rad], by sample (``PATH_SAMPLES``) and joint of a leg.
    angles: list[list[float]]
    cycle_ticks: int  # Duration of a cycle in ticks.
    starts: list[float]  # Share of the cycle at which each leg begins.


@dataclass(slots=True)
class StrideClock:
    """Place of a leg in its stride, from the strides that it has finished."""

    stride_ticks: int  # Length of the last stride in ticks; before the first one that of the reference.
    first_share: float  # Share of the cycle at which the leg began to walk.
    stride_start: int = 0  # Tick in which the present stride began; 0 before the first one begins.


def stride_progress(clock: StrideClock, tick: int) -> float:
    """Return the place of a leg in its stride, in strides of the length of the last one."""
    progress = (tick - clock.stride_start) / clock.stride_ticks
    return progress + clock.first_share if clock.stride_start == 0 else progress


def begin_stride(clock: StrideClock, tick: int) -> int:
    """Begin a stride, and return the number of ticks of the one before."""
    duration = tick - clock.stride_start
    if clock.stride_start > 0:  # The first stride may be incomplete.
        clock.stride_ticks = duration
    clock.stride_start = tick
    return duration


def find_cycle_interval(progress: float, samples: int) -> tuple[int, float]:
    """Find the two samples of a closed path between which an instant of the gait cycle lies.

    The samples are evenly spaced. ``progress``: the instant in cycles, 0 or more; whole cycles have no
    effect. ``samples``: number of samples; the last one is the first of the next cycle. Returns the index of
    the sample before the instant, and the weight of the next sample in a linear interpolation, 0 to 1.
    """
    position = (progress - math.floor(progress)) * (samples - 1)
    before = min(int(math.floor(position)), samples - 2)  # noqa: RUF046  # In C floor is not an integer.
    return before, position - before


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Information that a controller receives before the walk."""

    sides: tuple[Side, ...]  # Legs, in the order of the device's legs.
    joints: tuple[str, ...]  # Names of the joints of a leg, in their order.
    phases: tuple[str, ...]  # Names of the phases by number.
    leading: Side  # Leg that begins with the gait cycle.
    speed: float  # Walking speed in [m/s], limited to the range for which healthy walking is known.
    height: float  # Height of the wearer in [m].
    inertia: InertiaAt  # Effective inertia of a joint in [kg·m²], from leg, posture and the joint's name.

    @property
    def reference(self) -> ReferencePath:
        """Healthy walking at this speed and height (Koopman et al. 2014)."""
        # The import is local because it loads pandas, which is not needed to read an experiment.
        from twin_gait.measures.reference import reference_curve, reference_cycle_time

        percent = np.linspace(0.0, 100.0, PATH_SAMPLES)
        angles = [
            reference_curve(JointName(name), percent, speed=self.speed, height=self.height)
            for name in self.joints
        ]
        starts = [0.0 if side is self.leading else _TRAILING_START for side in self.sides]
        cycle_ticks = round(reference_cycle_time(self.speed, self.height) / TICK)
        return ReferencePath(np.array(angles).T.tolist(), cycle_ticks, starts)


@dataclass(slots=True)
class NoMemory:
    """Memory of a controller without state."""

    unused: int = 0  # Unused field, because a compiled record cannot be empty.


class Controller:
    """Base class of the controllers of the legs, which override parts of it; users derive their own from it.

    The base class itself is impedance control: every joint has the setpoints of the gait table.

    Attributes:
        mode: Value of ``control.mode`` that selects it; empty for a controller that does not ship.
        tick: Function that runs in each tick of 1 ms, or None: a static method that takes its memory, the
            device, the number of the tick and its length in [s]. It reads from the device ``legs``
            (``phase``, the ``entry_tick`` in which the phase was entered, ``load`` as a fraction of body
            weight) and ``joints``, leg by leg (``measurement.angle`` in [rad], ``measurement.velocity`` in
            [rad/s]). The ``setpoint`` of a joint contains the impedance and the feed-forward torques, see
            :class:`twin_gait.control.joint_board.JointSetpoint`; the function changes it in place. It is
            not called after a trip of the safety monitor.
        phase_driven: Whether the phases cause the motion; if they do, the monitor limits the time in a phase.
        unprinted_reason: Reason why the firmware does not include it, with key, value and alternative; empty
            if it does.
    """

    mode = ""
    tick: TickFunction | None = None
    phase_driven = True
    unprinted_reason = ""

    @property
    def name(self) -> str:
        """Name in messages."""
        return type(self).__name__

    def check_joints(self, joints: tuple[JointName, ...]) -> str:
        """Check whether the controller can drive some joints.

        Returns an error message with key and alternative; empty if it can.
        """
        return ""

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """Return the setpoints of a leg by phase.

        ``rows``: values of the gait table: k, b, θ0, G of each joint and the gravity share, shape
        ``(n_phases, n_columns)``; may be changed in place. Returns the same shape.
        """
        return rows

    def initial_angles(self, plan: Plan) -> Mapping[Side, Mapping[JointName, float]]:
        """Return the initial angles in [rad] of the joints of each leg; empty if the world sets them."""
        return {}

    def reference_path(self, plan: Plan) -> ReferencePath:
        """Return the reference walk from which adaptive assistance computes the tracking error."""
        return plan.reference

    def initial_memory(self, plan: Plan) -> Any:
        """Create the initial memory: a dataclass with slots, of numbers, such dataclasses and lists."""
        return NoMemory()

    def build_flags(self) -> dict[str, int]:
        """Return the build flags of a loop by name; code that they rule out is not compiled."""
        return {"WITH_CONTROLLER": self.tick is not None}

    def tick_functions(self) -> dict[str, TickFunction]:
        """Return the functions that a loop is specialized for, by name."""
        return {} if self.tick is None else {"controller_tick": self.tick}


class UncompiledControllerError(ParameterError):
    """Error that numba cannot compile the tick of a controller."""


def controller_error(name: str, expected: str, got: str) -> ParameterError:
    """Create the error for a controller that does not fulfil the interface."""
    return ParameterError(f"controller {name!r}: expected {expected}, got {got}")


def require_controller(controller: Any) -> None:
    """Raise ParameterError if an object is no controller, or if its tick has wrong arguments."""
    if not isinstance(controller, Controller):
        name = getattr(controller, "__name__", type(controller).__name__)
        got = f"the class itself; write {name}()" if isinstance(controller, type) else repr(type(controller))
        raise controller_error(
            name, "an instance of a class derived from twin_gait.control.controller.Controller", got
        )
    if controller.tick is None:
        return
    expected, signature = inspect.signature(controller_tick).parameters, inspect.signature(controller.tick)
    try:
        signature.bind(*expected)
    except TypeError as error:
        takes = f"a static method tick({', '.join(expected)})"
        raise controller_error(controller.name, takes, f"tick{signature}") from error


def checked_setpoints(controller: Controller, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
    """Return the setpoints of a leg; raise ParameterError if they are not finite or of another shape."""
    shape, given = rows.shape, controller.setpoints(plan, side, rows)
    try:
        found = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.shape != shape or not np.isfinite(found).all():
        expected = f"setpoints of finite numbers of shape {shape}"
        raise controller_error(controller.name, expected, " ".join(reprlib.repr(given).split()))
    return found


def wrap_checked_tick(name: str, tick: TickFunction, float_in: Callable[[Any], str | None]) -> TickFunction:
    """Wrap a tick so that its setpoints and memory are checked.

    ``float_in``: function that returns the name of an integer field that holds a float, or None. The wrapper
    raises ParameterError if there is such a field, if the tick returns something, or if a value of a setpoint
    is not a number. It does not check whether values are finite; the safety monitor does.
    """

    def checked_tick(memory: Any, device: Any, number: int, period: float) -> None:
        require_no_result(name, tick(memory, device, number, period))  # type: ignore[func-returns-value]
        require_whole_numbers(name, float_in(memory))
        for joint in device.joints:
            for key in _SETPOINT_FIELDS:
                value = getattr(joint.setpoint, key)
                if not isinstance(value, Real):
                    raise controller_error(name, f"a number in setpoint.{key}", reprlib.repr(value))

    return checked_tick


def require_no_result(name: str, result: Any) -> None:
    """Check that a tick returns None, because a result would not be used; raise ParameterError if not."""
    if result is not None:
        expected = "a tick that changes setpoints in place and returns nothing"
        raise controller_error(name, expected, reprlib.repr(result))


def require_whole_numbers(name: str, field: str | None) -> None:
    """Raise ParameterError for a float in an integer field of a memory; None means that there is none."""
    if field is not None:
        expected = f"a whole number in {field}, which its class declares as int"
        raise controller_error(name, expected, "a float; declare it as float")
