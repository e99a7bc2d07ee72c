"""Figure B.6: what decides when the shaken joint breaks away."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from twin_gait.palette import BLUE, BLUISH_GREEN, GREY, VERMILLION
from twin_gait.report.canvas import style_panel
from twin_gait.scenario.bench_joint import TRANSPARENCY_STEPS, BenchJoint, DutyControl
from twin_gait.simulation.bench_joint import BenchRun, BenchVariation, simulate_bench
from twin_gait.studies.campaign import (
    AMPLITUDE_STEP,
    FREQUENCY,
    WEIGHTS,
    Campaign,
    drop_amplitude,
    planned_tests,
    summarise,
)
from twin_gait.studies.reproduction.claim import Claim, Kind, Recipe, Reproduction
from twin_gait.vocabulary import JointName

TITLE = "First instants of the falls of 3 kg"
PHASES = 24
SHOWN = 0.6  # [s]
ZOOM = 1.5  # [s] of a fall that is simulated
SOURCE = "appendix B, figure B.6"
HALF = 0.5  # of a sine drives the joint along the fall
_BROKEN_AWAY = 91.0  # [°]: the joint has moved by one
_MIDDLE = 4  # test with K = 1.10 and the middle A


@dataclass(frozen=True, eq=False)
class Beginnings:
    """Falls that differ in one thing.

    Attributes:
        label: What differs.
        runs: The falls.
    """

    label: str
    runs: tuple[BenchRun, ...]

    @property
    def breakaway(self) -> np.ndarray:
        """Times in [s] after which the joint has moved by 1°; NaN for one that did not."""
        times = [summarise(run)["breakaway_s"] for run in self.runs]
        return np.array([math.nan if time is None else time for time in times])


def make_breakaway(folder: Path, seed: int) -> Reproduction:
    """Vary A, the moment in the sine, and the gear's ripple, one at a time.

    Args:
        folder: Not used.
        seed: Of the noise.

    Returns:
        The figure with its claims.
    """
    plan = planned_tests(Campaign(joint=JointName.KNEE, seed=seed))[_MIDDLE]
    test = replace(plan.test, duration=ZOOM)
    turns = 2.0 * math.pi * np.arange(PHASES) / PHASES
    ticks = [round(TRANSPARENCY_STEPS / FREQUENCY * place / PHASES) for place in range(PHASES)]
    amplitudes = Beginnings(
        "A, 5 counts apart", tuple(_run(_with_amplitude(test, step), seed) for step in range(3))
    )
    phases = Beginnings("moment in the sine", tuple(_run(test, seed, duty_start=tick) for tick in ticks))
    teeth = Beginnings(
        "place on the gear", tuple(_run(test, seed, ripple_phase=float(turn)) for turn in turns)
    )
    return Reproduction(
        key="fig-B.6",
        title=TITLE,
        figure=draw_breakaway((amplitudes, phases, teeth)),
        claims=_claims(amplitudes, phases),
        text=(
            "The thesis sees an influence of A on the first instants, and blames teeth that rub more for "
            "falls that begin late. Here one thing is changed at a time: A by its two steps, the moment in "
            f"the sine of (2.1a) at which control is switched on, and the place on the gear, whose friction "
            f"varies by ±{test.friction.ripple:g} N m. Times of break-away spread by "
            f"{_spread(amplitudes):.1f}, {_spread(phases):.1f} and {_spread(teeth):.1f} ms (standard "
            "deviation). The simulated friction creeps where true friction sticks; with true sticking the "
            "influence of A and of the teeth would be larger."
        ),
        readings=(
            "The thesis puts the differences in figure B.6 down to A, and the rest to the teeth. The moment "
            f"in the sine explains {_spread(phases) / _spread(amplitudes):.0f} times the spread of A here: "
            "tests that differ in A alone have to be switched on at the same moment of the sine.",
        ),
    )


def _with_amplitude(test: BenchJoint, step: int) -> BenchJoint:
    assert isinstance(test.control, DutyControl)  # the campaign's falls are under duty control
    return replace(test, control=replace(test.control, amplitude=drop_amplitude(WEIGHTS[0], step)))


def _run(test: BenchJoint, seed: int, *, duty_start: int = 0, ripple_phase: float = 0.0) -> BenchRun:
    variation = BenchVariation(duty_start=duty_start, ripple_phase=ripple_phase)
    return simulate_bench(test, seed=seed, variation=variation)


def _spread(beginnings: Beginnings) -> float:
    """Standard deviation of the times of break-away in [ms]."""
    return 1e3 * float(np.std(beginnings.breakaway))


def _claims(amplitudes: Beginnings, phases: Beginnings) -> tuple[Claim, ...]:
    times = amplitudes.breakaway
    period = 1.0 / FREQUENCY
    return (
        Claim(
            name=f"change of the time of break-away by {2.0 * AMPLITUDE_STEP:g} counts of A",
            thesis=None,
            ours=float(times[-1] - times[0]),
            unit="s",
            kind=Kind.PREDICTED,
            high=0.0,
            reason="the thesis states the order: a larger A overcomes static friction sooner",
            source=f"{SOURCE}; section 2.2.2",
        ),
        Claim(
            name="spread of the time of break-away over the moment in the sine",
            thesis=None,
            ours=1e-3 * _spread(phases),
            unit="s",
            kind=Kind.PREDICTED,
            low=spread_of_wait(period, HALF),
            high=spread_of_wait(period, 0.0),
            reason="closed form, for switching on at any moment of the period alike: from a joint that can "
            "start in half of each period to one that can start at one moment of it only",
            source=SOURCE,
        ),
    )


def spread_of_wait(period: float, share: float) -> float:
    r"""Spread of the wait for a moment at which the joint can start, switched on at any moment alike.

    The wait is 0 in the share :math:`s` of each period and uniform up to :math:`(1-s)T` in the rest:
    :math:`\sigma^2 = T^2 [(1-s)^3/3 - (1-s)^4/4]`.

    Args:
        period: :math:`T` in [s].
        share: :math:`s`, from 0 to 1.

    Returns:
        Standard deviation in [s].
    """
    rest = 1.0 - share
    return period * math.sqrt(rest**3 / 3.0 - rest**4 / 4.0)


def draw_breakaway(sets: Sequence[Beginnings]) -> Figure:
    """Angle over the first instants, a panel for each thing that is varied."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    panels = figure.subplots(1, len(sets), sharey=True)
    for axes, item, colour in zip(panels, sets, (BLUE, VERMILLION, BLUISH_GREEN), strict=True):
        for run in item.runs:
            angle = np.degrees(run.column("link_angle_rad"))
            axes.plot(run.column("time_s"), angle, color=colour, linewidth=1.0, alpha=0.7)
        style_panel(
            axes, f"{item.label}: spread {_spread(item):.1f} ms", "angle [°]" if axes is panels[0] else ""
        )
        axes.axhline(_BROKEN_AWAY, color=GREY, linestyle="--", linewidth=0.8)
        axes.set(xlabel="time [s]", xlim=(0.0, SHOWN), ylim=(89.0, 96.0))
    return figure


RECIPES = (Recipe(key="fig-B.6", title=TITLE, make=make_breakaway),)
