"""Gain at which the compensated joint becomes unstable, beside what the thesis says of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.palette import BLACK, BLUE, GREY, ORANGE, VERMILLION
from twin_gait.report.canvas import style_panel
from twin_gait.simulation.bench_joint import BenchRun, simulate_bench
from twin_gait.studies.reproduction.claim import Claim, Kind, Recipe, Reproduction
from twin_gait.studies.reproduction.control_bench import EQUILIBRIUM, FRICTION_RATIO, USABLE_GAINS
from twin_gait.studies.reproduction.control_delay import PRINTED_DELAY
from twin_gait.studies.reproduction.control_limits import (
    RATIOS,
    RELEASE,
    RESOLUTION,
    Limit,
    growth,
    late_limits,
    limits_of,
    released,
)

SHOWN_GAINS = (0.45, 0.6, 1.0)
HIGHEST_SHARE = 1.01  # of s


def make_limits(folder: Path, seed: int) -> Reproduction:
    """Find the limits for all ``RATIOS``.

    Args:
        folder: Not used.
        seed: Not used: the tests have no noise but the steps of the encoder.

    Returns:
        What was found.
    """
    limits = [limits_of(ratio) for ratio in RATIOS]
    shown = [simulate_bench(released(gain, FRICTION_RATIO)) for gain in SHOWN_GAINS]
    free, spring = late_limits(FRICTION_RATIO)
    return Reproduction(
        key="joint-limit",
        title="Gain at which the joint becomes unstable",
        figure=draw_limits(limits, shown),
        claims=_claims(limits, shown),
        text="The knee with friction compensation alone is pushed, and on a spring of 0.05 N m/deg it is let "
        f"go {math.degrees(RELEASE):.0f}° beside θ0. By bisection: from which G on does it become faster, or "
        "swing as far as before? At G = s, the ratio of true to modelled friction, with and without the "
        "spring, and so say the eigenvalues of the linear loop at rest. There is a plain reason: at G = s "
        "the motor gives back all that friction takes. The thesis found full compensation strongly unstable "
        "and G up to 0.60 usable. So its joints had between 0.60 of the friction of table 3.1 and all of it, "
        "and near 0.60 if its largest usable G is the limit.",
        readings=(
            f"With the filter's delay as printed, {PRINTED_DELAY} s, and s = {FRICTION_RATIO}, the limits "
            f"are {free:.3f} without and {spring:.3f} with the spring: the instability is not the delay's.",
            f"With the delay of the filter that the thesis describes they are {_limit(limits).free:.3f} and "
            f"{_limit(limits).spring:.3f}.",
        ),
    )


def _limit(limits: Sequence[Limit]) -> Limit:
    return limits[RATIOS.index(FRICTION_RATIO)]


def _claims(limits: Sequence[Limit], shown: Sequence[BenchRun]) -> tuple[Claim, ...]:
    source = "chapter 4"
    shares = {
        "without a spring": [limit.free / limit.ratio for limit in limits],
        "on the thesis's spring": [limit.spring / limit.ratio for limit in limits],
    }
    of_shares = [
        Claim(
            name=f"limit of G over s {words}, farthest from 1 of s = {RATIOS[0]} to {RATIOS[-1]}",
            thesis=None,
            ours=max(values, key=lambda value: abs(value - 1.0)),
            unit="1",
            kind=Kind.PREDICTED,
            low=1.0 - RESOLUTION,
            high=HIGHEST_SHARE,
            reason="1 by the balance of energy; below it by no more than the bisection's step, "
            f"{RESOLUTION:.3f}. A late filter can only raise the limit, by 1/cos of the angle that the swing "
            "advances in 55 ms: 0.1 % at 0.15 Hz, and not more than 1 % up to 0.4 Hz.",
            source=source,
        )
        for words, values in shares.items()
    ]
    return (
        *of_shares,
        Claim(
            name="largest swing with full compensation, G = 1, over the first",
            thesis=None,
            ours=growth(shown[-1]),
            unit="1",
            kind=Kind.PREDICTED,
            low=1.0,
            reason="Above 1: the thesis calls the joint strongly unstable without the parameter G, that is "
            "with G = 1. It prints no number. Here the stops end it.",
            source=source,
        ),
        Claim(
            name=f"limit of G on the bench with s = {FRICTION_RATIO}",
            thesis=USABLE_GAINS[1],
            ours=_limit(limits).free,
            unit="1",
            kind=Kind.CALIBRATED,
            reason="s was chosen because of the thesis's largest usable G.",
            source=source,
        ),
    )


def draw_limits(limits: Sequence[Limit], shown: Sequence[BenchRun]) -> Figure:
    """Draw the limits against s, and some releases.

    Args:
        limits: One per s.
        shown: Releases with ``SHOWN_GAINS``.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(10.5, 4.4), layout="constrained")
    limit, swing = figure.subplots(1, 2)
    limit.plot([0.0, 1.1], [0.0, 1.1], color=BLACK, linewidth=0.8, label="G = s")
    series = (
        ("free", "pushed, no spring", BLUE, "o", 9.0),
        ("spring", "let go on 0.05 N m/deg", VERMILLION, "s", 5.0),
        ("linear", "eigenvalues at rest", BLACK, "x", 5.0),
    )
    for name, label, colour, marker, size in series:
        values = [getattr(each, name) for each in limits]
        limit.plot(RATIOS, values, marker, color=colour, markersize=size, label=label)
    limit.axhspan(*USABLE_GAINS, color=GREY, alpha=0.12, label="usable, thesis ch. 4")
    limit.set_xlabel("s, true over modelled friction")
    limit.set_xlim(0.3, 1.1)
    limit.set_ylim(0.0, 1.1)
    limit.legend(fontsize="small", frameon=False, loc="lower right")
    style_panel(limit, "the joint becomes unstable at G = s", "limit of G")
    _draw_releases(swing, shown)
    return figure


def _draw_releases(axes: Axes, shown: Sequence[BenchRun]) -> None:
    for run, gain, colour in zip(shown, SHOWN_GAINS, (BLUE, ORANGE, VERMILLION), strict=True):
        angle = np.degrees(run.column("motor_angle_rad") - EQUILIBRIUM)
        axes.plot(run.column("time_s"), angle, color=colour, label=f"G = {gain:.2f}")
    link = shown[0].test.link
    for stop in (link.lower_stop, link.upper_stop):
        axes.axhline(math.degrees(stop - EQUILIBRIUM), color=GREY, linestyle="--", linewidth=0.8)
    axes.set_xlabel("time (s)")
    axes.legend(fontsize="small", frameon=False, loc="upper right", ncols=3)
    axes.set_ylim(-75.0, 90.0)
    style_panel(axes, f"let go on the spring, s = {FRICTION_RATIO}; stops dashed", "θ - θ0 (deg)")


LIMITS = Recipe(key="joint-limit", title="Gain at which the joint becomes unstable", make=make_limits)
