"""Test on the joint bench in plain Python, with the uncompiled stages of its loop."""

import numpy as np

from twin_gait.core.friction import ROTATIONAL
from twin_gait.gait.table import TICK
from twin_gait.simulation.bench_joint.episode import LAYOUT, BenchVariation
from twin_gait.simulation.bench_joint.loop import bench_episode, bench_noise, bound_rooms
from twin_gait.simulation.bench_joint.tick import run_ticks
from twin_gait.simulation.binding import bind
from twin_gait.worlds.bench_joint import BenchJoint


def plain_rows(test: BenchJoint, *, seed: int = 0, variation: BenchVariation | None = None) -> np.ndarray:
    """Return the rows of :func:`twin_gait.simulation.simulate_bench`, about a hundred times slower."""
    ticks = max(1, round(test.duration / TICK))
    episode = bench_episode(test, variation or BenchVariation())
    rows, noise = np.zeros((ticks, len(LAYOUT.names))), bench_noise(test, ticks, seed).reshape(-1, 1).tolist()
    found = {"log_row": lambda e, tick: rows[tick], "noise_row": lambda e, number: noise[number]}
    names = {**bound_rooms(episode.friction.law > ROTATIONAL), **found}
    return rows[: bind(run_ticks, names)(episode, 0, ticks)]
