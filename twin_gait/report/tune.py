"""Pictures of a tuning: gait before and after, named parts, what matters, convergence, departures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from twin_gait.measures.strides import PERCENT
from twin_gait.palette import BLACK, BLUE, GREY, JOINT_COLOURS, REFERENCE_COLOUR, VERMILLION
from twin_gait.report.canvas import picture_bytes, put_legend, readable, style_panel
from twin_gait.vocabulary import MOTOR_JOINTS, JointName, Side

BEFORE_COLOUR, AFTER_COLOUR = GREY, BLUE
_SIDE_LINES: dict[str, Any] = {str(Side.LEFT): "-", str(Side.RIGHT): "--"}
MOST_EFFECTS = 30  # bars that fit a figure; the table of the report has all

Curves = Mapping[str, Mapping[str, np.ndarray]]
Outcome = Mapping[str, Any]


def draw_pictures(outcome: Outcome, curves: Curves) -> dict[str, bytes]:
    """Draw all figures.

    Args:
        outcome: Content of ``tune.json``.
        curves: Mean cycles in [deg] by joint; see :func:`draw_gait`.

    Returns:
        PNG by name.
    """
    figures = {
        "gait": draw_gait(curves),
        "parts": draw_parts(outcome["parts"]),
        "convergence": draw_convergence(outcome["convergence"], outcome["worst_cost"]),
        "departures": draw_departures(outcome["departures"]),
    }
    if outcome["screening"]:
        figures["screening"] = draw_screening(outcome["screening"])
    return {name: picture_bytes(figure) for name, figure in figures.items()}


def draw_gait(curves: Curves) -> Figure:
    """Draw mean cycles before and after.

    Args:
        curves: By joint: ``reference`` and such as ``before left``, in [deg] at ``PERCENT``.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    for place, joint in enumerate(MOTOR_JOINTS):
        axes = figure.add_subplot(1, 2, place + 1)
        for name, curve in curves[str(joint)].items():
            axes.plot(PERCENT, curve, **_line(name))
        style_panel(axes, f"{joint}, mean stride", "flexion [°]")
        axes.set_xlabel("share of the stride, from foot contact [%]")
        axes.set_xlim(PERCENT[0], PERCENT[-1])
    names = ["reference", *(f"{which} {side}" for which in ("before", "after") for side in Side)]
    put_legend(figure, [Line2D([], [], label=_label(name), **_line(name)) for name in names])
    return figure


def draw_parts(parts: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw every part as a share of its goal, before and after.

    Args:
        parts: Of the outcome.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    rows = np.arange(len(parts))[::-1]
    for shift, which, colour in ((0.2, "before", BEFORE_COLOUR), (-0.2, "after", AFTER_COLOUR)):
        shares = [100.0 * part[which] / part["goal"] if part[which] is not None else 0.0 for part in parts]
        axes.barh(rows + shift, shares, height=0.36, color=colour, label=which)
        for row, share, part in zip(rows, shares, parts, strict=True):
            axes.annotate(
                amount(part[which], part["unit"]),
                (share, row + shift),
                xytext=(3, 0),
                textcoords="offset points",
                va="center",
                fontsize=8,
            )
    axes.axvline(100.0, color=BLACK, linewidth=0.9, linestyle=":")
    axes.set_yticks(rows, [part["title"] for part in parts])
    for label, part in zip(axes.get_yticklabels(), parts, strict=True):
        label.set_color(VERMILLION if part["verdict"] == "traded" else BLACK)
    style_panel(axes, "the person tuned for: less is better, the dotted line is the goal", "")
    axes.set_xlabel("share of the goal [%]")
    axes.margins(x=0.12)
    axes.legend(frameon=False, loc="lower right")
    return figure


def draw_screening(effects: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw what matters: mean elementary effects with their intervals.

    Args:
        effects: Of the outcome; the largest are shown.

    Returns:
        The figure.
    """
    ranked = sorted(effects, key=lambda item: -item["mu_star"])[:MOST_EFFECTS]
    figure = Figure(figsize=(11.0, 1.4 + 0.23 * len(ranked)), layout="constrained")
    axes = figure.add_subplot()
    rows = np.arange(len(ranked))[::-1]
    axes.barh(
        rows,
        [item["mu_star"] for item in ranked],
        xerr=[item["mu_star_conf"] for item in ranked],
        color=[AFTER_COLOUR if item["kept"] else BEFORE_COLOUR for item in ranked],
        error_kw={"elinewidth": 0.9, "capsize": 2, "ecolor": BLACK},
        height=0.7,
    )
    axes.set_yticks(rows, [name_of(item["name"]) for item in ranked], fontsize=8)
    axes.set_ylim(-0.7, len(ranked) - 0.3)
    axes.set_xlim(left=0.0)
    style_panel(axes, "what matters: blue numbers were searched, grey ones stayed", "")
    axes.set_xlabel("mean change of log(1 + cost) over the screened range, with 95 % interval")
    return figure


def draw_convergence(convergence: Mapping[str, Sequence[float]], worst: float) -> Figure:
    """Draw the cost of the best candidate so far and the median of each generation.

    Args:
        convergence: Of the outcome.
        worst: Cost of the worst walk; a median above it, of falls or forbidden tables, is drawn there.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(11.0, 3.4), layout="constrained")
    axes = figure.add_subplot()
    best, median = convergence["best"], np.minimum(convergence["median"], worst)
    axes.plot(
        range(1, len(median) + 1),
        median,
        "o",
        color=BEFORE_COLOUR,
        markersize=4,
        label="median of a generation's better half",
    )
    axes.step(range(len(best)), best, where="post", color=AFTER_COLOUR, label="best so far")
    axes.plot(0, best[0], "s", color=BLACK, markersize=5, label="table before")
    axes.set_ylim(bottom=0.0)
    style_panel(axes, "convergence", "cost")
    axes.set_xlabel("generation")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False)
    return figure


