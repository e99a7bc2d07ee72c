"""The controller of one joint: what it sees, what it is told, what it answers."""

from __future__ import annotations

import inspect
import math
import reprlib
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import Any, NamedTuple

from twin_gait.core.control_tick import controller_torques
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.exceptions import MeasurementError, ParameterError
from twin_gait.parameters import FrictionParameters


class JointMeasurement(NamedTuple):
    """What a controller sees of its joint.

    Attributes:
        angle: Encoder angle in [rad].
        velocity_fast: First-order estimate in [rad] / [s].
        velocity_slow: Decimated and averaged estimate in [rad] / [s].
    """

    angle: float
    velocity_fast: float
    velocity_slow: float


class JointSetpoint(NamedTuple):
    """What the gait table asks of a joint at this tick, blended.

    Attributes:
        stiffness: k in [N m] / [rad].
        damping: b in [N m s] / [rad].
        equilibrium_angle: θ0 in [rad].
        friction_compensation_gain: G.
    """

    stiffness: float
    damping: float
    equilibrium_angle: float
    friction_compensation_gain: float


class ControllerTorques(NamedTuple):
    """What a controller answers, as torques on the joint in [N m].

    Attributes:
        impedance: Of the virtual spring and damper, or whatever takes its place.
        friction_compensation: Of the friction compensator.
    """

    impedance: float
    friction_compensation: float


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

    def torques(self, measurement: JointMeasurement, setpoint: JointSetpoint) -> ControllerTorques:
        """Torques for one tick; equations (2.17) and (2.18) of the thesis by default.

        Args:
            measurement: Of the joint.
            setpoint: Blended parameters of the phase.

        Returns:
            Impedance and friction-compensation torque.

        Raises:
            MeasurementError: If the measurement is not finite.
        """
        if not math.isfinite(sum(measurement)):
            _refuse(measurement)
        model = self.friction_model
        friction = rotational_friction_torque(
            measurement.velocity_slow,
            model.breakaway_torque,
            model.coulomb_friction,
            model.breakaway_velocity,
            model.viscous_friction,
        )
        answer = self.law(*measurement, *setpoint, friction)
        if self.law is not controller_torques:
            require_torques(self.law, answer)
        return ControllerTorques(*answer)


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


def _refuse(measurement: JointMeasurement) -> None:
    for name, value in measurement._asdict().items():
        if not math.isfinite(value):
            raise MeasurementError(f"{name} of a joint is {value}; expected a finite measurement")
