"""The folder of a comparison: one page, its figure, and the numbers as CSV and JSON."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from twin_gait import __version__
from twin_gait.files import finite_or_none, write_atomically
from twin_gait.measures.strides import normalise_strides
from twin_gait.report.canvas import picture_bytes
from twin_gait.report.compare import COLOURS, Walked, comparison_page, draw_comparison
from twin_gait.report.reference import reference_cycle
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.runs.record import belt_speed_of, describe
from twin_gait.runs.summary import versions
from twin_gait.simulation.run import Run
from twin_gait.studies.compare.comparing import Comparison, summary_rows
from twin_gait.studies.compare.controllers import CONTROLLERS
from twin_gait.studies.compare.measures_shown import table_rows
from twin_gait.studies.compare.words import paragraphs
from twin_gait.vocabulary import MOTOR_JOINTS, Side

PAGE_FILE = "compare.html"
COMPARISON = FolderKind("a comparison", PAGE_FILE)
PICTURE_FILE, RUNS_FILE, SUMMARY_FILE = "compare.png", "runs.csv", "compare.json"
_BARS = {"device torque, RMS [N m]": ("interaction_rms_Nm", 1.0), "battery [W]": ("battery_power_W", 1.0)}


def write_comparison(comparison: Comparison, who: str, target: Path, *, force: bool = False) -> None:
    """Write the folder of a comparison; it appears when all is written.

    Args:
        comparison: The comparison.
        who: Name of the wearer.
        target: The folder to make.
        force: Whether the folder of an earlier comparison may be replaced.

    Raises:
        RunDirectoryError: If it exists, or cannot be written.
    """
    with staged_directory(target, COMPARISON, force=force) as staging:
        light, dark = (picture_bytes(figure_of(comparison, dark=dark), "none") for dark in (False, True))
        write_atomically(staging / PICTURE_FILE, picture_bytes(figure_of(comparison), "white"))
        write_atomically(staging / PAGE_FILE, page_of(comparison, who, (light, dark)))
        table = comparison.table.to_csv(index=False, lineterminator="\n")
        write_atomically(staging / RUNS_FILE, table)
        write_atomically(staging / SUMMARY_FILE, summary_text(comparison, who))


def subtitle_of(comparison: Comparison, who: str) -> str:
    """Who walks, how fast, how long and how often, in one line."""
    experiment = comparison.experiment
    days = f"{comparison.seeds} days" if comparison.seeds > 1 else "one run"
    walk = describe(experiment.patient, belt_speed_of(experiment))
    often = " each, mean ± 95 % interval" if comparison.seeds > 1 else " each"
    return f"{who}, {walk}, {experiment.duration:g} s, {days}{often}"


def page_of(comparison: Comparison, who: str, pictures: tuple[bytes, bytes]) -> str:
    """The report as HTML.

    Args:
        comparison: The comparison.
        who: Name of the wearer.
        pictures: PNG for a light and for a dark page.

    Returns:
        The page.
    """
    return comparison_page(
        title="Controllers compared",
        subtitle=subtitle_of(comparison, who),
        text=paragraphs(comparison),
        controllers=[(item.title, item.explanation) for item in comparison.controllers],
        rows=table_rows(comparison),
        pictures=pictures,
        version=__version__,
    )


def figure_of(comparison: Comparison, *, dark: bool = False) -> Figure:
    """The figure of the nominal day.

    Args:
        comparison: The comparison.
        dark: For a dark page.

    Returns:
        The figure.
    """
    reference: dict[str, np.ndarray] = {}
    for joint in MOTOR_JOINTS:
        healthy = reference_cycle(comparison.experiment, joint)
        if healthy is not None:
            reference |= {f"{side} {joint}": np.degrees(healthy) for side in Side}
    walked = [
        Walked(
            item.title,
            COLOURS[list(CONTROLLERS).index(item.name)],
            _cycles(comparison.runs[item.name]),
            _bars(comparison, item.name),
        )
        for item in comparison.controllers
        if _nominal(comparison, item.name, "interaction_rms_Nm") is not None
    ]
    return draw_comparison(walked, reference, dark=dark)


def _cycles(run: Run) -> dict[str, np.ndarray]:
    cycles = {}
    for side in run.sides:
        record = run.leg_record(side)
        for joint in MOTOR_JOINTS:
            strides = normalise_strides(record.angles[joint], record.strides())
            cycles[f"{side} {joint}"] = np.degrees(strides.mean(axis=0))
    return cycles


def _bars(comparison: Comparison, name: str) -> dict[str, float]:
    return {
        label: factor * (_nominal(comparison, name, number) or 0.0)
        for label, (number, factor) in _BARS.items()
    }


def _nominal(comparison: Comparison, name: str, number: str) -> float | None:
    """A number of the nominal day, or None where the run has none."""
    if number not in comparison.table:
        return None
    rows = comparison.table[(comparison.table["controller"] == name) & (comparison.table["seed"] == 0)]
    value = float(rows[number].iloc[0])
    return None if math.isnan(value) else value


def summary_text(comparison: Comparison, who: str) -> str:
    """Means, intervals and paragraphs as JSON.

    Args:
        comparison: The comparison.
        who: Name of the wearer.

    Returns:
        The text; null where a number is not defined.
    """
    rows = zip(comparison.controllers, summary_rows(comparison), strict=True)
    document: dict[str, Any] = {
        "patient": who,
        "subtitle": subtitle_of(comparison, who),
        "seeds": comparison.seeds,
        "versions": versions(),
        "paragraphs": paragraphs(comparison),
        "controllers": {
            item.name: {
                "walked": comparison.walked(item.name),
                "numbers": {name: finite_or_none(value) for name, value in row.items()},
            }
            for item, row in rows
        },
    }
    return json.dumps(document, indent=2, allow_nan=False) + "\n"