def draw_departures(departures: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Draw the errors over each quantity that departs; a cross marks a fall or a walk without strides.

    Args:
        departures: Of the outcome.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    for place, (name, item) in enumerate(departures.items()):
        axes = figure.add_subplot(2, 3, place + 1)
        for which, line in (("before", "--"), ("after", "-")):
            for joint in MOTOR_JOINTS:
                _draw_degradation(axes, item, which, joint, line)
        axes.axvline(item["nominal"], color=BLACK, linewidth=0.8, linestyle=":")
        style_panel(axes, "", "error [°]")
        axes.set_xlabel(name)
        axes.set_ylim(bottom=0.0)
    joints = [Line2D([], [], color=JOINT_COLOURS[joint], label=str(joint)) for joint in MOTOR_JOINTS]
    lines = [
        Line2D([], [], color=GREY, linestyle="--", marker="o", markersize=3, label="before"),
        Line2D([], [], color=GREY, linestyle="-", marker="o", markersize=3, label="after"),
        Line2D([], [], color=BLACK, linestyle="none", marker="x", label="falls, or hardly walks (after)"),
        Line2D([], [], color=GREY, linestyle="none", marker="x", label="the same before"),
        Line2D([], [], color=BLACK, linestyle=":", label="tuned for"),
    ]
    put_legend(figure, [*joints, *lines[:2]], lines[2:])
    return figure


def name_of(name: str) -> str:
    """A parameter's name in words.

    Args:
        name: Such as ``early_stance.hip.stiffness_Nm_per_deg``.

    Returns:
        Words without the unit.
    """
    for key, word in (
        (".stiffness_Nm_per_deg", ", stiffness"),
        (".equilibrium_deg", ", equilibrium angle"),
        (".damping_ratio", ", damping ratio"),
        (".damping_Nms_per_rad", ", damping"),
        (".friction_compensation_gain", ", friction compensation"),
        ("blending.duration_ms", "duration of the blend"),
        (".angle_deg", " angle"),
    ):
        name = name.replace(key, word)
    return readable(name.replace(".", " "))


# ---------------------------------------------------------------------- drawing


def _line(name: str) -> dict[str, Any]:
    if name == "reference":
        return {"color": REFERENCE_COLOUR, "linewidth": 2.2, "linestyle": "-"}
    which, side = name.split()
    colour = BEFORE_COLOUR if which == "before" else AFTER_COLOUR
    return {"color": colour, "linewidth": 1.5, "linestyle": _SIDE_LINES[side]}


def _label(name: str) -> str:
    return name if name == "reference" else f"{name} leg"


def _draw_degradation(axes: Axes, item: Mapping[str, Any], which: str, joint: JointName, line: str) -> None:
    values = item["values"]
    errors = [np.nan if error is None else error for error in item[which][f"{joint}_error_deg"]]
    style: dict[str, Any] = {"linestyle": line, "linewidth": 1.4, "marker": "o", "markersize": 3}
    axes.plot(values, errors, color=JOINT_COLOURS[joint], **style)
    lost = [value for value, error in zip(values, errors, strict=True) if np.isnan(error)]
    if joint is MOTOR_JOINTS[-1] and lost:
        height, colour = (0.06, BLACK) if which == "after" else (0.13, GREY)
        axes.plot(
            lost, [height] * len(lost), "x", color=colour, transform=axes.get_xaxis_transform(), clip_on=False
        )


def amount(value: float | None, unit: str) -> str:
    """Write a number with its unit and as many places as a person reads.

    Args:
        value: The number; a dash stands for None.
        unit: Its unit, or nothing.

    Returns:
        Text.
    """
    if value is None:
        return "–"
    text = f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.1f}" if abs(value) >= 10.0 else f"{value:.2f}"
    return f"{text} {unit}".strip()
