"""Folder of a comparison of conditions: one page, its figure for screen and paper, and the numbers."""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from twin_gait import palette
from twin_gait.files import to_json_value, write_atomically, write_json
from twin_gait.labels import label_of
from twin_gait.measures.strides import PERCENT
from twin_gait.report import canvas
from twin_gait.report.failures import failed_pictures
from twin_gait.report.figures import INCH, PRINT_SETTINGS
from twin_gait.report.formatting import DASH, amount, format_table
from twin_gait.report.pages import render
from twin_gait.runs.folders import staged_directory
from twin_gait.runs.summary import software_versions
from twin_gait.studies.compare import conditions as compared
from twin_gait.studies.compare.comparison import CONFIDENCE
from twin_gait.studies.compare.conditions import Condition
from twin_gait.studies.compare.writing import COMPARISON, PAGE_FILE, PICTURE, SUMMARY_FILE
from twin_gait.vocabulary import JointName

DIFFERENCES_FILE, CURVES_FILE = "differences.csv", "curves.csv"
PRINT_WIDTHS = (85.0, 174.0)  # [mm], one and two columns of a paper
COLOURS = (
    palette.BLACK, palette.VERMILLION, palette.BLUE, palette.BLUISH_GREEN, palette.ORANGE,
    palette.REDDISH_PURPLE,
)  # fmt: skip
MOST_DECIMALS = 4
SMALLEST_SHARE = 1e-9  # share of a mean below which a difference is one of rounding
BAND = 0.22  # opacity of a band
NUMBERS = ("first_mean", "first_sd", "second_mean", "second_sd", "difference", "low", "high")
# Ends of the names of the measures that the terminal shows.
MAIN_MEASURES = (
    "stride_time_s", "swing_share", "step_length_m", "onset_percent", "error_total_deg",
    "range_of_motion_deg",
)  # fmt: skip


