"""Simulate an experiment, or one joint on its bench; nothing here touches a disk."""

from twin_gait.simulation.bench_joint import LOG_COLUMNS, BenchRun, BenchVariation, simulate_bench
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulator import simulate

__all__ = ["LOG_COLUMNS", "BenchRun", "BenchVariation", "Run", "RunStatus", "simulate", "simulate_bench"]
