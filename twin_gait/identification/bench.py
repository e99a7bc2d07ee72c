"""The joint test bench of the thesis as an identification sees it, and how its logs are processed."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

import numpy as np

from twin_gait.parameters import ActuatorParameters, quantities
from twin_gait.worlds import HORIZONTAL, LoadAngle

_GRAVITY = 9.81  # [m] / [s²]


@dataclass(frozen=True, kw_only=True)
class BenchSetup(quantities.Parameters):
    """Test bench of one joint (thesis 2.2.1).

    Attributes:
        actuator: Motor and gear.
        mass: On the link in [kg], where the log does not say.
        lever: b, from the axis to the weight, in [m]. The thesis does not print it: an assumption.
        link_inertia: About the axis in [kg m²]; an assumption.
        link_moment: Mass of the link times the distance of its centre from the axis in [kg m].
        start_angle: What the first angle of a log is set to in [rad]; None leaves the angles as they are.
        load_angle: Form of the load torque.
        mass_as_printed: Whether J_mass is m b, as printed, instead of m b².
    """

    actuator: ActuatorParameters
    mass: Annotated[quantities.Mass | None, quantities.NOT_NEGATIVE] = None
    lever: Annotated[quantities.Length, quantities.POSITIVE] = 0.30
    link_inertia: Annotated[quantities.Inertia, quantities.NOT_NEGATIVE] = 0.02
    link_moment: Annotated[float, quantities.Unit("kgm"), quantities.NOT_NEGATIVE] = 0.0
    start_angle: quantities.Angle | None = HORIZONTAL
    load_angle: LoadAngle = LoadAngle.CORRECTED
    mass_as_printed: bool = False

    def joint_angle(self, angle: np.ndarray) -> np.ndarray:
        """Logged angles, set so that the first one is the start angle, in [rad]."""
        return angle if self.start_angle is None else angle - angle[0] + self.start_angle

    def load_torque(self, angle: np.ndarray, mass: float | np.ndarray) -> np.ndarray:
        """Torque of gravity on the joint in [N m], equation (2.8); positive along the fall.

        ``angle``: joint angle in [rad], shape ``(n,)``. ``mass``: on the link in [kg].
        """
        tilt = angle - HORIZONTAL if self.load_angle is LoadAngle.CORRECTED else angle
        return np.asarray(_GRAVITY * (mass * self.lever + self.link_moment) * np.cos(tilt))

    def inertia(self, mass: float | np.ndarray) -> float | np.ndarray:
        """J of equation (2.12) at the joint in [kg m²]: armature, link and weight."""
        weight = mass * self.lever if self.mass_as_printed else mass * self.lever * self.lever
        return self.actuator.armature + self.link_inertia + weight

    def motor_torque(self, current: np.ndarray) -> np.ndarray:
        """K_t τ I in [N m] of a motor current in [A]."""
        return np.asarray(current * self.actuator.torque_constant * self.actuator.gear_ratio)


class Processing(StrEnum):
    """How a log is smoothed before the friction torque is computed."""

    ZERO_PHASE = "zero_phase"  # angle, current and load through the same filter without delay
    THESIS = "thesis"  # decimate by 10, moving average of 10 over the velocity alone, forward difference
    NONE = "none"  # as recorded


class CurrentSource(StrEnum):
    """Which current the motor torque is computed from."""

    MEASURED = "measured"
    TARGET = "target"


@dataclass(frozen=True, kw_only=True)
class ProcessingOptions(quantities.Parameters):
    """How to process logs.

    Attributes:
        processing: None takes zero phase for logs with a current, and none for friction torques.
        cutoff: Of the zero-phase filter in [Hz].
        current: None takes the measured one if it is logged; with the thesis's processing the target.
        standstill_velocity: Slower samples are rejected, in [rad] / [s]; None for 0.002 in logs with a
            current and 0 in series of friction torques.
    """

    processing: Processing | None = None
    cutoff: Annotated[quantities.Frequency, quantities.POSITIVE] = 40.0
    current: CurrentSource | None = None
    standstill_velocity: Annotated[quantities.AngularVelocity | None, quantities.NOT_NEGATIVE] = None
