"""Tune a gait table to a wearer: screening, search, robust set, and what came out."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from twin_gait.configuration.documents import experiment_document
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable
from twin_gait.studies.jobs import Workers
from twin_gait.studies.tune.cases import check_walker
from twin_gait.studies.tune.outcome import choose
from twin_gait.studies.tune.settings import Settings, identity
from twin_gait.studies.tune.space import with_own_sides
from twin_gait.studies.tune.stages import Stages, Stopped
from twin_gait.studies.tune.state import open_state, write_state
from twin_gait.studies.tune.tuning import Progress, Tuning
from twin_gait.studies.tune.walks import experiment_of


def tune(
    experiment: Experiment,
    directory: Path,
    settings: Settings,
    *,
    workers: Workers | None = None,
    resume: bool = False,
    force: bool = False,
    progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> Tuning:
    """Screen, search and rank, keeping the state in a folder after every step.

    The result depends on the experiment, the settings and the number of generations, neither on the workers
    nor on how often it was stopped and resumed.

    Args:
        experiment: A treadmill with a wearer, and the table that is to be bettered. Where it is a shipped
            one, the search begins with that shipped one that suits the person best.
        directory: The folder; see :func:`twin_gait.studies.tune.state.open_state`.
        settings: How.
        workers: Who walks; the calling process if None.
        resume: Whether to go on with what is in the folder.
        force: Whether an earlier tuning may be replaced.
        progress: Called after every step.
        should_stop: Asked before each walk; True ends the tuning, which can be resumed.
        on_compile: Called if the engine has to be compiled, which takes 10 to 20 s.

    Returns:
        What it came to.

    Raises:
        MissingOptionalDependency: If cma or SALib is not installed.
        ParameterError: If there is nothing to tune, or the settings make no sense.
        ParameterFileError: If a walk could not be run.
        RunDirectoryError: If the folder may not be used.
        WorkersLost: If workers die again and again; what was done is kept.
    """
    check_walker(experiment)
    if settings.per_side:
        experiment = replace(experiment, table=with_own_sides(experiment.table))
    directory = directory.expanduser().absolute()
    own = identity(experiment, settings)
    state = open_state(directory, own, resume=resume, force=force)
    # One that came to nothing leaves a folder that can be resumed.
    write_state(state, directory)
    work = Stages(experiment, settings, workers or Workers(), state, directory, progress, should_stop)
    try:
        return work.everything(on_compile)
    except Stopped:
        work.keep()
        return work.unfinished()


def tuned_table(
    experiment: Experiment,
    *,
    minutes: float = 10.0,
    generations: int | None = None,
    seed: int = 0,
    screening: bool = True,
    workers: Workers | None = None,
) -> GaitTable:
    """The gait table that a tuning finds, without folder and report (``twin-gait tune`` writes both).

    Args:
        experiment: A treadmill with a wearer, and the table that is to be bettered.
        minutes: Time for everything, unless ``generations`` are given.
        generations: Of the search; with a number the result does not depend on the machine's speed.
        seed: Of screening, search and sensor noise.
        screening: Whether the search is narrowed to the numbers that matter.
        workers: Who walks; the calling process if None.

    Returns:
        The best table that passes ``twin-gait check``.

    Raises:
        MissingOptionalDependency: If cma or SALib is not installed.
        ParameterError: If there is nothing to tune, or no table passes the check.
    """
    settings = Settings(minutes=minutes, generations=generations, seed=seed, screening=screening)
    with tempfile.TemporaryDirectory() as folder:
        chosen = choose(tune(experiment, Path(folder) / "tuning", settings, workers=workers), experiment)
    return experiment_of(experiment_document(experiment), chosen.finalist.table, {}).table
