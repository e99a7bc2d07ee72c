"""A controller of the legs: what each phase asks of the joints, a memory, and what it does in a tick.

The gait controller (:mod:`twin_gait.control.gait_controller`) fades into the setpoints of a phase and writes
them, with what is fed forward, into the demand of each joint. A controller with a tick changes these demands
before the boards hear them. It keeps nothing but its memory, which is part of the record of an episode.
"""

import inspect
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
PATH_SAMPLES = 101  # of a cycle, every percent
_TRAILING_START = 0.5  # of the cycle, where the trailing leg begins
_DEMANDED = ("stiffness", "damping", "equilibrium", "gain", "gravity", "inertia", "target")


@dataclass(slots=True)
class Path:
    """A walk that is followed, or against which the tracking error is measured; it may be a memory."""

    # over the cycle from foot contact in [rad], by sample (``PATH_SAMPLES``) and joint of a leg
    angles: list[list[float]]
    cycle_ticks: int  # ticks of a cycle
    starts: list[float]  # share of the cycle at which each leg begins


def cycle_place(progress: float, samples: int) -> tuple[int, float]:
    """Where an instant of the gait cycle falls among evenly spaced samples of a path that closes.

    Whole cycles of the progress do not matter; the last sample is the first of the next cycle. Returns the
    number of the sample before the instant, and the share of the next one.
    """
    place = (progress - int(progress)) * (samples - 1)
    before = min(int(place), samples - 2)
    return before, place - before


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a controller knows before the walk."""

    sides: tuple[Side, ...]  # the legs, in the order of the device's
    joints: tuple[str, ...]  # names of the joints of a leg, in their order
    phases: tuple[str, ...]  # names of the phases by number
    leading: Side  # leg that begins with the gait cycle
    speed: float  # of walking in [m] / [s], as near to it as healthy walking is known
    height: float  # of the wearer in [m]
    inertia: InertiaAt  # effective inertia of a joint in [kg m²], from leg, posture and the joint's name

    @property
    def reference(self) -> Path:
        """Healthy walking at this speed and height (Koopman et al. 2014)."""
        # With the measures comes pandas, which an experiment is read without.
        from twin_gait.measures.reference import reference_curve, reference_cycle_time

        percent = np.linspace(0.0, 100.0, PATH_SAMPLES)
        angles = [
            reference_curve(JointName(name), percent, speed=self.speed, height=self.height)
            for name in self.joints
        ]
        starts = [0.0 if side is self.leading else _TRAILING_START for side in self.sides]
        cycle_ticks = round(reference_cycle_time(self.speed, self.height) / TICK)
        return Path(np.array(angles).T.tolist(), cycle_ticks, starts)


@dataclass(slots=True)
class NoMemory:
    """What a controller keeps that keeps nothing."""

    unused: int = 0  # no record is empty


class Controller:
    """A controller of the legs; one of its own derives from this class and changes what it wants to.

    As it stands it is impedance control: every joint has the setpoints of the gait table.

    Attributes:
        mode: Value of ``control.mode`` that stands for it; empty for a controller that does not ship.
        tick: What it does in a tick of 1 ms, or None: a static method that takes its memory, the device, the
            number of the tick and its length in [s]. Of the device it reads ``legs`` (``phase``, the
            ``entry_tick`` in which it began, ``load`` over body weight) and ``joints``, leg by leg
            (``measurement.angle`` in [rad], ``measurement.velocity`` in [rad] / [s]). In the ``demand`` of a
            joint stand the setpoint and what is fed forward, see
            :class:`twin_gait.control.joint_board.Demand`; it changes them in place. After a trip of the
            safety monitor it is not called.
        by_phases: Whether it is the phases that move the legs on; the monitor limits the time in one then.
        unprinted: Why the firmware does not have it, with key, value and way out; empty if it does.
    """

    mode = ""
    tick: TickFunction | None = None
    by_phases = True
    unprinted = ""

    @property
    def name(self) -> str:
        """What messages call it."""
        return type(self).__name__

    def refusal(self, joints: tuple[JointName, ...]) -> str:
        """Why it cannot drive some joints, with key and way out; empty if it can."""
        return ""

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """Setpoints of a leg by phase.

        ``rows``: what the gait table says: k, b, θ0, G of each joint and the gravity share, shape
        ``(n_phases, n_columns)``; may be changed in place. Returns the same shape.
        """
        return rows

    def start(self, plan: Plan) -> Mapping[Side, Mapping[JointName, float]]:
        """Angles in [rad] at which the joints of each leg have to begin; none leaves that to the world."""
        return {}

    def walk(self, plan: Plan) -> Path:
        """The walk against which assistance that adapts measures the tracking error."""
        return plan.reference

    def memory(self, plan: Plan) -> Any:
        """What it keeps, as it begins: a dataclass with slots, of numbers, such dataclasses and lists."""
        return NoMemory()

    def constants(self) -> dict[str, int]:
        """Constants that a loop is bound to, by name; what they rule out is not compiled."""
        return {"CONTROLLED": self.tick is not None}

    def functions(self) -> dict[str, TickFunction]:
        """Functions that a loop is bound to, by name."""
        return {} if self.tick is None else {"controller_tick": self.tick}


class UncompiledControllerError(ParameterError):
    """numba cannot compile the tick of a controller."""


def mistake(name: str, expected: str, got: str) -> ParameterError:
    """What to raise of a controller that is not as it should be."""
    return ParameterError(f"controller {name!r}: expected {expected}, got {got}")


def require_controller(controller: Any) -> None:
    """Refuse, by a ParameterError, what is no controller, or whose tick does not take what it is handed."""
    if not isinstance(controller, Controller):
        name = getattr(controller, "__name__", type(controller).__name__)
        got = f"the class itself; write {name}()" if isinstance(controller, type) else repr(type(controller))
        raise mistake(name, "an instance of a class derived from twin_gait.control.Controller", got)
    if controller.tick is None:
        return
    expected, signature = inspect.signature(controller_tick).parameters, inspect.signature(controller.tick)
    try:
        signature.bind(*expected)
    except TypeError as error:
        takes = f"a static method tick({', '.join(expected)})"
        raise mistake(controller.name, takes, f"tick{signature}") from error


def checked_setpoints(controller: Controller, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
    """Setpoints of a leg; a ParameterError if they are not finite or of another shape."""
    shape, given = rows.shape, controller.setpoints(plan, side, rows)
    try:
        found = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.shape != shape or not np.isfinite(found).all():
        expected = f"setpoints of finite numbers of shape {shape}"
        raise mistake(controller.name, expected, " ".join(reprlib.repr(given).split()))
    return found


def checked(name: str, tick: TickFunction, float_in: Callable[[Any], str | None]) -> TickFunction:
    """A tick whose demands and memory are looked at.

    ``float_in``: names a field of whole numbers that holds a float. ParameterError if there is one, if the
    tick returns something or demands no number; what is not finite is for the monitor.
    """

    def checked_tick(memory: Any, device: Any, number: int, period: float) -> None:
        require_no_answer(name, tick(memory, device, number, period))  # type: ignore[func-returns-value]
        require_whole_numbers(name, float_in(memory))
        for joint in device.joints:
            for key in _DEMANDED:
                value = getattr(joint.demand, key)
                if not isinstance(value, Real):
                    raise mistake(name, f"a number in demand.{key}", reprlib.repr(value))

    return checked_tick


def require_no_answer(name: str, answer: Any) -> None:
    """Refuse, by a ParameterError, a tick that returns something, which nobody would read."""
    if answer is not None:
        expected = "a tick that changes demands in place and returns nothing"
        raise mistake(name, expected, reprlib.repr(answer))


def require_whole_numbers(name: str, field: str | None) -> None:
    """Refuse, by a ParameterError, a memory with a float in a field of whole numbers; None says none has."""
    if field is not None:
        expected = f"a whole number in {field}, which its class declares as int"
        raise mistake(name, expected, "a float; declare it as float")
