"""Make figures again, side by side in processes."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from twin_gait.report.canvas import picture_bytes
from twin_gait.scenario.bench_joint import bench_joint
from twin_gait.simulation.bench_joint import simulate_bench
from twin_gait.simulation.run import RunStatus
from twin_gait.studies.jobs import run_jobs
from twin_gait.studies.reproduction.claim import Claim
from twin_gait.studies.reproduction.recipes import find_recipes
from twin_gait.vocabulary import JointName


@dataclass(frozen=True)
class Made:
    """What a recipe made, with its figure drawn, so that it can cross from one process to another.

    Attributes:
        key: Of the recipe.
        title: What it shows.
        text: A paragraph.
        claims: Numbers side by side.
        readings: Where the thesis contradicts itself.
        picture: The figure as PNG.
    """

    key: str
    title: str
    text: str
    claims: tuple[Claim, ...]
    readings: tuple[str, ...]
    picture: bytes


@dataclass(frozen=True)
class ReproductionResult:
    """A whole reproduction.

    Attributes:
        made: Figures in the order of the thesis.
        seed: Of everything that chance decides.
        status: Completed, or interrupted with the figures so far.
    """

    made: tuple[Made, ...]
    seed: int
    status: RunStatus

    @property
    def failed(self) -> tuple[tuple[str, Claim], ...]:
        """Predicted numbers that left their bands, each with the key of its figure."""
        return tuple((item.key, claim) for item in self.made for claim in item.claims if claim.holds is False)


def run_recipes(
    keys: Sequence[str],
    seed: int,
    *,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> ReproductionResult:
    """Make figures.

    Args:
        keys: Of the recipes; empty for all.
        seed: Of everything that chance decides.
        workers: Processes.
        progress: Called with figures done and in all.
        should_stop: Asked after each figure; True ends with the figures so far.
        on_compile: Called if the loop of the bench has to be compiled.

    Returns:
        The figures with their claims.

    Raises:
        ParameterError: If there is no recipe of a key.
    """
    recipes = find_recipes(keys)
    # Compiled here, so that the processes find it and the user is told.
    simulate_bench(bench_joint(JointName.KNEE, duration=1e-3), on_compile=on_compile)
    with tempfile.TemporaryDirectory(prefix="twin_gait_reproduction_") as folder:
        made = run_jobs(
            partial(_make, folder, seed),
            [recipe.key for recipe in recipes],
            workers=min(workers, len(recipes)),
            progress=progress,
            should_stop=should_stop,
        )
    status = RunStatus.COMPLETED if len(made) == len(recipes) else RunStatus.INTERRUPTED
    return ReproductionResult(tuple(made), seed, status)


def _make(folder: str, seed: int, key: str) -> Made:
    """Make one figure, in whatever process."""
    recipe = find_recipes([key])[0]
    found = recipe.make(Path(folder), seed)
    return Made(
        recipe.key, recipe.title, found.text, found.claims, found.readings, picture_bytes(found.figure)
    )
