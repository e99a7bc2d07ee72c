"""YAML in and out: gait tables and experiments, validated at the edge."""

from twin_gait.configuration.gait_table_file import load_gait_table, packaged_gait_table

__all__ = ["load_gait_table", "packaged_gait_table"]
