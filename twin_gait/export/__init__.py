"""Logs in the formats of other programs."""

from twin_gait.export.inverse_dynamics import export_inverse_dynamics
from twin_gait.export.motion import export_csv, export_motion

__all__ = ["export_csv", "export_inverse_dynamics", "export_motion"]
