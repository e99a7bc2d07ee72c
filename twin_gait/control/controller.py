"""The controller of one joint: what it sees, what it is told, what it answers."""

from __future__ import annotations

import inspect
import math
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

from twin_gait.core.control_tick import controller_torques
from twin_gait.exceptions import MeasurementError, ParameterError
from twin_gait.parameters import FrictionParameters

# From angle, fast and slow velocity; k, b, θ0, G; and the friction torque of the compensator's model at the
# slow velocity to the impedance and the friction-compensation torque, as
# :func:`twin_gait.core.control_tick.controller_torques`.
ControllerFunction = Callable[..., tuple[float, float]]


@dataclass(frozen=True)
class Controller:
    """The controller of one joint; it keeps no state, everything it may use is handed in.

    The default is the thesis's, impedance on friction compensation. With stiffness and damping of zero it is
    the thesis's transparent mode: friction compensation with a target torque.

    Attributes:
        friction_model: The compensator's own friction model.
        law: The control law.
    """

    friction_model: FrictionParameters
    law: ControllerFunction = controller_torques


def checked(law: ControllerFunction) -> ControllerFunction:
    """A control law that is handed nothing that is not finite, and whose answer is looked at.

    Returns:
        The law; it raises MeasurementError if a measurement is not finite, ParameterError if the answer is
        not two torques.
    """

    def torques(angle: float, fast: float, slow: float, *rest: float) -> tuple[float, float]:
        if not math.isfinite(angle + fast + slow):
            _refuse({"angle": angle, "velocity_fast": fast, "velocity_slow": slow})
        answer = law(angle, fast, slow, *rest)
        if law is not controller_torques:
            require_torques(law, answer)
        return answer

    return torques


def name_of(law: ControllerFunction) -> str:
    """What messages call a control law of the user's."""
    return f"controller {getattr(law, '__name__', law)!r}"


def require_arguments(law: ControllerFunction) -> None:
    """Refuse a control law that does not take what it is handed.

    Raises:
        ParameterError: If it takes more or fewer arguments.
    """
    expected = inspect.signature(controller_torques).parameters
    try:
        signature = inspect.signature(law)
    except (TypeError, ValueError):  # written in C, for example
        return
    try:
        signature.bind(*expected)
    except TypeError as error:
        raise ParameterError(
            f"{name_of(law)}: expected {len(expected)} arguments ({', '.join(expected)}), got {signature}"
        ) from error


def require_torques(law: ControllerFunction, answer: Any) -> None:
    """Refuse what is not two torques.

    Raises:
        ParameterError: If it is anything else; a torque that is not finite is for the safety monitor.
    """
    try:
        impedance, friction = answer
        fits = isinstance(impedance, Real) and isinstance(friction, Real)
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise ParameterError(f"{name_of(law)}: {EXPECTED_TORQUES}, got {reprlib.repr(answer)}")


EXPECTED_TORQUES = "expected two torques in [N m], of the impedance and of the friction compensation"


def _refuse(measurement: Mapping[str, float]) -> None:
    for name, value in measurement.items():
        if not math.isfinite(value):
            raise MeasurementError(f"{name} of a joint is {value}; expected a finite measurement")
