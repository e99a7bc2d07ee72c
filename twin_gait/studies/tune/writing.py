"""The folder of a tuning: ``table.yaml``, ``tune.json``, ``report.html`` and the figures."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin_gait.configuration.documents import dump_yaml
from twin_gait.exceptions import RunDirectoryError
from twin_gait.experiment import Experiment
from twin_gait.files import write_atomically
from twin_gait.report.tune import draw_pictures
from twin_gait.report.tune_page import page
from twin_gait.studies.jobs import Workers
from twin_gait.studies.tune.outcome import (
    choose,
    final_table,
    gait_curves,
    outcome,
    walk_departures,
)
from twin_gait.studies.tune.settings import Settings
from twin_gait.studies.tune.tuning import Tuning

TABLE_FILE, OUTCOME_FILE, REPORT_FILE, FIGURES_FOLDER = "table.yaml", "tune.json", "report.html", "figures"


@dataclass(frozen=True)
class TuningFolder:
    """What was written.

    Attributes:
        directory: Where.
        outcome: Content of ``tune.json``.
    """

    directory: Path
    outcome: dict[str, Any]


def write_tuning(
    tuning: Tuning,
    experiment: Experiment,
    settings: Settings,
    directory: Path,
    *,
    wearer: str,
    workers: Workers | None = None,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> TuningFolder | None:
    """Choose the table, see how it degrades, and write everything beside the state.

    Args:
        tuning: Completed.
        experiment: What it was tuned for.
        settings: How.
        directory: The folder of :func:`twin_gait.studies.tune.tune.tune`.
        wearer: For whom, in words.
        workers: Who walks; the calling process if None.
        progress: Called with walks done and in all.
        should_stop: Asked before each walk.

    Returns:
        What was written; None if it was stopped before.

    Raises:
        ParameterError: If no table passes the check.
        RunDirectoryError: If something cannot be written.
    """
    directory = directory.expanduser().absolute()
    assert tuning.before is not None  # a completed tuning has it
    chosen = choose(tuning, experiment)
    table = final_table(chosen, experiment, wearer, tuning.began_with)
    start = tuning.before.table
    departed = walk_departures(
        start,
        table,
        experiment,
        settings,
        workers or Workers(),
        progress=progress,
        should_stop=should_stop,
    )
    if departed is None:
        return None
    result = outcome(tuning, chosen, experiment, settings, wearer, departed)
    pictures = draw_pictures(result, gait_curves(start, table, experiment, settings))
    _write(directory, table, result, pictures)
    return TuningFolder(directory, result)


def _write(
    directory: Path, table: dict[str, Any], result: dict[str, Any], pictures: dict[str, bytes]
) -> None:
    folder = directory / FIGURES_FOLDER
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise RunDirectoryError(f"{folder}: cannot be written ({error.strerror})") from error
    for name, picture in pictures.items():
        write_atomically(folder / f"{name}.png", picture)
    write_atomically(directory / REPORT_FILE, page(result, pictures))
    write_atomically(directory / TABLE_FILE, dump_yaml(table))
    # The last one: where it is, the folder is whole.
    write_atomically(directory / OUTCOME_FILE, json.dumps(result, indent=2, allow_nan=False) + "\n")
