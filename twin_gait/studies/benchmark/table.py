"""A benchmark as text: aligned tables and verdicts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from twin_gait.studies.benchmark.ratios import Verdict

DOCUMENT, PICTURE = "benchmark.json", "benchmark.png"  # what a benchmark leaves in a folder
QUIET_SHARE = 0.9  # less of a processor than this, and something else was running

COLUMNS = (
    "subject",
    "contestant",
    "ns per tick",
    "quartiles",
    "of processor",
    "x real time",
    "x compiled",
    "error rad",
)


def draw_benchmark(document: Mapping[str, Any]) -> str:
    """Draw a benchmark as aligned tables.

    Args:
        document: From :func:`twin_gait.studies.benchmark.benchmark.benchmark`.

    Returns:
        Text: machine, contestants, what is missing, and the verdicts.
    """
    blocks = [_machine_line(document)]
    for case in document["cases"]:
        rows: list[tuple[str, ...]] = [COLUMNS]
        rows += [_cells(case, row) for row in case["rows"]]
        blocks.append(_aligned(rows))
    if "walk" in document:
        blocks.append(_walk_line(document["walk"]))
    if "scaling" in document:
        blocks += [_joints_table(document["scaling"]["joints"]), _batch_table(document["scaling"]["batch"])]
    blocks += [f"left out: {line}" for line in document["left_out"]]
    blocks.append(draw_verdicts([Verdict(**row) for row in document["verdicts"]]))
    return "\n\n".join(blocks)


def _machine_line(document: Mapping[str, Any]) -> str:
    before = document["machine_before"]
    loads = f"load {before['load_average'][0]:g} before, {document['load_average_after'][0]:g} after"
    line = f"{before['processor']}, {before['cores']} cores, {loads}, medians of {document['rounds']} rounds"
    share = min(
        row["processor_share"] for case in document["cases"] for row in case["rows"] if row["episodes"] == 1
    )
    if share > QUIET_SHARE:
        return line
    return (
        f"{line}\nTHE MACHINE WAS BUSY: some contestants had a processor for {share:.0%} of their time only"
    )


def _cells(case: Mapping[str, Any], row: Mapping[str, Any]) -> tuple[str, ...]:
    low, high = row["ns_per_tick_quartiles"]
    own = "batch" if row["episodes"] > 1 else "compiled"
    ratio = row["ratio_to"].get(own)
    error = row["largest_angle_error_rad"]
    return (
        f"{case['subject']}, {case['stepping']}",
        row["contestant"],
        f"{row['ns_per_tick']:,.0f}",
        f"{low:,.0f} to {high:,.0f}",
        f"{row['processor_ns_per_tick']:,.0f}",
        plain_factor(row["realtime_factor"]),
        "-" if ratio is None else f"{ratio:,.1f}{' batch' if own == 'batch' else ''}",
        "-" if error is None or not math.isfinite(error) else f"{error:.1e}",
    )


def plain_factor(factor: float) -> str:
    """A factor without digits that say nothing."""
    return f"{factor:,.0f}" if factor >= 10.0 else f"{factor:.2g}"


def _walk_line(walk: Mapping[str, Any]) -> str:
    return (
        f"{walk['duration_s']:g} s of treadmill at {walk['stepping']}: simulate() {walk['wall_s']:.3f} s, "
        f"of which the loop with its log {walk['loop_wall_s']:.3f} s ({walk['status']})"
    )


def _joints_table(rows: Sequence[Mapping[str, Any]]) -> str:
    names = list(rows[0]["ns_per_evaluation"])
    lines = [("joints of a chain", *(f"{name} ns" for name in names))]
    for row in rows:
        times = [f"{row['ns_per_evaluation'][name]['median']:,.0f}" for name in names]
        lines.append((str(row["joints"]), *times))
    return _aligned(lines)


def _batch_table(rows: Sequence[Mapping[str, Any]]) -> str:
    names = list(rows[0]["ns_per_tick"])
    lines = [("episodes", "threads", *(f"{name} ns per tick" for name in names))]
    for row in rows:
        times = [f"{row['ns_per_tick'][name]['median']:,.0f}" for name in names]
        lines.append((str(row["episodes"]), str(row["workers"]), *times))
    return _aligned(lines)


def draw_verdicts(verdicts: Sequence[Verdict]) -> str:
    """Draw the verdicts on the ratios.

    Args:
        verdicts: From :func:`twin_gait.studies.benchmark.ratios.judge`.

    Returns:
        Text.
    """
    lines = [("goal", "", "measured", "asked for", "")]
    for item in verdicts:
        sign = "at least" if item.unit == "x" else "below"
        figure = "not timed" if item.figure is None else f"{item.figure:.3g} {item.unit}"
        lines.append(
            (
                f"{item.subject}, {item.stepping}",
                item.what,
                figure,
                f"{sign} {item.bound:g} {item.unit}",
                "met" if item.passed else "MISSED",
            )
        )
    return _aligned(lines)


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
    return "\n".join(lines)
