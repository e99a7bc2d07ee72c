"""Pictures of a run: angles over cycle and time, torques, currents, battery, feet, portraits.

Each function takes a run and the width of the figure in inches (a figure narrower than a screen is for
print), and returns the figure, or None if it does not apply.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait import palette
from twin_gait.core.actuator import torque_to_current
from twin_gait.gait.table import TICK
from twin_gait.labels import label_of
from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.measures.leg_record import wearer_column
from twin_gait.measures.phases import usual_phases
from twin_gait.measures.strides import (
    PERCENT,
    describe_stride_count,
    join_strides,
    normalise_strides,
    root_mean_square_error,
)
from twin_gait.measures.walk import cop_curve
from twin_gait.palette import BLACK, ORANGE, REFERENCE_COLOUR
from twin_gait.report import canvas
from twin_gait.report.canvas import (
    SCREEN_WIDTH,
    RunFigure,
    draw_cycle_curve,
    shown_strides,
    style_panel,
)
from twin_gait.report.reference import (
    reference_cycle,
    reference_deviation,
    reference_ground_force,
    reference_label,
)
from twin_gait.report.state_diagram import name_to_words
from twin_gait.simulation.run import Run

SHOWN_SECONDS = 30.0  # time range of the angles on a screen; a narrower picture shows less
FLEXION = "{}_flexion_rad"  # key of the label of an angle
MOST_STRIDES = 10  # largest number of strides in a phase portrait
REFERENCE_STYLE: dict[str, Any] = {"color": REFERENCE_COLOUR, "linestyle": (0, (4, 2)), "linewidth": 1.6}
_FORCE_PANELS = (
    ("vertical force", "force / carried weight"),
    ("fore-aft force, forwards positive", "force / carried weight"),
    ("centre of pressure", "place on the sole"),
)


def draw_cycle(run: Run, *, width: float = SCREEN_WIDTH) -> Figure | None:
    """Draw the mean cycle of every joint with its SD and the reference; return None without strides."""
    if not canvas.has_cycles(run):
        return None
    records = run.leg_records()
    entry = f"entry into {name_to_words(run.table.phase_names[0])}"
    beginning = entry if records[0].contacts is None else "heel strike"
    sheet, drawn = RunFigure(run, f"Gait cycle from {beginning}", (width, 7.5)), list[np.ndarray]()
    for axes, record, joint in sheet.leg_panels(FLEXION, timed=False):
        bounds = shown_strides(record)
        cycles = normalise_strides(record.angles[joint], bounds)
        drawn.append(usual_phases(sheet.phase_codes(record), bounds, len(sheet.names)))
        canvas.shade_phases(axes, PERCENT, drawn[-1], sheet.names)
        _draw_mean_and_sd(sheet, axes, np.degrees(cycles))
        title = f"{record.side} {joint}, {describe_stride_count(len(bounds), len(record.strides(skip=0)))}"
        reference = reference_cycle(run.experiment, joint)
        if reference is not None:
            _draw_reference(sheet, axes, np.degrees(reference), reference_label(run.experiment))
            spread = reference_deviation(run.experiment, joint)
            if spread is not None:
                _draw_deviation(sheet, axes, np.degrees(reference), np.degrees(spread))
            title += f", RMSE {math.degrees(root_mean_square_error(cycles, reference)):.1f}°"
        axes.set_title(title, fontsize="medium")
        axes.label_outer()
    return sheet.finish(drawn)


def _draw_mean_and_sd(sheet: RunFigure, axes: Axes, cycles: np.ndarray) -> None:
    """Draw the mean over strides, and mean ± SD for two strides or more; ``cycles``: shape ``(n, 101)``."""
    mean, label = cycles.mean(axis=0), "mean over strides" if len(cycles) > 1 else "one stride"
    sheet.lines += draw_cycle_curve(axes, mean, color=BLACK, linewidth=1.8, label=label)
    if len(cycles) > 1:
        spread, label = cycles.std(axis=0, ddof=1), "mean ± SD over strides"
        band: dict[str, Any] = {"color": BLACK, "alpha": 0.25, "linewidth": 0, "label": label}
        sheet.lines.append(axes.fill_between(PERCENT, mean - spread, mean + spread, **band))


def _draw_reference(sheet: RunFigure, axes: Axes, cycle: np.ndarray, label: str) -> None:
    sheet.lines += draw_cycle_curve(axes, cycle, **REFERENCE_STYLE, label=label)


def _draw_deviation(sheet: RunFigure, axes: Axes, mean: np.ndarray, spread: np.ndarray) -> None:
    """Draw the band of one standard deviation of the reference, shape ``(101,)``."""
    style: dict[str, Any] = {"color": REFERENCE_COLOUR, "alpha": 0.2, "linewidth": 0}
    label = "reference ± SD"
    sheet.lines.append(axes.fill_between(PERCENT, mean - spread, mean + spread, label=label, **style))


def draw_ground_forces(run: Run, *, width: float = SCREEN_WIDTH) -> Figure | None:
    """Draw the ground reaction force over the mean cycle with a healthy one; return None without strides."""
    records, walkway = run.leg_records(), run.walkway
    if walkway is None or not canvas.has_cycles(run):
        return None
    sheet, drawn = RunFigure(run, "Force of the ground over the gait cycle", (width, 9.5)), list[np.ndarray]()
    healthy = reference_ground_force(run.experiment)
    grid = sheet.figure.subplots(
        3, len(records), squeeze=False, sharex=True, sharey="row", height_ratios=(3.0, 2.0, 1.4)
    )
    for column, record in zip(grid.T, records, strict=True):
        bounds = shown_strides(record)
        phases = usual_phases(sheet.phase_codes(record), bounds, len(sheet.names))
        drawn.append(phases)
        for axes, (title, unit) in zip(column, _FORCE_PANELS, strict=True):
            style_panel(axes, f"{record.side} {title}", unit if record is records[0] else "")
            canvas.shade_phases(axes, PERCENT, phases, sheet.names)
        load, forward, cop = (
            run.log[f"{record.side}_foot_{end}"].to_numpy()
            for end in ("normal_force_N", "friction_force_N", "cop_ratio")
        )
        for number, (axes, force) in enumerate(zip(column, (load, forward), strict=False)):
            axes.axhline(1.0 - number, color=palette.LIMIT_COLOUR, linestyle=":", linewidth=1.2)
            _draw_mean_and_sd(sheet, axes, normalise_strides(force, bounds) / walkway.carried_weight)
            if healthy is not None:
                _draw_reference(sheet, axes, healthy[number], "healthy, Winter (1991)")
        draw_cycle_curve(column[2], cop_curve(cop, load, bounds), color=BLACK, linewidth=1.8)
        for axes in column:
            axes.label_outer()
    grid[0, 0].set_ylim(bottom=0.0)
    grid[2, 0].set_yticks((0.0, 0.5, 1.0), ("heel", "middle", "toe"))
    grid[2, 0].set_ylim(-0.1, 1.15)
    return sheet.finish(drawn)


def draw_angles(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw the joint angles of the last seconds with the equilibrium of the virtual spring."""
    window = canvas.event_window(run, SHOWN_SECONDS * width / SCREEN_WIDTH)
    sheet = RunFigure(run, "Joint angles", (width, 7.5), window)
    for axes, record, joint in sheet.leg_panels(FLEXION):
        name = f"{record.side}_{joint}_"
        angle_column = wearer_column(run.log, record.side, joint, "angle_rad").removeprefix(name)
        sheet.curve(axes, name, angle_column, BLACK, label="angle")
        spring = "equilibrium_rad" if joint in record.driven else "own_equilibrium_rad"
        sheet.curve(axes, name, spring, REFERENCE_COLOUR, linestyle=":")
        if run.experiment.interface is not None:
            sheet.curve(axes, name, "angle_rad", ORANGE, label="angle of the device", linestyle="--")
    return sheet.finish_time_plot()


