"""Figures 2.12, 2.20 and 3.5 to 3.7, and the delay of the filter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from thesis.bench import (
    GAINS,
    PRINTED_DELAY,
    RATIO,
    REACH,
    STIFFNESS_PER_DEG,
    USABLE_GAINS,
    angle_from_rest,
    electromechanical_torque,
    last_period,
    model_torque,
    slope_per_deg,
)
from thesis.control import (
    AXIS_TORQUE,
    AXIS_VELOCITY,
    GAIN_GRID,
    MEASURED_SLOPE,
    OFF_LINE_RMSE,
    SPRING_ANGLE,
    VELOCITIES,
    CurrentErrors,
    LoopAreas,
    closed_slope,
    off_line_current,
    old_law,
    overshoot,
)
from thesis.velocity import FilterDelay, closed_delay

from twin_gait.gait.table import TICK
from twin_gait.palette import (
    BLACK,
    BLUE,
    BLUISH_GREEN,
    GREY,
    ORANGE,
    REDDISH_PURPLE,
    SKY_BLUE,
    VERMILLION,
)
from twin_gait.report.canvas import style_panel
from twin_gait.simulation.bench_joint.loop import BenchRun

GAIN_COLOURS = (BLUE, VERMILLION, ORANGE)  # of GAINS, as in the thesis
SMALL = {"fontsize": "small", "frameon": False}
BELOW = {"loc": "outside lower center", "frameon": False}


def draw_old_model(slow: BenchRun, quick: BenchRun) -> Figure:
    """Draw the old model and the torque of the motor, for a slow and a fast hand."""
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    wide, close = figure.subplots(1, 2)
    for axes, run, end in ((wide, quick, AXIS_VELOCITY), (close, slow, 0.3)):
        rows, fine = last_period(run), np.linspace(-end, end, 801)
        velocity, torque = run.column("motor_velocity_rad_per_s")[rows], electromechanical_torque(run)[rows]
        axes.plot(velocity[::10], torque[::10], ".", color=BLUE, label="motor on the bench")
        axes.plot(fine, old_law(fine), color=BLACK, linewidth=1.2, label="old model (2.5)")
        axes.plot(fine, model_torque(fine), color=ORANGE, linestyle="--", label="table 3.1")
        axes.set_xlabel("velocity (rad/s)")
    wide.axhspan(-AXIS_TORQUE, AXIS_TORQUE, color=GREY, alpha=0.12, label="axes of the thesis")
    style_panel(wide, "the whole axis of the thesis", "friction torque (N·m)")
    style_panel(close, "close: a slow hand", "friction torque (N·m)")
    figure.legend(*wide.get_legend_handles_labels(), ncols=4, **BELOW)
    return figure


def draw_spring(run: BenchRun) -> Figure:
    """Draw the spring in the torque of the motor and in the torque of the hand."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes, rows = figure.subplots(), last_period(run)
    angle, motor = angle_from_rest(run, rows), -electromechanical_torque(run)[rows]
    hand = run.column("imposed_motion_torque_Nm")[rows]
    axes.plot(angle, hand, color=REDDISH_PURPLE, label="hand, friction included")
    axes.plot(angle, motor, color=BLUE, label="motor, $-T_{em}$: the spring")
    axes.plot(SPRING_ANGLE, 1.0, "o", color=VERMILLION, label="thesis: 1 N·m at about 20°")
    axes.set_xlabel("θ - θ0 (deg)")
    axes.legend(loc="upper left", **SMALL)
    style_panel(axes, "spring of 0.05 N·m/deg without friction compensation", "torque (N·m)")
    return figure


def _turn(values: np.ndarray, rows: slice, after: int) -> slice:
    """Return the rows around the value of a period that is nearest to zero, away from its ends."""
    middle = rows.start + 500 + int(np.argmin(np.abs(values[rows.start + 500 : rows.stop - 500])))
    return slice(middle - 150, middle + after)


