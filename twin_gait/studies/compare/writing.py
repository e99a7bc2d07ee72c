"""The folder of a comparison: one page, its figure, and the numbers as CSV and JSON."""

import math
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from matplotlib.figure import Figure

from twin_gait.files import write_atomically, write_json
from twin_gait.measures.strides import normalise_strides
from twin_gait.palette import REFERENCE_COLOUR
from twin_gait.report.canvas import draw_mean_cycles, picture_bytes
from twin_gait.report.pages import render
from twin_gait.report.reference import reference_cycle
from twin_gait.report.walk_words import describe, lines_of
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.runs.summary import versions
from twin_gait.studies.compare.comparing import Comparison, Interval
from twin_gait.vocabulary import JointName, Side

PAGE_FILE = "compare.html"
COMPARISON = FolderKind("a comparison", PAGE_FILE)
PICTURE_FILE, RUNS_FILE, SUMMARY_FILE = "compare.png", "runs.csv", "compare.json"


class Shown(NamedTuple):
    """A measure as a report shows it."""

    label: str  # what it is, with its unit
    digits: int  # after the point
    meaning: str  # in plain words
    factor: float = 1.0  # from the number to what is shown


@cache
def shown_measures(joints: tuple[JointName, ...]) -> dict[str, dict[str, Shown]]:
    """Measures that a report on these joints shows, by group and name."""
    others = set(JointName) - set(joints)
    text = Path(__file__).with_name("measures.yaml").read_text(encoding="utf-8")
    groups = yaml.safe_load(text)
    return {
        group: {name: Shown(**row) for name, row in rows.items() if name.partition("_")[0] not in others}
        for group, rows in groups.items()
    }


def text_of(found: Interval, shown: Shown) -> str:
    """A number as the table shows it: ``12.3 ± 0.4``; a dash where there is none."""
    if math.isnan(found.mean):
        return "–"
    if math.isinf(found.mean):
        return "∞"
    numbers = [shown.factor * value for value in (found.mean, found.half_width) if not math.isnan(value)]
    # No minus before a zero.
    texts = [f"{round(value, shown.digits) + 0.0:.{shown.digits}f}" for value in numbers]
    return " ± ".join(texts).replace("-", "−")


def write_comparison(comparison: Comparison, who: str, target: Path, *, force: bool = False) -> None:
    """Write the folder of a comparison; it appears when all is written."""
    with staged_directory(target, COMPARISON, force=force) as staging:
        picture = picture_bytes(figure_of(comparison))
        write_atomically(staging / PICTURE_FILE, picture)
        write_atomically(staging / PAGE_FILE, page_of(comparison, who, picture))
        write_atomically(staging / RUNS_FILE, comparison.table.to_csv(index=False, lineterminator="\n"))
        write_json(staging / SUMMARY_FILE, summary_of(comparison, who))


def subtitle_of(comparison: Comparison, who: str) -> str:
    """The wearer, the walk, and how long and how often, in one line."""
    experiment = comparison.experiment
    days = f"{comparison.seeds} days" if comparison.seeds > 1 else "one run"
    walk = describe(experiment)
    often = " each, mean ± 95 % interval" if comparison.seeds > 1 else " each"
    return f"{who}, {walk}, {experiment.duration:g} s, {days}{often}"


Rows = list[tuple[Shown, list[str]]]


def rows_of(comparison: Comparison) -> dict[str, Rows]:
    """Measures by group, each with its number for every controller."""
    names = [item.name for item in comparison.controllers]
    walked = Shown(f"walked [of {comparison.seeds}]", 0, "runs to the end without a fall or a stop")
    groups: dict[str, Rows] = {"runs": [(walked, [str(comparison.walked(name)) for name in names])]}
    for group, measures in shown_measures(comparison.experiment.joints).items():
        groups[group] = [
            (shown, [text_of(comparison.interval(name, measure), shown) for name in names])
            for measure, shown in measures.items()
        ]
    return groups


def lines_of_comparison(comparison: Comparison) -> list[str]:
    """The table of measures for a terminal, controllers by the names of the command line."""
    rows = [(shown.label, *cells) for group in rows_of(comparison).values() for shown, cells in group]
    return list(lines_of([("", *(item.name for item in comparison.controllers)), *rows]))


def page_of(comparison: Comparison, who: str, picture: bytes) -> str:
    """The report as HTML."""
    content = {
        "title": "Controllers compared",
        "subtitle": subtitle_of(comparison, who),
        "controllers": comparison.controllers,
        "groups": rows_of(comparison),
        "figure": picture,
    }
    return render("compare.html", content)


def figure_of(comparison: Comparison) -> Figure:
    """The figure of the nominal day: mean cycles of those that walked beside the reference."""
    nominal = comparison.table[comparison.table["seed"] == 0].set_index("controller")
    strode = nominal.reindex(columns=["stride_time_s"]).dropna().index
    walked = [item for item in comparison.controllers if item.name in strode]
    healthy = "healthy, same speed"
    styles = {item.title: {"color": item.colour, "linewidth": 1.5} for item in walked}
    styles[healthy] = {"color": REFERENCE_COLOUR, "linestyle": ":", "linewidth": 1.5}
    curves = dict[str, dict[str, np.ndarray]]()
    for joint, side in product(comparison.experiment.joints, Side):
        place = curves[f"{side} {joint}"] = {}
        for item in walked:
            record = comparison.runs[item.name].leg_record(side)
            cycles = normalise_strides(record.angles[joint], record.strides())
            place[item.title] = np.degrees(cycles.mean(axis=0))
        reference = reference_cycle(comparison.experiment, joint)
        if reference is not None:
            place[healthy] = np.degrees(reference)
    return draw_mean_cycles(curves, styles, (13.0 * len(curves) / 6, 3.3))


def summary_of(comparison: Comparison, who: str) -> dict[str, Any]:
    """Means and intervals."""
    return {
        "patient": who,
        "subtitle": subtitle_of(comparison, who),
        "seeds": comparison.seeds,
        "versions": versions(),
        "controllers": {
            item.name: {"walked": comparison.walked(item.name), "numbers": comparison.numbers(item.name)}
            for item in comparison.controllers
        },
    }
