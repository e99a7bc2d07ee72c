"""The controller of a joint, behind one interface."""

from twin_gait.control.controller import (
    Controller,
    ControllerFunction,
    ControllerTorques,
    JointMeasurement,
    JointSetpoint,
)

__all__ = ["Controller", "ControllerFunction", "ControllerTorques", "JointMeasurement", "JointSetpoint"]
