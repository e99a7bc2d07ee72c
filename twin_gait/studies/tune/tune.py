"""Tune a gait table to a wearer: search, robust set, and the choice of the table."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from twin_gait.checking.check import build_case, check
from twin_gait.checking.finding import Finding, Severity
from twin_gait.exceptions import ParameterError
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable
from twin_gait.studies.jobs import Stop, Workers
from twin_gait.studies.tune.cases import check_walker
from twin_gait.studies.tune.space import with_own_sides
from twin_gait.studies.tune.stages import Stages, Stopped
from twin_gait.studies.tune.state import (
    Finalist,
    Progress,
    Settings,
    Tuning,
    identity,
    open_state,
    write_state,
)
from twin_gait.studies.tune.walks import table_of
from twin_gait.worlds.scenario import BELT_SPEED


def tune(
    experiment: Experiment,
    directory: Path,
    settings: Settings,
    *,
    workers: Workers | None = None,
    resume: bool = False,
    force: bool = False,
    progress: Callable[[Progress], None] | None = None,
    should_stop: Stop | None = None,
    on_compile: Callable[[], None] | None = None,
) -> Tuning:
    """Search and rank, keeping the state in a folder after every step.

    The result depends on the experiment, the settings and the number of generations, neither on the workers
    nor on how often it was stopped and resumed.

    Args:
        experiment: A wearer who walks on the ground, and the table that is to be bettered.
        resume: Whether to go on with what is in the folder.
        force: Whether an earlier tuning may be replaced.
        should_stop: Asked before each walk; True ends the tuning, which can be resumed.

    Raises:
        ParameterError: If there is nothing to tune, or the settings make no sense.
        ParameterFileError: If a walk could not be run.
        RunDirectoryError: If the folder may not be used.
    """
    check_walker(experiment)
    if (settings.everyone or settings.reference_speed) and not experiment.scenario.adjusts(BELT_SPEED):
        raise ParameterError(
            f"{experiment.name}: has no belt; leave out --everyone (other belts) and --reference (its speed)"
        )
    if settings.per_side:
        experiment = replace(experiment, table=with_own_sides(experiment.table))
    directory = directory.expanduser().absolute()
    own = identity(experiment, settings)
    state = open_state(directory, own, resume=resume, force=force)
    # One that is stopped at once leaves a folder that can be resumed.
    write_state(state, directory)
    work = Stages(experiment, settings, workers or Workers(), state, directory, progress, should_stop)
    try:
        return work.everything(on_compile)
    except Stopped:
        work.keep()
        return work.unfinished()


def tuned_table(experiment: Experiment, *, workers: Workers | None = None, **settings: Any) -> GaitTable:
    """The gait table that a tuning finds, without folder and report (``twin-gait tune`` writes both).

    Args:
        experiment: A wearer who walks on the ground, and the table that is to be bettered.
        workers: Processes or a cluster that execute the walks; the calling process if None.
        **settings: Those of :class:`twin_gait.studies.tune.state.Settings`: ``minutes`` for everything
            (3), or ``generations`` of the search, with which the result does not depend on the machine's
            speed; ``seed``; ``search_duration`` and ``robust_duration`` of a walk in [s].

    Raises:
        ParameterError: If there is nothing to tune, or no table passes the check.
    """
    with tempfile.TemporaryDirectory() as folder:
        tuning = tune(experiment, Path(folder) / "tuning", Settings(**settings), workers=workers)
        chosen = choose(tuning, experiment)
    return table_of(chosen.finalist.table)


class Chosen(NamedTuple):
    """The table that is written."""

    finalist: Finalist  # it
    findings: tuple[Finding, ...]  # of the whole check
    refused: int  # finalists before it that the check found errors in


def choose(tuning: Tuning, experiment: Experiment) -> Chosen:
    """Take the best finalist whose table passes every error rule of the check, or ParameterError."""
    for refused, finalist in enumerate(tuning.ranked):
        findings = check(build_case(table_of(finalist.table), experiment))
        if not any(item.severity is Severity.ERROR for item in findings):
            return Chosen(finalist, tuple(findings), refused)
    raise ParameterError(
        f"table {experiment.table.name}: no candidate passes twin-gait check, nor does the table itself; "
        "mend its errors first"
    )


def final_table(chosen: Chosen, experiment: Experiment, wearer: str) -> dict[str, Any]:
    """Document of the table, with a name and a description of its own."""
    start = experiment.table.name
    origin = (
        f"The table {start} as it was: the search found nothing better for {wearer}."
        if chosen.finalist.points is None
        else f"Tuned by twin-gait tune from the table {start} for {wearer}. Found in simulation; "
        "nothing here was measured on a person."
    )
    document = {**chosen.finalist.table, "name": f"{start}_tuned", "description": origin}
    table_of(document)
    return document