def draw_currents(found: Sequence[CurrentErrors]) -> Figure:
    """Draw currents of the first motion over a period and at its reversal, and all errors by phase."""
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    grid = figure.add_gridspec(2, 2)
    period, close = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[1, 0])
    run = found[0].run
    rows, target = last_period(run), run.column("target_current_A")
    recomputed = off_line_current(run, run.test.sensors.decimation // 2)
    for axes, shown in ((period, rows), (close, _turn(target, rows, 200))):
        time, measured = np.arange(shown.start, shown.stop) * TICK, run.column("measured_current_A")[shown]
        label = "recomputed from the log, five ticks out of phase"
        axes.plot(time, measured, color=BLUE, linewidth=0.5, alpha=0.6, label="measured")
        axes.plot(time, target[shown], color=VERMILLION, linewidth=1.6, label="target")
        axes.plot(time, recomputed[shown], "--", color=ORANGE, linewidth=1.2, label=label)
        axes.set_xlabel("time (s)")
    style_panel(period, f"{found[0].hand.words}, G = {GAINS[0]}", "current (A)")
    style_panel(close, "where the hand turns", "current (A)")
    figure.legend(*period.get_legend_handles_labels(), ncols=3, **BELOW)
    _draw_errors(figure.add_subplot(grid[1, 1]), found)
    return figure


def _draw_errors(axes: Axes, found: Sequence[CurrentErrors]) -> None:
    for errors, colour in zip(found, (SKY_BLUE, ORANGE, GREY, BLUISH_GREEN), strict=True):
        axes.plot(1e3 * np.array(errors.off_line), color=colour, marker="o", label=errors.hand.words)
    axes.axhline(1e3 * OFF_LINE_RMSE, color=VERMILLION, linestyle="--", label=f"thesis: {OFF_LINE_RMSE} A")
    axes.set_xlabel("row of the log at which decimation begins")
    axes.set_xticks(range(len(found[0].off_line)))
    axes.set_ylim(0.0, 1.6e3 * max(max(errors.off_line) for errors in found))
    axes.legend(loc="upper left", ncols=2, **SMALL)
    style_panel(axes, "target less recomputed current", "RMSE (mA)")


def draw_impedance(run: BenchRun, slopes: Sequence[float]) -> Figure:
    """Draw the loops of motor and hand, and the slope over the velocity of the hand."""
    figure = Figure(figsize=(12.0, 4.2), layout="constrained")
    motor, hand, speed = figure.subplots(1, 3)
    rows, slope = last_period(run), slope_per_deg(run)
    angle, torque = angle_from_rest(run, rows), -electromechanical_torque(run)[rows]
    hand_torque = run.column("imposed_motion_torque_Nm")[rows]
    regression = slope * angle + float(np.mean(torque - slope * angle))
    motor.plot(angle, torque, color=BLUE, linewidth=1.0, label="$-T_{em}$ (motor)")
    motor.plot(angle, regression, color=ORANGE, label=f"regression: {slope:.4f} N·m/deg")
    hand.plot(angle, hand_torque, color=REDDISH_PURPLE, linewidth=1.0, label="hand")
    for axes in (motor, hand):
        label = "$T_{des} = k(θ-θ_0)$"
        axes.plot(angle, STIFFNESS_PER_DEG * angle, ":", color=BLACK, linewidth=1.2, label=label)
        axes.set(xlabel="θ - θ0 (deg)", ylim=(-5.2, 5.2))
        axes.legend(loc="upper left", **SMALL)
    style_panel(motor, f"the motor's loop is G T_fr; thesis: {MEASURED_SLOPE} N·m/deg", "torque (N·m)")
    style_panel(hand, "the loop of the hand is the residual friction", "torque (N·m)")
    _draw_slopes(speed, run, slopes)
    return figure


def _draw_slopes(axes: Axes, run: BenchRun, slopes: Sequence[float]) -> None:
    delay = closed_delay(run.test.sensors.window, run.test.sensors.decimation)
    fine = np.linspace(0.01, VELOCITIES[-1], 25)
    label = f"closed form, rigid hand, {1e3 * delay:.1f} ms"
    for lag, style, text in ((delay, "-", label), (PRINTED_DELAY, "--", f"the same, {PRINTED_DELAY} s")):
        closed = [closed_slope(GAINS[0], REACH, float(value), lag) for value in fine]
        axes.plot(fine, closed, color=GREY, linestyle=style, label=text)
    axes.plot(VELOCITIES, slopes, color=BLUE, marker="o", linestyle="", label="bench")
    axes.axhline(MEASURED_SLOPE, color=VERMILLION, linestyle="--", label=f"thesis: {MEASURED_SLOPE}")
    axes.axhline(STIFFNESS_PER_DEG, color=BLACK, linewidth=0.8, label=f"k = {STIFFNESS_PER_DEG}")
    axes.set(ylim=(0.0470, 0.0504), xlabel="greatest velocity of the hand (rad/s)")
    axes.legend(loc="lower left", **SMALL)
    style_panel(axes, "a delayed filter reduces the slope", "slope (N·m/deg)")


def draw_gain(led: Sequence[BenchRun], released: Sequence[BenchRun], areas: Sequence[LoopAreas]) -> Figure:
    """Draw loops of motor and hand for all ``GAINS``, their areas over G, and the swing after a release."""
    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    (motor, hand), (area, swing) = figure.subplots(2, 2)
    for run, gain, colour in zip(led, GAINS, GAIN_COLOURS, strict=True):
        rows = last_period(run)
        angle, look = angle_from_rest(run, rows), {"color": colour, "label": f"G = {gain:.2f}"}
        motor.plot(angle, -electromechanical_torque(run)[rows], **look)
        hand.plot(angle, run.column("imposed_motion_torque_Nm")[rows], **look)
    for axes in (motor, hand):
        axes.plot(angle, STIFFNESS_PER_DEG * angle, color=REDDISH_PURPLE, label="$T_{des}$, 0.05 N·m/deg")
        axes.set(xlabel="θ - θ0 (deg)", ylim=(-5.2, 5.2))
        axes.legend(loc="upper left", **SMALL)
    style_panel(motor, "motor, $-T_{em}$: the loop grows with G by construction", "torque (N·m)")
    style_panel(hand, f"hand: the loop shrinks with G (s = {RATIO})", "torque (N·m)")
    _draw_areas(area, areas)
    for run, gain, colour in zip(released, GAINS, GAIN_COLOURS, strict=True):
        angle, label = (
            angle_from_rest(run, column="motor_angle_rad"),
            f"G = {gain:.2f}: {overshoot(run):.0f}°",
        )
        swing.plot(run.column("time_s"), angle, color=colour, label=label)
    release = released[0].test.imposed_motion.release_time
    swing.axvline(release, color=GREY, linestyle="--", label="the hand lets go")
    swing.set_xlabel("time (s)")
    swing.legend(**SMALL)
    style_panel(swing, "pushed away and let go: swing beyond θ0", "θ - θ0 (deg)")
    return figure


def _draw_areas(axes: Axes, areas: Sequence[LoopAreas]) -> None:
    for each, style in zip(areas, ("-", "--"), strict=True):
        axes.plot(GAIN_GRID, each.motor, style, marker="o", color=BLUE, label=f"motor, s = {each.ratio}")
        axes.plot(GAIN_GRID, each.hand, style, marker="s", color=VERMILLION, label=f"hand, s = {each.ratio}")
        axes.axvline(each.ratio, color=GREY, linestyle=style, linewidth=0.8)
    axes.axvspan(*USABLE_GAINS, color=GREY, alpha=0.12, label="usable, thesis ch. 4")
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.set_xlabel("G")
    axes.legend(ncols=2, **SMALL)
    style_panel(axes, "area of the loops", "work per cycle (J)")


def draw_delay(found: FilterDelay) -> Figure:
    """Draw velocities over a period, and in detail at the reversal of the hand."""
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    wide, close = figure.subplots(1, 2)
    close.xaxis.set_major_locator(MaxNLocator(5))
    run = found.run
    time, rows, true = run.column("time_s"), last_period(run), run.column("motor_velocity_rad_per_s")
    lines = (
        ("log, 1 kHz", run.column("velocity_rad_per_s"), "0.8", 0.8),
        ("true", true, BLACK, 1.4),
        ("log, decimated by 10, mean of 10", found.held, VERMILLION, 1.4),
        ("firmware, decimated by 10, mean of 10", found.slow, BLUE, 1.4),
    )
    for axes, shown in ((wide, rows), (close, _turn(true, rows, 250))):
        for label, values, colour, width in lines:
            axes.plot(time[shown], values[shown], color=colour, linewidth=width, label=label)
        axes.set_xlabel("time (s)")
        axes.axhline(0.0, color=GREY, linewidth=0.6)
    printed, label = np.roll(true[rows], round(PRINTED_DELAY / TICK)), "true, 0.5 s late as printed"
    wide.plot(time[rows], printed, color=GREY, linestyle="--", label=label)
    style_panel(wide, "one period of the hand", "velocity (rad/s)")
    title = f"at its turn: {1e3 * found.firmware:.1f} ms late, not {PRINTED_DELAY} s"
    style_panel(close, title, "velocity (rad/s)")
    figure.legend(*wide.get_legend_handles_labels(), ncols=3, **BELOW)
    return figure
