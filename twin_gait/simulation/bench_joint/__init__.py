"""Simulation of the joint bench: one motor, its gear and a link with a weight.

A test is one record (:mod:`.episode`), laid out by :mod:`.filling`. The rooms of its loop (:mod:`.tick`,
:mod:`.mechanics`) are ordinary functions of it, which :mod:`.loop` runs compiled or as plain Python.
"""

from twin_gait.gait.table import TICK
from twin_gait.simulation.bench_joint.episode import COLUMNS, LOG_COLUMNS, BenchVariation
from twin_gait.simulation.bench_joint.loop import BenchRun, simulate_bench

__all__ = ["COLUMNS", "LOG_COLUMNS", "TICK", "BenchRun", "BenchVariation", "simulate_bench"]
