"""The controller of one joint: what it sees, what it is told, what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from twin_gait.core.control_tick import controller_torques
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


class Controller(Protocol):
    """A controller of one joint. It keeps no state: everything it may use is handed in."""

    def torques(self, measurement: JointMeasurement, setpoint: JointSetpoint) -> ControllerTorques:
        """Torques for one tick."""
        ...


@dataclass(frozen=True)
class ImpedanceController:
    """Impedance on friction compensation, the controller of the thesis.

    With stiffness and damping of zero it is the thesis's transparent mode: friction compensation
    with a target torque.

    Attributes:
        friction_model: The compensator's own friction model.
    """

    friction_model: FrictionParameters

    def torques(self, measurement: JointMeasurement, setpoint: JointSetpoint) -> ControllerTorques:
        """Torques of equations (2.17) and (2.18).

        Args:
            measurement: Of the joint.
            setpoint: Blended parameters of the phase.

        Returns:
            Impedance and friction-compensation torque.
        """
        model = self.friction_model
        return ControllerTorques(
            *controller_torques(
                *measurement,
                *setpoint,
                model.breakaway_torque,
                model.coulomb_friction,
                model.breakaway_velocity,
                model.viscous_friction,
            )
        )
