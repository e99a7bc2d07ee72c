"""Logs in the formats of other programs."""

from twin_gait.export.inverse_dynamics import export_inverse_dynamics
from twin_gait.export.opensim import export_motion
from twin_gait.export.table import export_csv

__all__ = ["export_csv", "export_inverse_dynamics", "export_motion"]
