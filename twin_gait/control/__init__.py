"""The controller of a joint, behind one interface, and what its monitor says."""

from twin_gait.control.controller import (
    Controller,
    ControllerFunction,
    ControllerTorques,
    JointMeasurement,
    JointSetpoint,
)
from twin_gait.control.safety import SafetyState, Trip, TripCause

__all__ = [
    "Controller",
    "ControllerFunction",
    "ControllerTorques",
    "JointMeasurement",
    "JointSetpoint",
    "SafetyState",
    "Trip",
    "TripCause",
]