def draw_torques(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw the parts of the command torque and the motor torque, and torques of the wearer's own gait."""
    window, limits = canvas.last_strides(run), run.experiment.control.limits
    sheet = RunFigure(run, "Motor torques and their parts", (width, 8.0), window)
    for axes, record, joint in sheet.leg_panels("torque_Nm"):
        name = f"{record.side}_{joint}_"
        if joint not in record.driven:
            sheet.curve(axes, name, "own_torque_Nm", palette.VERMILLION, linewidth=2.0)
            continue
        for part, colour in palette.TORQUE_COLOURS.items():
            if np.any(run.log[f"{name}{part}_torque_Nm"].to_numpy()[window] != 0.0):
                sheet.curve(axes, name, f"{part}_torque_Nm", colour, linewidth=1.3)
        sheet.curve(axes, name, "motor_torque_Nm", BLACK, linewidth=2.0)
        limit = limits[joint].torque
        sheet.limits(axes, (limit, -limit), "--", "torque limit", 1.0)
    return sheet.finish_time_plot()


def draw_currents(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw target and measured current of every motor."""
    experiment = run.experiment
    sheet = RunFigure(run, "Motor currents", (width, 8.0), canvas.last_strides(run))
    for axes, record, joint in sheet.leg_panels("current_A", driven=True):
        name, actuator = f"{record.side}_{joint}_", experiment.plant.actuators[joint]
        limits = experiment.control.limits[joint]
        at_torque = torque_to_current(limits.torque, actuator.torque_constant, actuator.gear_ratio)
        sheet.curve(axes, name, "target_current_A", ORANGE, linewidth=2.4)
        sheet.curve(axes, name, "measured_current_A", BLACK, linewidth=1.2)
        sheet.limits(axes, (limits.current, -limits.current), "--", "current limit")
        sheet.limits(axes, (at_torque, -at_torque), ":", "current at the torque limit")
    return sheet.finish_time_plot()


def draw_battery(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw the power of the battery."""
    sheet = RunFigure(run, "Battery power", (width, 6.5), canvas.last_strides(run))
    axes = sheet.figure.subplots()
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    style_panel(axes, "battery, below 0 while the motors feed it", label_of("power_W").axis)
    sheet.curve(axes, "", "battery_power_W", palette.VERMILLION, linewidth=1.4)
    sheet.limits(axes, [run.experiment.plant.battery.continuous_power], "-.", "continuous battery power")
    return sheet.finish_time_plot(axes, phases=False)


def draw_feet(run: Run, *, width: float = SCREEN_WIDTH) -> Figure | None:
    """Draw forces and clearances of both feet; return None without ground."""
    records = run.leg_records()
    if any(record.contacts is None for record in records):
        return None
    window = canvas.last_strides(run)
    sheet = RunFigure(run, "Feet on the ground", (width, 8.5), window)
    force, clearance = sheet.figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    for record in records:
        colour, label, foot = palette.SIDE_COLOURS[record.side], f"{record.side} foot", f"{record.side}_foot_"
        sheet.curve(force, foot, "normal_force_N", colour, label=label)
        sheet.curve(clearance, foot, "clearance_m", colour, label=label)
        strikes = record.stride_events  # heel strikes, because there is ground
        strikes = strikes[(strikes >= window.start) & (strikes < window.stop)]
        height, label = np.full(len(strikes), CONTACT_FORCE), f"{record.side} heel strike"
        sheet.lines += force.plot(strikes * TICK, height, "^", color=colour, markersize=8, label=label)
    sheet.limits(force, [run.body_weight], "--", "weight of wearer and device", 1.0)
    force.set_ylim(bottom=0.0)
    style_panel(force, label_of("normal_force_N").name, label_of("normal_force_N").axis)
    clearance.axhline(0.0, color="0.6", linewidth=0.8)
    title = "clearance of the lowest point of the sole, negative while it is pressed in"
    style_panel(clearance, title, label_of("clearance_m").axis)
    return sheet.finish_time_plot(clearance, phases=False)


def draw_portrait(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw velocity over angle, coloured by phase, for the last strides of a walk or else the whole run."""
    title = "Phase portraits; a dot marks each change of phase"
    sheet, occurring = RunFigure(run, title, (width, 8.5)), []
    velocity, angle = label_of("velocity_rad_per_s"), label_of("angle_rad")
    for axes, record, joint in sheet.leg_panels("{}_velocity_rad_per_s", timed=False):
        bounds = shown_strides(record)[-MOST_STRIDES:]
        rows = slice(*join_strides(bounds)[-1].tolist()) if len(bounds) else slice(0, len(record.phases))
        phases = sheet.phases(record, rows)
        speeds = run.log[wearer_column(run.log, record.side, joint, "velocity_rad_per_s")].to_numpy()
        points = np.column_stack((angle.factor * record.angles[joint], velocity.factor * speeds))[rows]
        changed = np.diff(phases, prepend=phases[0]) != 0
        for phase in np.unique(phases):
            of_phase, colour = phases == phase, canvas.colour_of(phase, sheet.names)
            axes.plot(*np.where(of_phase[:, None], points, np.nan).T, color=colour, linewidth=1.3)
            axes.plot(*points[of_phase & changed].T, "o", color=colour, markersize=4.0)
        axes.axhline(0.0, color="0.6", linewidth=0.8)
        axes.set_xlabel(label_of(FLEXION.format(joint)).axis)
        occurring.append(phases)
    return sheet.finish(occurring)
