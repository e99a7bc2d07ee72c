"""Figures B.1 to B.5: the falls of the knee, weight by weight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.identification import BenchSetup, LoadAngle, ProcessingOptions
from twin_gait.identification.processing import RATE
from twin_gait.identification.signals import decimate, moving_average
from twin_gait.report.canvas import style_panel
from twin_gait.report.reproduction import number_text
from twin_gait.scenario.bench_joint import BENCH_ACTUATORS, HORIZONTAL, STOP_ANGLE
from twin_gait.simulation.bench_joint import TICK
from twin_gait.studies.campaign import TESTS_PER_WEIGHT, TRANSPARENCY_GAINS, WEIGHTS
from twin_gait.studies.reproduction.claim import Claim, Kind, Recipe, Reproduction
from twin_gait.studies.reproduction.duty_figures import GAIN_COLOURS
from twin_gait.studies.reproduction.falls import Fall, falls_of
from twin_gait.vocabulary import JointName

KNEE = JointName.KNEE
FACTOR = round(1.0 / (RATE * TICK))
DEVIATIONS = 3.0
_STYLES = ("-", "--", ":")  # by A, from small to large
_APPENDIX = "appendix B, figure {key}"
_TUNED = (
    "p0, p1, p2 and ω_min, which the thesis does not print, were chosen so that the falls go as its "
    "appendix B tells"
)


def make_falls(place: int, folder: Path, seed: int) -> Reproduction:
    """Figures B.1 to B.5: the nine falls of a weight.

    Args:
        place: Of the weight, heaviest first.
        folder: Shared by the recipes.
        seed: Of the campaign.

    Returns:
        The figure with its claims.
    """
    mass, key = WEIGHTS[place], f"fig-B.{place + 1}"
    falls = falls_of(folder, KNEE, mass, seed)
    claims = [_speed_claim(key, falls)]
    readings: tuple[str, ...] = ()
    if place == 0:
        claims.append(_load_claim(key))
        readings = (_load_reading(mass),)
    else:
        claims.append(_noise_claim(key, falls, falls_of(folder, KNEE, WEIGHTS[place - 1], seed)))
    if place == len(WEIGHTS) - 1:
        claims.append(_slowest_claim(key, falls))
    return Reproduction(
        key=key,
        title=f"Falls of {mass:g} kg",
        figure=draw_falls(falls, mass),
        claims=tuple(claims),
        text=(
            f"The nine simulated falls of {mass:g} kg from 90° to the stop at 125°: load torque over the "
            "angle, angle over time, load torque over the speed after the thesis's filter. K by colour, "
            "A by line. What the falls look like was calibrated; the order of their roughness was not."
        ),
        readings=readings,
    )


def load_torque(angle: np.ndarray, mass: float, form: LoadAngle = LoadAngle.CORRECTED) -> np.ndarray:
    """Load torque of the bench, equation (2.8).

    Args:
        angle: In [rad], shape ``(n,)``.
        mass: In [kg].
        form: As corrected, or as printed.

    Returns:
        In [N m], shape ``(n,)``.
    """
    return BenchSetup(actuator=BENCH_ACTUATORS[KNEE], load_angle=form).load_torque(angle, mass)


def _load_change(form: LoadAngle) -> tuple[float, float]:
    """Load torque at the start and at the stop over F b."""
    ends = load_torque(np.array([HORIZONTAL, STOP_ANGLE]), 1.0, form)
    return tuple(ends / float(load_torque(np.array([HORIZONTAL]), 1.0)[0]))


def _load_claim(key: str) -> Claim:
    start, stop = _load_change(LoadAngle.CORRECTED)
    return Claim(
        name="load torque at the stop over that at the start",
        thesis=None,
        ours=stop / start,
        unit="1",
        kind=Kind.CALIBRATED,
        reason="the thesis says that the torque does not change very much; the angle is counted from the "
        "level link because of this sentence",
        source=_APPENDIX.format(key=key[4:]),
    )


def _load_reading(mass: float) -> str:
    weight = float(load_torque(np.array([HORIZONTAL]), mass)[0])
    printed, right = (
        [number_text(round(value * weight, 2) + 0.0) for value in _load_change(form)]
        for form in (LoadAngle.PRINTED, LoadAngle.CORRECTED)
    )
    return (
        f"As printed, F b cos θ, the load of {mass:g} kg goes from {printed[0]} to {printed[1]} N m between "
        "90° and 125°: from nothing, and against the fall. With the link level at 90°, F b cos(θ − 90°), it "
        f"goes from {right[0]} to {right[1]} N m, which is the slight change that the thesis describes."
    )


def _speed_claim(key: str, falls: Sequence[Fall]) -> Claim:
    slow, fast = (_mean_speed(falls, gain) for gain in (TRANSPARENCY_GAINS[0], TRANSPARENCY_GAINS[-1]))
    return Claim(
        name="mean speed of the falls with K = 1.15 over that with K = 1",
        thesis=None,
        ours=fast / slow,
        unit="1",
        kind=Kind.CALIBRATED,
        reason=f"the thesis states that high K is faster; {_TUNED}",
        source=_APPENDIX.format(key=key[4:]),
    )


def _mean_speed(falls: Sequence[Fall], gain: float) -> float:
    """Way over time of the falls with a K, in [rad] / [s]."""
    chosen = [fall for fall in falls if fall.gain == gain]
    return float(np.mean([(fall.angle[-1] - fall.angle[0]) / fall.time[-1] for fall in chosen]))


def _slowest_claim(key: str, falls: Sequence[Fall]) -> Claim:
    slow = [float(fall.time[-1]) for fall in falls if fall.gain == TRANSPARENCY_GAINS[0]]
    return Claim(
        name="time to the stop with K = 1",
        thesis=None,
        ours=float(np.mean(slow)),
        unit="s",
        kind=Kind.CALIBRATED,
        reason=f"the thesis says too many seconds; {_TUNED}",
        source=_APPENDIX.format(key=key[4:]),
    )


def roughness(fall: Fall) -> float:
    """How unevenly a joint speeds up: ups and downs of the filtered speed over its largest value.

    Args:
        fall: The fall.

    Returns:
        1 for a speed that only grows; every stall adds up to 2.
    """
    speed = filtered_speed(fall)
    return float(np.abs(np.diff(speed, prepend=0.0)).sum() / speed.max())


def filtered_speed(fall: Fall) -> np.ndarray:
    """Speed after the thesis's post-processing, at 100 Hz in [rad] / [s]."""
    return moving_average(decimate(fall.velocity, FACTOR), ProcessingOptions().window)


