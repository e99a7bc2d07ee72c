"""Logs in the formats of other programs."""

from twin_gait.export.table import export_csv

__all__ = ["export_csv"]
