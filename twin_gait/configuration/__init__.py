"""YAML in and out: gait tables, experiments and people, validated at the edge."""

from twin_gait.configuration.documents import dump_yaml, experiment_document, table_document
from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.configuration.experiments import DEFAULT_PRESET, LoadedExperiment, load_experiment, presets
from twin_gait.configuration.gait_table_file import gait_table_from_mapping, load_gait_table
from twin_gait.configuration.people import people, person_document
from twin_gait.configuration.table_inheritance import packaged_gait_tables

__all__ = [
    "DEFAULT_PRESET",
    "LoadedExperiment",
    "dump_yaml",
    "experiment_document",
    "experiment_from_mapping",
    "gait_table_from_mapping",
    "load_experiment",
    "load_gait_table",
    "packaged_gait_tables",
    "people",
    "person_document",
    "presets",
    "table_document",
]