def write_conditions(
    found: Sequence[Condition], target: Path, *, force: bool = False
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Write the folder of a comparison; return the table of differences and the summary."""
    table = difference_table(found)
    summary = {
        "conditions": {item.name: item.table.groupby("side").size().to_dict() for item in found},
        "confidence": CONFIDENCE,
        "curves": "spm1d" if compared.has_spm1d() else "bootstrap",
        "spans": [{**row, "spans_percent": spans} for row, spans in _spans(found)],
        "versions": software_versions(),
    }
    with staged_directory(target, COMPARISON, force=force) as staging:
        drawings = {PICTURE: partial(draw_conditions, found)} if found[0].curves else {}
        pictures = canvas.write_pictures(drawings, staging)
        for width in PRINT_WIDTHS if drawings else ():
            with canvas.standard_settings(PRINT_SETTINGS):
                figure = draw_conditions(found, width=width / INCH)
            canvas.save(figure, staging / f"{PICTURE}-{width:g}mm.pdf")
        write_atomically(staging / DIFFERENCES_FILE, table.to_csv(index=False, lineterminator="\n"))
        curves = compared.curves_table(found).to_csv(index=False, lineterminator="\n")
        write_atomically(staging / CURVES_FILE, curves)
        write_atomically(staging / PAGE_FILE, render_page(table, summary, pictures.written.get(PICTURE)))
        summary = to_json_value(summary | failed_pictures(pictures.failed))
        write_json(staging / SUMMARY_FILE, summary)
    return table, summary


def difference_table(found: Sequence[Condition]) -> pd.DataFrame:
    """Return the differences of all conditions from the first one, with the names of both."""
    tables = []
    for other in found[1:]:
        rows = compared.differences(found[0], other)
        rows.insert(0, "second", other.name)
        rows.insert(0, "first", found[0].name)
        tables.append(rows)
    return pd.concat(tables, ignore_index=True)


def _spans(found: Sequence[Condition]) -> list[tuple[dict[str, str], list[tuple[int, int]]]]:
    """Return the spans of the stride in which a mean curve differs from that of the first condition."""
    rows = []
    for other in found[1:]:
        for (side, joint), apart in compared.curve_differences(found[0], other).items():
            if apart is not None:
                rows.append(({"second": other.name, "side": str(side), "joint": str(joint)}, apart.spans))
    return rows


def format_rows(rows: pd.DataFrame) -> list[list[tuple[str, bool]]]:
    """Format the differences of two conditions for people, a row for each measure.

    Returns name, then mean ± SD of both and the difference with its interval for each side; each with
    whether it is a difference whose interval excludes zero.
    """
    sides, found = list(dict.fromkeys(rows["side"])), []
    for measure, group in rows.groupby("measure", sort=False):
        label, by_side = label_of(str(measure)), {row["side"]: row for _, row in group.iterrows()}
        cells = [(label.title, False)]
        for side in sides:
            if side not in by_side:
                cells += [(DASH, False)] * 3
                continue
            shown = label.factor * by_side[side][list(NUMBERS)].astype(float)
            for name in ("first", "second"):
                cells.append((_with_spread(*shown[[f"{name}_mean", f"{name}_sd"]]), False))
            scale = SMALLEST_SHARE * shown[["first_mean", "second_mean"]].abs().max()
            apart = bool(shown["low"] > scale or shown["high"] < -scale)
            cells.append((_with_interval(*shown[["difference", "low", "high"]]), apart))
        found.append(cells)
    return found


def _with_spread(mean: float, deviation: float) -> str:
    return _rounded(deviation, mean) + (
        "" if math.isnan(deviation) else f" ± {_rounded(deviation, deviation)}"
    )


def _with_interval(difference: float, low: float, high: float) -> str:
    width = high - low
    interval = "" if math.isnan(width) else f" [{_rounded(width, low)}, {_rounded(width, high)}]"
    return _rounded(width, difference) + interval


def _rounded(spread: float, value: float) -> str:
    """Format a number with as many decimals as its spread has in two significant digits, at most 4."""
    if math.isnan(spread) or spread == 0.0:
        return amount(value)
    decimals = min(max(1 - math.floor(math.log10(spread)), 0), MOST_DECIMALS)
    return f"{round(value, decimals) + 0.0:.{decimals}f}".replace("-", "−")


def heads(rows: pd.DataFrame) -> list[str]:
    """Return the head of the table of :func:`format_rows`."""
    first, second = rows["first"].iloc[0], rows["second"].iloc[0]
    cells = [[f"{side}: {first}", f"{side}: {second}", "difference [95 %]"] for side in rows["side"].unique()]
    return ["", *(cell for group in cells for cell in group)]


def format_conditions(table: pd.DataFrame) -> list[str]:
    """Return the differences of the main measures as lines for a terminal."""
    lines = list[str]()
    shown = table[table["measure"].str.endswith(MAIN_MEASURES)]
    for _, rows in shown.groupby("second", sort=False):
        lines += format_table([heads(rows), *([text for text, _ in cells] for cells in format_rows(rows))])
    return lines


def _groups(rows: pd.DataFrame) -> dict[str, list[list[tuple[str, bool]]]]:
    """Return the formatted rows by joint; those of the whole leg come first."""
    first_words = rows["measure"].str.partition("_")[0]
    joint = first_words.where(first_words.isin(list(JointName)), "leg")
    return {str(name): format_rows(part) for name, part in rows.groupby(joint, sort=False)}


def render_page(table: pd.DataFrame, summary: dict[str, Any], picture: bytes | None) -> str:
    """Return the page as HTML."""
    counts = [
        f"{name}: " + ", ".join(f"{number} {side}" for side, number in sides.items())
        for name, sides in summary["conditions"].items()
    ]
    parts = [(heads(rows), _groups(rows)) for _, rows in table.groupby("second", sort=False)]
    content = {
        "title": "Conditions compared", "subtitle": "settled strides: " + "; ".join(counts),
        "tables": parts, "figure": picture, "curves": summary["curves"], "spans": summary["spans"],
    }  # fmt: skip
    return render("conditions.html", content)


def draw_conditions(found: Sequence[Condition], *, width: float = canvas.SCREEN_WIDTH) -> Figure:
    """Draw mean ± SD of the angles of all conditions, and below each the difference from the first one.

    ``width``: width of the figure in inches.
    """
    keys = [key for key in found[0].curves if all(key in item.curves for item in found)]
    sides, joints = (list(dict.fromkeys(key[place] for key in keys)) for place in (0, 1))
    row = max(1.05, 0.13 * width)  # [inches] height of a panel with its difference, over 1.6
    figure = Figure(figsize=(width, 1.6 * row * len(joints) + 0.7), layout="constrained")
    heights = [1.0, 0.6] * len(joints)
    panels = figure.subplots(
        2 * len(joints), len(sides), squeeze=False, sharex=True, sharey="row", height_ratios=heights
    )
    thin, lines = 0.6 if width < canvas.SCREEN_WIDTH else 1.0, dict[str, Line2D | Patch]()
    for side, joint in keys:
        column, place = sides.index(side), 2 * joints.index(joint)
        above, below = panels[place, column], panels[place + 1, column]
        labels = (label_of(f"{joint}_angle_rad").axis, "Δθ [°]") if column == 0 else ("", "")
        canvas.style_panel(above, f"{side} {joint}", labels[0])
        canvas.style_panel(below, "", labels[1])
        below.axhline(0.0, color="0.6", linewidth=0.8 * thin)
        for item, colour in zip(found, COLOURS, strict=False):
            curves, style = item.curves[side, joint], {"color": colour, "linewidth": 1.8 * thin}
            mean, area = curves.mean(axis=0), {"color": colour, "alpha": BAND, "linewidth": 0}
            lines[item.name] = above.plot(PERCENT, mean, **style, label=item.name)[0]
            if len(curves) > 1:
                spread, label = curves.std(axis=0, ddof=1), "mean ± SD over strides"
                above.fill_between(PERCENT, mean - spread, mean + spread, **area)
                lines[label] = Patch(color="0.5", alpha=BAND, label=label)
            if item is found[0]:
                continue
            apart = compared.curve_difference(found[0].curves[side, joint], curves)
            if apart is not None:
                label = f"Δθ from {found[0].name}, 95 % band"
                below.plot(PERCENT, apart.mean, **style)
                edges = apart.mean - apart.half_width, apart.mean + apart.half_width
                below.fill_between(PERCENT, *edges, **area, hatch="///")
                lines[label] = Patch(facecolor="0.8", edgecolor="0.5", hatch="///", linewidth=0, label=label)
        above.set_xlim(PERCENT[0], PERCENT[-1])
    for axes in panels[-1]:
        axes.set_xlabel("share of the gait cycle [%]")
    with mpl.rc_context({"hatch.linewidth": 0.4}):
        canvas.put_legend(figure, list(lines.values()))
    return figure
