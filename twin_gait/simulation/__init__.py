"""Simulate an experiment; nothing here touches a disk."""

from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulator import simulate

__all__ = ["Run", "RunStatus", "simulate"]