def _noise_claim(key: str, falls: Sequence[Fall], heavier: Sequence[Fall]) -> Claim:
    pairs = [
        math.log(roughness(light) / roughness(heavy)) for light, heavy in zip(falls, heavier, strict=True)
    ]
    error = float(np.std(pairs, ddof=1)) / math.sqrt(TESTS_PER_WEIGHT)
    return Claim(
        name="roughness of the speed over that of the next heavier weight",
        thesis=None,
        ours=math.exp(float(np.mean(pairs))),
        unit="1",
        kind=Kind.PREDICTED,
        low=math.exp(-DEVIATIONS * error),
        reason="the thesis states the order: the heavier, the less noisy. Geometric mean of nine pairs of "
        f"tests with the same K and step of A; {DEVIATIONS:g} standard errors below equality",
        source="appendix B",
    )


def draw_falls(falls: Sequence[Fall], mass: float) -> Figure:
    """Load torque over the angle, angle over time, load torque over the speed."""
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    panels = figure.subplots(1, 3)
    amplitudes = sorted({fall.amplitude for fall in falls})
    for fall in falls:
        _draw_fall(panels, fall, mass, _STYLES[amplitudes.index(fall.amplitude)])
    for axes, title, unit, label in zip(
        panels,
        ("load torque by angle", "angle by time", "load torque by speed"),
        ("load torque [N m]", "angle [°]", "load torque [N m]"),
        ("angle [°]", "time [s]", "velocity [rad/s]"),
        strict=True,
    ):
        style_panel(axes, title, unit)
        axes.set_xlabel(label)
    panels[0].set_ylim(0.0, None)
    handles, labels = panels[1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize="small")
    return figure


def _draw_fall(panels: Sequence[Axes], fall: Fall, mass: float, style: str) -> None:
    look: dict[str, Any] = {"color": GAIN_COLOURS[fall.gain], "linestyle": style, "linewidth": 1.2}
    torque, angle = load_torque(fall.angle, mass), np.degrees(fall.angle)
    label = f"K = {fall.gain:g}, A = {fall.amplitude:g}"
    panels[0].plot(angle, torque, **look)
    panels[1].plot(fall.time, angle, label=label, **look)
    panels[2].plot(filtered_speed(fall), torque[::FACTOR], **look)


RECIPES = tuple(
    Recipe(key=f"fig-B.{place + 1}", title=f"Falls of {mass:g} kg", make=partial(make_falls, place))
    for place, mass in enumerate(WEIGHTS)
)
