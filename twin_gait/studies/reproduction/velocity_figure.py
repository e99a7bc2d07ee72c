"""Figure 3.1: what the thesis's post-processing makes of the velocity of a fall."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from twin_gait.identification import ProcessingOptions
from twin_gait.identification.processing import RATE
from twin_gait.identification.signals import decimate, moving_average
from twin_gait.palette import BLACK, BLUE, ORANGE, VERMILLION
from twin_gait.report.canvas import style_panel
from twin_gait.simulation.bench_joint import TICK, BenchRun, simulate_bench
from twin_gait.studies.campaign import Campaign, planned_tests
from twin_gait.studies.reproduction.claim import Claim, Kind, Recipe, Reproduction
from twin_gait.vocabulary import JointName

TITLE = "Post-processing of the velocity"
PRINTED_DELAY = 0.5  # [s], thesis 3.1: "about"
SHOWN_TEST = "knee_2kg_5.log"  # neither the slowest fall nor the fastest
WINDOW, PERIOD = ProcessingOptions().window, 1.0 / RATE
FACTOR = round(PERIOD / TICK)
DEVIATIONS = 3.0


def make_velocity_figure(folder: Path, seed: int) -> Reproduction:
    """Filter the velocity of a simulated fall as the thesis does.

    Args:
        folder: Not used.
        seed: Of the campaign that the fall belongs to.

    Returns:
        The figure with its claims.
    """
    plans = planned_tests(Campaign(joint=JointName.KNEE, seed=seed))
    plan = next(item for item in plans if item.name == SHOWN_TEST)
    run = simulate_bench(plan.test, seed=plan.noise_seed, variation=plan.variation)
    raw = _before_stop(run)
    slow, true = (decimate(values[: len(raw)], FACTOR) for values in (raw, _true_velocity(run)))
    late = _averaged(slow)
    delay = delay_of(slow, late)
    window = round(2.0 * PRINTED_DELAY / PERIOD) + 1
    return Reproduction(
        key="fig-3.1",
        title=TITLE,
        figure=draw_velocities(raw, slow, late, delay),
        claims=(_delay_claim(delay), _noise_claim(slow - true, late - _averaged(true))),
        text=(
            f"A fall of the campaign ({SHOWN_TEST}): the encoder difference of every millisecond, every "
            "tenth of them, and the mean of the last ten of those. Decimation without a filter before it "
            "leaves the noise as it is; the mean takes it down and comes late."
        ),
        readings=(
            f"As printed, the filtered velocity is about {PRINTED_DELAY:g} s late. Ten samples at {RATE:g} "
            f"Hz are {0.5 * (WINDOW - 1) * PERIOD * 1e3:g} ms late, measured {delay * 1e3:.1f} ms; half a "
            f"second would take a window of {window} samples. Chapter 4 of the thesis calls the delay small.",
        ),
    )


def _averaged(values: np.ndarray) -> np.ndarray:
    """Moving average of a joint that is at rest before the log begins."""
    return moving_average(np.concatenate([np.zeros(WINDOW), values]), WINDOW)[WINDOW:]


def _before_stop(run: BenchRun) -> np.ndarray:
    """Velocity of the log in [rad] / [s] until the link reaches the stop."""
    reached = run.column("link_angle_rad") >= run.test.link.upper_stop
    end = int(np.argmax(reached)) if reached.any() else len(reached)
    return run.column("velocity_rad_per_s")[:end]


def _true_velocity(run: BenchRun) -> np.ndarray:
    """Mean velocity of each tick without encoder steps, in [rad] / [s]."""
    angle = run.column("motor_angle_rad")
    return np.diff(angle, prepend=angle[:1]) / TICK


def delay_of(signal: np.ndarray, late: np.ndarray) -> float:
    """Delay by the way that a late velocity lags behind: way over the speed in the end.

    It holds however the joint is shaken on its way, as long as it moves evenly in the end.

    Args:
        signal: Velocity, samples a decimated period apart, at rest in the beginning, shape ``(n,)``.
        late: The same, later.

    Returns:
        In [s].
    """
    return float(np.sum(signal - late)) * PERIOD / float(late[-1])


def _delay_claim(delay: float) -> Claim:
    closed = 0.5 * (WINDOW - 1) * PERIOD
    return Claim(
        name="delay of the filtered velocity",
        thesis=PRINTED_DELAY,
        ours=delay,
        unit="s",
        kind=Kind.PREDICTED,
        low=closed - 0.5 * PERIOD,
        high=closed + 0.5 * PERIOD,
        reason=f"closed form: half of the {WINDOW - 1} periods in the window, {1e3 * closed:g} ms, give or "
        "take half a period for the speed that still changes in the last window",
        source="section 3.1, figure 3.1",
    )


def _noise_claim(before: np.ndarray, after: np.ndarray) -> Claim:
    number = len(before)
    closed = 1.0 / math.sqrt(WINDOW)
    # Of the averages only one in a window is independent.
    margin = DEVIATIONS * closed * math.sqrt(0.5 / number + 0.5 * WINDOW / number)
    return Claim(
        name="noise left by the mean, of that before",
        thesis=None,
        ours=float(after.std() / before.std()),
        unit="1",
        kind=Kind.PREDICTED,
        low=closed - margin,
        high=closed + margin,
        reason="closed form: encoder steps of differences ten ticks apart are independent, which leaves "
        f"1/√{WINDOW}; {DEVIATIONS:g} standard deviations for {number} samples",
        source="chapter 4 calls the filtered signal free of noise, without a number",
    )


def draw_velocities(raw: np.ndarray, slow: np.ndarray, late: np.ndarray, delay: float) -> Figure:
    """The three signals over the fall, and closely around its beginning."""
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    whole, close = figure.subplots(1, 2, width_ratios=[1.5, 1.0])
    ticks, samples = TICK * np.arange(len(raw)), PERIOD * np.arange(len(slow))
    for axes in (whole, close):
        axes.plot(ticks, raw, color=BLUE, linewidth=0.7, alpha=0.7, label="ω, 1 kHz")
        axes.plot(samples, slow, ".-", color=VERMILLION, markersize=3, linewidth=0.6, label="decimated by 10")
        axes.plot(samples, late, color=ORANGE, linewidth=2.2, label=f"mean of {WINDOW}")
        axes.plot(samples + delay, slow, ":", color=BLACK, linewidth=1.0, label=f"{1e3 * delay:.0f} ms later")
        axes.set_xlabel("time [s]")
    style_panel(whole, "a fall to the stop", "velocity [rad/s]")
    whole.legend(frameon=False, fontsize="small", loc="upper left")
    moving = int(np.argmax(late > 0.5 * late.max()))
    close.set_xlim(samples[moving] - 0.25, samples[moving] + 0.25)
    near = np.abs(samples - samples[moving]) < 0.25
    close.set_ylim(slow[near].min() - 0.01, slow[near].max() + 0.01)
    style_panel(close, f"{1e3 * delay:.1f} ms late, not {PRINTED_DELAY:g} s", "velocity [rad/s]")
    return figure


RECIPES = (Recipe(key="fig-3.1", title=TITLE, make=make_velocity_figure),)
