"""Simulation of the joint bench: one motor, its gear and a link with a weight.

A test is one record (:mod:`.episode`). The rooms of its loop are ordinary functions of it: :mod:`.sensing`,
:mod:`.command`, :mod:`.winding` and :mod:`.mechanics`, which :mod:`.tick` puts in order.
"""

from twin_gait.gait.table import TICK
from twin_gait.simulation.bench_joint.episode import COLUMNS, LOG_COLUMNS, BenchVariation
from twin_gait.simulation.bench_joint.loop import BenchRun, simulate_bench

__all__ = ["COLUMNS", "LOG_COLUMNS", "TICK", "BenchRun", "BenchVariation", "simulate_bench"]
