"""The worlds that the leg lives in: bench leg and treadmill."""

from twin_gait.scenario.bench_leg import BenchLegScenario, HandParameters
from twin_gait.scenario.faults import Fault, FaultKind, parse_fault
from twin_gait.scenario.treadmill import TreadmillScenario
from twin_gait.scenario.world import LegSource, World

__all__ = [
    "BenchLegScenario",
    "Fault",
    "FaultKind",
    "HandParameters",
    "LegSource",
    "TreadmillScenario",
    "World",
    "parse_fault",
]
