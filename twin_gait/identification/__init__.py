"""Identification of joint friction from logs and from series of velocity and torque."""

from twin_gait.identification.bench import BenchSetup, CurrentSource, Processing, ProcessingOptions
from twin_gait.identification.bootstrap import Uncertainty, uncertainty
from twin_gait.identification.columns import LogColumns, Quantity, parse_columns
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
from twin_gait.identification.processing import RATE, process_log
from twin_gait.identification.reading import Log, read_log
from twin_gait.identification.samples import FrictionTest, Samples, join_tests
from twin_gait.identification.signals import decimate, moving_average, zero_phase
from twin_gait.identification.statistics import CrossValidation, Goodness, goodness
from twin_gait.scenario import LoadAngle

__all__ = [
    "MODELS",
    "RATE",
    "BenchSetup",
    "CrossValidation",
    "CurrentSource",
    "Fit",
    "FitOptions",
    "FrictionModel",
    "FrictionTest",
    "Goodness",
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
    "Samples",
    "Uncertainty",
    "decimate",
    "find_models",
    "fit_model",
    "goodness",
    "identify_logs",
    "identify_tests",
    "join_tests",
    "moving_average",
    "parse_columns",
    "process_log",
    "read_log",
    "uncertainty",
    "zero_phase",
]
