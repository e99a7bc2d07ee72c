"""Gains at which knee and leg become unstable."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from thesis.bench import EQUILIBRIUM, RATIO, USABLE_GAINS, angle_from_rest
from thesis.leg import ANGLES, JOINTS, SHOWN, LegFindings, weight_torque
from thesis.limits import RATIOS, Limit

from twin_gait.palette import BLACK, BLUE, GREY, JOINT_COLOURS, ORANGE, VERMILLION
from twin_gait.report.canvas import style_panel
from twin_gait.simulation.bench_joint.loop import BenchRun

SMALL = {"fontsize": "small", "frameon": False}


def draw_limits(limits: Sequence[Limit], shown: Mapping[float, BenchRun]) -> Figure:
    """Draw limits over s, and releases by their gain."""
    figure = Figure(figsize=(10.5, 4.4), layout="constrained")
    limit, swing = figure.subplots(1, 2)
    limit.plot([0.0, 1.1], [0.0, 1.1], color=BLACK, linewidth=0.8, label="G = s")
    for name, label, colour, marker, size in (
        ("free", "pushed, no spring", BLUE, "o", 9.0),
        ("spring", "let go on 0.05 N·m/deg", VERMILLION, "s", 5.0),
        ("linear", "eigenvalues at rest", BLACK, "x", 5.0),
    ):
        values = [getattr(each, name) for each in limits]
        limit.plot(RATIOS, values, marker, color=colour, markersize=size, label=label)
    limit.axhspan(*USABLE_GAINS, color=GREY, alpha=0.12, label="usable, thesis ch. 4")
    limit.set(xlabel="s, true over modelled friction", xlim=(0.3, 1.1), ylim=(0.0, 1.1))
    limit.legend(loc="lower right", **SMALL)
    style_panel(limit, "the joint becomes unstable at G = s", "limit of G")
    for (gain, run), colour in zip(shown.items(), (BLUE, ORANGE, VERMILLION), strict=True):
        angle = angle_from_rest(run, column="motor_angle_rad")
        swing.plot(run.column("time_s"), angle, color=colour, label=f"G = {gain:.2f}")
    for stop in (run.test.link.lower_stop, run.test.link.upper_stop):
        swing.axhline(math.degrees(stop - EQUILIBRIUM), color=GREY, linestyle="--", linewidth=0.8)
    swing.set(xlabel="time (s)", ylim=(-75.0, 90.0))
    swing.legend(loc="upper right", ncols=3, **SMALL)
    style_panel(swing, f"let go on the spring, s = {RATIO}; stops dashed", "θ - θ0 (deg)")
    return figure


def draw_leg(found: LegFindings) -> Figure:
    """Draw a map of both gains, and the least gains with which a joint falls."""
    figure = Figure(figsize=(10.5, 4.6), layout="constrained")
    both, least = figure.subplots(1, 2)
    _draw_map(both, found)
    positions = np.arange(len(ANGLES))
    for index, joint in enumerate(JOINTS):
        values = [found.least[angle][index] for angle in ANGLES]
        look = {"color": JOINT_COLOURS[joint], "label": str(joint)}
        bars = least.bar(positions + 0.4 * (index - 0.5), values, width=0.38, **look)
        torques = [f"{weight_torque(joint, math.radians(angle)):.1f} N·m" for angle in ANGLES]
        least.bar_label(bars, torques, fontsize="small", padding=2)
    least.axhline(RATIO, color=BLACK, linewidth=0.8, label="G = s, unstable beyond")
    least.set_xticks(positions, [f"{angle:.0f}°" for angle in ANGLES])
    least.set(xlabel="raised by", ylim=(0.0, 0.8))
    least.legend(loc="upper right", ncols=3, **SMALL)
    style_panel(least, "least G with which the joint falls by its own weight", "G")
    return figure


def _draw_map(axes: Axes, found: LegFindings) -> None:
    hip, knee = np.meshgrid(SHOWN, SHOWN, indexing="ij")
    kinds = ((~found.swings, BLUE, "o", "comes to rest"), (found.swings, VERMILLION, "X", "goes on swinging"))
    for chosen, colour, marker, label in kinds:
        axes.scatter(hip[chosen], knee[chosen], color=colour, marker=marker, s=45, label=label)
    at_hip, at_knee = (found.alone.hip, 0.0, found.both), (0.0, found.alone.knee, found.both)
    axes.scatter(at_hip, at_knee, color=BLACK, marker="D", s=40, label="limit by bisection")
    axes.plot([0.0, RATIO, RATIO], [RATIO, RATIO, 0.0], color=BLACK)
    axes.fill_between([0.0, RATIO], [0.0, RATIO], RATIO, color=GREY, alpha=0.15)
    axes.text(0.03, 0.35, "thesis:\n$G_{hip} < G_{knee}$", color="0.35")
    axes.set(xlim=(-0.03, 0.8), ylim=(-0.03, 0.95), xlabel="G of the hip")
    axes.legend(loc="upper center", ncols=2, **SMALL)
    style_panel(axes, f"let go 20° from hanging, no stops, s = {RATIO} (lines: G = s)", "G of the knee")
