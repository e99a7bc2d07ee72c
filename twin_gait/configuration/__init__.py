"""YAML in and out: gait tables and experiments, validated at the edge."""

from twin_gait.configuration.experiments import LoadedExperiment, load_experiment, presets
from twin_gait.configuration.gait_table_file import find_gait_table, load_gait_table, packaged_gait_table
from twin_gait.configuration.table_inheritance import packaged_gait_tables

__all__ = [
    "LoadedExperiment",
    "find_gait_table",
    "load_experiment",
    "load_gait_table",
    "packaged_gait_table",
    "packaged_gait_tables",
    "presets",
]
