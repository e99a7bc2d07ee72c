"""Figures A.1, A.2 and B.1 to B.6."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from thesis.falls import (
    AMPLITUDES,
    BENCH,
    FREQUENCY,
    GAINS,
    MASSES,
    Beginnings,
    Fall,
    load_torque,
)
from thesis.friction import FACTOR

from twin_gait.core.actuator import Motor
from twin_gait.gait.table import TICK
from twin_gait.palette import BLACK, BLUE, BLUISH_GREEN, GREY, ORANGE, SKY_BLUE, VERMILLION
from twin_gait.report.canvas import style_panel
from twin_gait.worlds.bench_control import TRANSPARENCY_STEPS, DutyControl, breakaway_duty, viscous_duty

GAIN_COLOURS = dict(zip(GAINS, (BLUE, BLUISH_GREEN, VERMILLION), strict=True))
_STYLES = ("-", "--", ":")  # by A, from small to large
_STANDING, _SHOWN = 0.4, 0.6  # [s] of figures A.1 and B.6


def draw_static_duty(falls: Sequence[Fall]) -> Figure:
    """Draw equation (2.1a) over the range of A in the protocol, and the duty in the logs of falls."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    law, logs = figure.subplots(1, 2, sharey=True)
    ticks = np.arange(int(TRANSPARENCY_STEPS / FREQUENCY) + 1)
    amplitudes = (AMPLITUDES[0], sum(AMPLITUDES) / 2.0, AMPLITUDES[1])
    for amplitude, colour in zip(amplitudes, (BLUE, SKY_BLUE, ORANGE), strict=True):
        shaking = DutyControl(amplitude=amplitude, frequency=FREQUENCY)
        duty = [breakaway_duty(shaking, float(tick)) for tick in ticks]
        law.plot(TICK * ticks, duty, color=colour, label=f"A = {amplitude:g}")
    style_panel(law, f"A sin(2π f n/{TRANSPARENCY_STEPS:g}), f = {FREQUENCY:g} Hz", "duty [counts]")
    for fall, colour in zip(falls, (BLUE, VERMILLION, BLUISH_GREEN), strict=True):
        shown = fall.time < _STANDING
        counts = fall.duty[shown] * BENCH.drive.counts
        logs.plot(fall.time[shown], counts, color=colour, label=f"A = {fall.amplitude:g}")
    style_panel(logs, f"logs, {MASSES[-1]:g} kg, K = {falls[0].gain:g}", "")
    for axes in (law, logs):
        axes.set_xlabel("time [s]")
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.legend(frameon=False, fontsize="small", loc="lower left" if axes is law else "lower right")
    return figure


def draw_viscous_duty(falls: Sequence[Fall]) -> Figure:
    """Draw equation (2.1b) and the duty in the logs of falls over the speed."""
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    axes, duty = figure.subplots(), DutyControl()
    end = 1.1 * max(float(fall.velocity.max()) for fall in falls)
    counts, bus, lowest = BENCH.drive.counts, BENCH.battery.voltage, duty.lowest_velocity
    speeds, actuator = np.linspace(lowest, end, 200), BENCH.actuator
    motor = Motor(actuator.torque_constant, actuator.gear_ratio, actuator.resistance)
    for gain, colour in GAIN_COLOURS.items():
        for fall in falls:
            if fall.gain == gain:
                moving = fall.velocity[::5], counts * fall.duty[::5]
                axes.plot(*moving, ".", color=colour, markersize=2.0, alpha=0.4)
        law = DutyControl(transparency_gain=gain)
        followed = [viscous_duty(law, motor, float(speed), bus, float(counts)) for speed in speeds]
        axes.plot(speeds, followed, color=colour, linewidth=2.0, label=f"K = {gain:g}")
    axes.axvline(lowest, color=BLACK, linestyle=":", linewidth=1.0)
    axes.text(lowest, 0.97, " ω_min", transform=axes.get_xaxis_transform(), va="top")
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    axes.set(xlabel="velocity [rad/s]", xlim=(0.0, end))
    axes.legend(frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(0.22, 1.0))
    style_panel(axes, "lines: (2.1b); points: logs of nine falls of 3 kg", "duty [counts]")
    return figure


def draw_falls(falls: dict[float, Sequence[Fall]]) -> Figure:
    """Draw a row for each weight: angle over time, and load torque over filtered speed."""
    figure = Figure(figsize=(8.6, 1.7 * len(falls)), layout="constrained")
    rows = figure.subplots(len(falls), 2)
    for row, (mass, those) in zip(rows, falls.items(), strict=True):
        amplitudes = sorted({fall.amplitude for fall in those})
        for fall in those:
            style = _STYLES[amplitudes.index(fall.amplitude)]
            look: dict[str, Any] = {
                "color": GAIN_COLOURS[fall.gain],
                "linestyle": style,
                "linewidth": 0.9,
                "label": f"K = {fall.gain:g}, A {('small', 'middle', 'large')[_STYLES.index(style)]}",
            }
            torque, angle = load_torque(fall.angle, mass), np.degrees(fall.angle)
            row[0].plot(fall.time, angle, **look)
            row[1].plot(fall.speed, torque[::FACTOR], **look)
        counts = f"A = {amplitudes[0]:g} to {amplitudes[-1]:g}"
        style_panel(row[0], f"{mass:g} kg, {counts}", "angle [°]")
        style_panel(row[1], "", "load torque [N·m]")
    for axes, label in zip(rows[-1], ("time [s]", "velocity [rad/s]"), strict=True):
        axes.set_xlabel(label)
    handles, labels = rows[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize="small")
    return figure


def draw_breakaway(sets: Sequence[Beginnings]) -> Figure:
    """Draw the angle at the start, with a panel for each varied property."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    panels = figure.subplots(1, len(sets), sharey=True)
    for axes, item, colour in zip(panels, sets, (BLUE, VERMILLION, BLUISH_GREEN), strict=True):
        for run in item.runs:
            angle = np.degrees(run.column("link_angle_rad"))
            axes.plot(run.column("time_s"), angle, color=colour, linewidth=1.0, alpha=0.7)
        title = f"{item.label}: spread {1e3 * item.spread:.1f} ms"
        style_panel(axes, title, "angle [°]" if axes is panels[0] else "")
        axes.axhline(91.0, color=GREY, linestyle="--", linewidth=0.8)  # has broken away
        axes.set(xlabel="time [s]", xlim=(0.0, _SHOWN), ylim=(89.0, 96.0))
    return figure
