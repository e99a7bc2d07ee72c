"""Figures A.1 and A.2: the two laws of the duty-based transparency control."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.core.motor_drive import breakaway_duty, viscous_duty
from twin_gait.palette import (
    BLACK,
    BLUE,
    BLUISH_GREEN,
    GREY,
    ORANGE,
    SKY_BLUE,
    VERMILLION,
)
from twin_gait.report.canvas import style_panel
from twin_gait.scenario.bench_joint import (
    BENCH_ACTUATORS,
    TRANSPARENCY_STEPS,
    DutyControl,
    bench_joint,
)
from twin_gait.simulation.bench_joint import TICK
from twin_gait.studies.campaign import (
    AMPLITUDE_RANGE,
    AMPLITUDE_STEP,
    FREQUENCY,
    TRANSPARENCY_GAINS,
    WEIGHTS,
)
from twin_gait.studies.reproduction.claim import Claim, Kind, Recipe, Reproduction
from twin_gait.studies.reproduction.falls import Fall, falls_of
from twin_gait.studies.reproduction.shared import table_values
from twin_gait.vocabulary import JointName

KNEE = JointName.KNEE
BENCH = bench_joint(KNEE)
GAIN_COLOURS = dict(zip(TRANSPARENCY_GAINS, (BLUE, BLUISH_GREEN, VERMILLION), strict=True))
STATIC_TITLE = "Duty against static friction, equation (2.1a)"
VISCOUS_TITLE = "Duty of the moving joint, equation (2.1b)"
_STANDING = 0.4  # [s] of a log that figure A.1 shows


def torque_per_count() -> float:
    """Torque of the standing knee by one count of duty, K_t τ V/(N R), in [N m]."""
    motor = BENCH.actuator
    current = BENCH.battery.voltage / (BENCH.drive.counts * motor.resistance)
    return motor.torque_constant * motor.gear_ratio * current


def make_static_duty(folder: Path, seed: int) -> Reproduction:
    """Figure A.1: the sine that shakes the joint at rest.

    Args:
        folder: Shared by the recipes.
        seed: Of the campaign.

    Returns:
        The figure with its claim.
    """
    counts = AMPLITUDE_RANGE[1] - AMPLITUDE_RANGE[0]
    weights = (WEIGHTS[0] - WEIGHTS[-1]) * BENCH.gravity * BENCH.link.lever
    margin = 2.0 * AMPLITUDE_STEP
    falls = falls_of(folder, KNEE, WEIGHTS[-1], seed)[:3]
    return Reproduction(
        key="fig-A.1",
        title=STATIC_TITLE,
        figure=draw_static_duty(falls),
        claims=(
            Claim(
                name="range of A that makes up for the weights, 3 to 1 kg",
                thesis=counts,
                ours=weights / torque_per_count(),
                unit="counts",
                kind=Kind.PREDICTED,
                low=counts - margin,
                high=counts + margin,
                reason="the lighter the weight, the larger the thesis's A: the motor makes up for the load, "
                f"to one step of {AMPLITUDE_STEP:g} counts at each end. Winding and bus voltage are from "
                f"data sheets; full duty of {BENCH.drive.counts} counts (120 MHz over 20 kHz) and a lever of "
                f"{BENCH.link.lever:g} m are assumptions, not fitted to this",
                source="section 2.2.3: A from 140 (heavy) to 195 (light); section 2.2.2",
            ),
        ),
        text=(
            "Below ω_min the duty is a sine of amplitude A and frequency f. Left: equation (2.1a) over the "
            "protocol's range of A. Right: duty in the logs of the first three falls of 1 kg with K = 1, "
            "which begin at different moments of the sine; the flat parts are (2.1b), where the shaken joint "
            f"was faster than ω_min. A count is {torque_per_count():.4f} N m on the standing knee."
        ),
    )


def draw_static_duty(falls: Sequence[Fall]) -> Figure:
    """Law and logs."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    law, logs = figure.subplots(1, 2, sharey=True)
    ticks = np.arange(int(TRANSPARENCY_STEPS / FREQUENCY) + 1)
    lowest, highest = AMPLITUDE_RANGE
    for amplitude, colour in zip(
        (lowest, 0.5 * (lowest + highest), highest), (BLUE, SKY_BLUE, ORANGE), strict=True
    ):
        duty = [breakaway_duty(float(tick), amplitude, FREQUENCY, TRANSPARENCY_STEPS) for tick in ticks]
        law.plot(TICK * ticks, duty, color=colour, label=f"A = {amplitude:g}")
    style_panel(law, f"A sin(2π f n/{TRANSPARENCY_STEPS:g}), f = {FREQUENCY:g} Hz", "duty [counts]")
    for fall, colour in zip(falls, (BLUE, VERMILLION, BLUISH_GREEN), strict=True):
        shown = fall.time < _STANDING
        counts = fall.duty[shown] * BENCH.drive.counts
        logs.plot(fall.time[shown], counts, color=colour, label=f"A = {fall.amplitude:g}")
    style_panel(logs, f"logs, {WEIGHTS[-1]:g} kg, K = {falls[0].gain:g}", "")
    for axes in (law, logs):
        axes.set_xlabel("time [s]")
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.legend(frameon=False, fontsize="small", loc="lower left" if axes is law else "lower right")
    return figure


