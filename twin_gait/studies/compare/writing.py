"""Folder of a comparison: one page, its figure, and the numbers as CSV and JSON."""

import math
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from twin_gait.files import write_atomically, write_json
from twin_gait.labels import label_of
from twin_gait.report.canvas import draw_mean_cycles, write_pictures
from twin_gait.report.failures import failed_pictures
from twin_gait.report.formatting import describe_wearer, format_table
from twin_gait.report.pages import render
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.runs.summary import software_versions
from twin_gait.studies.compare.comparison import Comparison, Interval
from twin_gait.vocabulary import JointName, Outcome
from twin_gait.yaml12 import load_data

PAGE_FILE = "compare.html"
COMPARISON = FolderKind("a comparison", PAGE_FILE)
RUNS_FILE, SUMMARY_FILE = "runs.csv", "compare.json"
PICTURE = "compare"  # name of the PNG file without its suffix


class MeasureFormat(NamedTuple):
    """Presentation of a measure in a report."""

    label: str  # name with its unit
    digits: int  # digits after the decimal point
    meaning: str  # explanation in plain words
    factor: float = 1.0  # factor from the number to the displayed value


@cache
def shown_measures(joints: tuple[JointName, ...]) -> dict[str, dict[str, MeasureFormat]]:
    """Return the measures that a report on these joints shows, by group and name."""
    others = set(JointName) - set(joints)
    groups = load_data(Path(__file__).with_name("measures.yaml"))
    return {
        group: {
            name: MeasureFormat(label_of(name).title, factor=label_of(name).factor, **row)
            for name, row in rows.items()
            if name.partition("_")[0] not in others
        }
        for group, rows in groups.items()
    }


def format_interval(found: Interval, shown: MeasureFormat) -> str:
    """Format a number as the table shows it: ``12.3 ± 0.4``; a dash if there is none."""
    if math.isnan(found.mean):
        return "–"
    if math.isinf(found.mean):
        return "∞"
    numbers = [shown.factor * value for value in (found.mean, found.half_width) if not math.isnan(value)]
    # No minus before a zero.
    texts = [f"{round(value, shown.digits) + 0.0:.{shown.digits}f}" for value in numbers]
    return " ± ".join(texts).replace("-", "−")


def write_comparison(comparison: Comparison, wearer: str, target: Path, *, force: bool = False) -> None:
    """Write the folder of a comparison; it appears when it is complete."""
    with staged_directory(target, COMPARISON, force=force) as staging:
        pictures = write_pictures({PICTURE: partial(draw_comparison, comparison)}, staging)
        write_atomically(
            staging / PAGE_FILE, render_comparison_page(comparison, wearer, pictures.written.get(PICTURE))
        )
        write_atomically(staging / RUNS_FILE, comparison.table.to_csv(index=False, lineterminator="\n"))
        summary = {**comparison_summary(comparison, wearer), **failed_pictures(pictures.failed)}
        write_json(staging / SUMMARY_FILE, summary)


def subtitle_of(comparison: Comparison) -> str:
    """Return the wearer, the walk, its duration and the number of days, in one line."""
    experiment = comparison.experiment
    described = ", ".join(describe_wearer(experiment))
    return f"{described}, {experiment.duration:g} s, days: {comparison.seeds}"


Rows = list[tuple[MeasureFormat, list[str]]]


def report_rows(comparison: Comparison) -> dict[str, Rows]:
    """Return the measures by group, each with its number for every controller."""
    names = [item.name for item in comparison.controllers]
    walked = MeasureFormat(f"walked [of {comparison.seeds}]", 0, "runs to the end without a fall or a stop")
    groups: dict[str, Rows] = {"runs": [(walked, [str(comparison.walked(name)) for name in names])]}
    for group, measures in shown_measures(comparison.experiment.joints).items():
        groups[group] = [
            (shown, [format_interval(comparison.interval(name, measure), shown) for name in names])
            for measure, shown in measures.items()
        ]
    return groups


def format_comparison(comparison: Comparison) -> list[str]:
    """Return the table of measures for a terminal, with the controllers' names on the command line."""
    rows = [(shown.label, *cells) for group in report_rows(comparison).values() for shown, cells in group]
    return list(format_table([("", *(item.name for item in comparison.controllers)), *rows]))


def render_comparison_page(comparison: Comparison, wearer: str, picture: bytes | None) -> str:
    """Return the report as HTML."""
    content = {
        "title": "Controllers compared",
        "subtitle": subtitle_of(comparison),
        "controllers": comparison.controllers,
        "groups": report_rows(comparison),
        "figure": picture,
    }
    return render("compare.html", content)


def draw_comparison(comparison: Comparison) -> Figure:
    """Draw the mean strides of all controllers that walked on the nominal day."""
    runs = {item.title: comparison.runs[item.name] for item in comparison.controllers}
    walked = {name: run for name, run in runs.items() if run.verdict.outcome is Outcome.WALKED}
    colours = {item.title: item.colour for item in comparison.controllers}
    return draw_mean_cycles(comparison.experiment, walked, colours)


def comparison_summary(comparison: Comparison, wearer: str) -> dict[str, Any]:
    """Return means and intervals as numbers, and the table of the report as texts."""
    names = [item.name for item in comparison.controllers]
    rows = [row for group in report_rows(comparison).values() for row in group]
    return {
        "patient": wearer,
        "subtitle": subtitle_of(comparison),
        "seeds": comparison.seeds,
        "versions": software_versions(),
        "controllers": {
            item.name: {"walked": comparison.walked(item.name), "numbers": comparison.numbers(item.name)}
            for item in comparison.controllers
        },
        "table": [{"": shown.label, **dict(zip(names, cells, strict=True))} for shown, cells in rows],
    }
