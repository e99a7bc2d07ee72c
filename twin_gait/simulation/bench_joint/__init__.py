"""Simulation of the joint bench: one motor, its gear and a link with a weight.

The rooms of the loop are plain Python over :mod:`twin_gait.core`: :mod:`.sensing`, :mod:`.command`,
:mod:`.winding` and :mod:`.mechanics`, which :mod:`.tick` puts in order. :mod:`.loop` compiles the same text.
"""

from twin_gait.gait.table import TICK
from twin_gait.simulation.bench_joint.layout import BenchVariation
from twin_gait.simulation.bench_joint.loop import LOG_COLUMNS, BenchRun, loop_text, simulate_bench

__all__ = ["LOG_COLUMNS", "TICK", "BenchRun", "BenchVariation", "loop_text", "simulate_bench"]