def neutral_gain(joint: JointName) -> float:
    r"""K beyond which the linear part of (2.1b) speeds the joint up.

    The winding brakes with :math:`(K_t\tau)^2 (1 - K p)/R`, :math:`p` the share of the back-EMF in
    :math:`p_1`; with the viscous friction :math:`d` it vanishes at
    :math:`K = [1 + d R/(K_t\tau)^2]/p`.

    Args:
        joint: Knee or hip.

    Returns:
        K.
    """
    actuator = BENCH_ACTUATORS[joint]
    per_current = actuator.torque_constant * actuator.gear_ratio
    friction = table_values(joint)["d"] * actuator.resistance / (per_current * per_current)
    return (1.0 + friction) / DutyControl().back_emf_share


def make_viscous_duty(folder: Path, seed: int) -> Reproduction:
    """Figure A.2: the duty that follows the moving joint.

    Args:
        folder: Shared by the recipes.
        seed: Of the campaign.

    Returns:
        The figure with its claim.
    """
    falls = falls_of(folder, KNEE, WEIGHTS[0], seed)
    neutral = neutral_gain(KNEE)
    return Reproduction(
        key="fig-A.2",
        title=VISCOUS_TITLE,
        figure=draw_viscous_duty(falls),
        claims=(
            Claim(
                name="K beyond which the joint speeds itself up",
                thesis=TRANSPARENCY_GAINS[-1],
                ours=neutral,
                unit="1",
                kind=Kind.CALIBRATED,
                reason="the thesis went no higher than its number, to avoid instability; p1, which it does "
                "not print, was chosen so that the falls are as it tells",
                source="section 2.2.3",
            ),
        ),
        text=(
            "Above ω_min the duty follows the speed: K p1 ω feeds the back-EMF forward, K p2 ω² brakes. "
            "Lines: equation (2.1b); points: duty in the logs of the nine falls of 3 kg. The thesis prints "
            f"neither p0, p1 nor p2. With p1 = {DutyControl().back_emf_share:g} of the back-EMF, the "
            f"winding's brake and the viscous friction are both gone at K = {neutral:.3f}: between 1.10 and "
            "1.15 the joint goes from crawling to running, and only p2 holds it."
        ),
    )


def draw_viscous_duty(falls: Sequence[Fall]) -> Figure:
    """Law and logs over the speed."""
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    axes = figure.subplots()
    end = 1.1 * max(float(fall.velocity.max()) for fall in falls)
    lowest = DutyControl().lowest_velocity
    for gain, colour in GAIN_COLOURS.items():
        _draw_logged(axes, [fall for fall in falls if fall.gain == gain], colour)
        speeds = np.linspace(lowest, end, 200)
        axes.plot(speeds, _law(speeds, gain), color=colour, linewidth=2.0, label=f"K = {gain:g}")
    axes.axvline(lowest, color=BLACK, linestyle=":", linewidth=1.0)
    axes.text(lowest, 0.97, " ω_min", transform=axes.get_xaxis_transform(), va="top")
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    axes.set(xlabel="velocity [rad/s]", xlim=(0.0, end))
    axes.legend(frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(0.22, 1.0))
    style_panel(axes, "lines: (2.1b); points: logs of nine falls of 3 kg", "duty [counts]")
    return figure


def _draw_logged(axes: Axes, falls: Sequence[Fall], colour: str) -> None:
    counts = BENCH.drive.counts
    for fall in falls:
        moving = fall.velocity[::5], counts * fall.duty[::5]
        axes.plot(*moving, ".", color=colour, markersize=2.0, alpha=0.4)


def _law(speeds: np.ndarray, gain: float) -> np.ndarray:
    voltages = DutyControl().voltages(BENCH.actuator)
    counts, bus = float(BENCH.drive.counts), BENCH.battery.voltage
    return np.array([viscous_duty(float(speed), gain, *voltages, bus, counts) for speed in speeds])


RECIPES = (
    Recipe(key="fig-A.1", title=STATIC_TITLE, make=make_static_duty),
    Recipe(key="fig-A.2", title=VISCOUS_TITLE, make=make_viscous_duty),
)
