"""Controllers behind one interface."""

from twin_gait.control.controller import (
    Controller,
    ControllerTorques,
    ImpedanceController,
    JointMeasurement,
    JointSetpoint,
)

__all__ = ["Controller", "ControllerTorques", "ImpedanceController", "JointMeasurement", "JointSetpoint"]
