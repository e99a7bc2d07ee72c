"""Identification of joint friction from logs and from series of velocity and torque."""

from twin_gait.identification.filters import decimate, moving_average
from twin_gait.identification.fitting import Fit, FitOptions, Loss, fit_model
from twin_gait.identification.friction_model import FrictionModel
from twin_gait.identification.identify import (
    Identification,
    IdentificationOptions,
    IdentifiedModel,
    identify_logs,
    identify_tests,
)
from twin_gait.identification.models import MODELS, find_models
from twin_gait.identification.processing import (
    CurrentSource,
    Processing,
    ProcessingOptions,
    process_log,
)
from twin_gait.identification.quantities import Quantity
from twin_gait.identification.reading import Log, LogColumns, parse_columns, read_log
from twin_gait.identification.rig import LoadAngle, RigParameters
from twin_gait.identification.samples import FrictionTest, Samples, join_tests

__all__ = [
    "MODELS",
    "CurrentSource",
    "Fit",
    "FitOptions",
    "FrictionModel",
    "FrictionTest",
    "Identification",
    "IdentificationOptions",
    "IdentifiedModel",
    "LoadAngle",
    "Log",
    "LogColumns",
    "Loss",
    "Processing",
    "ProcessingOptions",
    "Quantity",
    "RigParameters",
    "Samples",
    "decimate",
    "find_models",
    "fit_model",
    "identify_logs",
    "identify_tests",
    "join_tests",
    "moving_average",
    "parse_columns",
    "process_log",
    "read_log",
]
