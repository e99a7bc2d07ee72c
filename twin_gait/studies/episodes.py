"""Episodes as jobs: what is alike runs together, on processes of this machine or on a cluster."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from twin_gait.exceptions import TwinGaitError
from twin_gait.experiment import Experiment
from twin_gait.simulation import Run
from twin_gait.simulation.together import EpisodeFailed, block_size, compile_ahead, simulate_together
from twin_gait.studies.jobs import JobFailed, Progress, Stop, Workers, run_blocks
from twin_gait.studies.processes import Item, Result


def run_episodes(
    experiment_of: Callable[[Item], Experiment],
    measure: Callable[[Run], Result],
    items: Sequence[Item],
    *,
    columns: tuple[str, ...] | None = None,
    block: int | None = None,
    workers: int | Workers = 1,
    progress: Progress | None = None,
    should_stop: Stop | None = None,
    on_compile: Callable[[], None] | None = None,
) -> list[Result]:
    """Simulate the experiment of each item and measure the run; a log lives no longer than that.

    Results and errors are those of :func:`twin_gait.studies.run_jobs`, as are the arguments not named here.

    Args:
        experiment_of: Makes the experiment; like ``measure`` and the items it goes to the workers.
        measure: What is kept of a run.
        items: What the experiments are made of.
        columns: What ``measure`` reads of a log, as
            :func:`~twin_gait.simulation.together.simulate_together` takes it; everything by default.
        block: Episodes to hand over at a time, for which the caller has compiled; by default as many as pay.
        on_compile: Called if the engine has to be compiled first, which the workers then need not do.
    """
    if block is None:
        block = block_ahead(lambda: experiment_of(items[0]), len(items), on_compile) if items else 1
    walk = partial(measured, experiment_of, measure, columns)
    return run_blocks(walk, items, block=block, workers=workers, progress=progress, should_stop=should_stop)


def measured(
    experiment_of: Callable[[Item], Experiment],
    measure: Callable[[Run], Result],
    columns: tuple[str, ...] | None,
    items: Sequence[Item],
) -> Iterator[tuple[int, Result]]:
    """Position and measures of the episodes of a block, as :func:`twin_gait.studies.jobs.run_blocks` asks."""
    try:
        for place, run in simulate_together(map(experiment_of, items), columns=columns):
            yield place, measure(run)
    except EpisodeFailed as error:
        raise JobFailed(error.index, error.problem) from error


def block_ahead(
    first: Callable[[], Experiment], total: int, on_compile: Callable[[], None] | None = None
) -> int:
    """Compile for ``total`` episodes before others need it, and tell how many of them to hand over at a time.

    ``first`` makes the experiment of one; a mistake in it is told when its turn comes.
    """
    try:
        experiment = first()
    except TwinGaitError:
        return 1
    compile_ahead(experiment, total, on_compile)
    return block_size(experiment, total)
