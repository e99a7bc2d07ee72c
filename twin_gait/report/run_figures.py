"""The pictures of a run: angles over cycle and time, torques, currents, feet, portraits, energy, crutches.

Each takes a run and the width of the figure in inches (one narrower than a screen is for print), and gives
the figure, or None where it does not apply.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from twin_gait.core.actuator import torque_to_current
from twin_gait.gait.table import TICK
from twin_gait.measures.crutches import TRUNK_PITCH
from twin_gait.measures.effort import energy_balance
from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.measures.leg_record import LegRecord, wearer_column
from twin_gait.measures.phases import phase_spells, usual_phases
from twin_gait.measures.strides import PERCENT, normalise_strides, root_mean_square_error, stride_count
from twin_gait.measures.walk import pressure_curve
from twin_gait.palette import (
    BLACK,
    LIMIT_COLOUR,
    ORANGE,
    REFERENCE_COLOUR,
    SIDE_COLOURS,
    TORQUE_COLOURS,
    VERMILLION,
    WORK_COLOURS,
)
from twin_gait.report.canvas import (
    SCREEN_WIDTH,
    Window,
    colour_of,
    draw_cycle_curve,
    draw_over_time,
    draw_phase_bars,
    end_or_events,
    flexion,
    height_of,
    last_strides,
    leg_panels,
    limit_lines,
    mark_events,
    new_figure,
    phase_handles,
    put_legend,
    readable,
    shade_phases,
    shown_phases,
    shown_strides,
    style_panel,
    whole_run,
    window_of,
)
from twin_gait.report.reference import reference_cycle, reference_ground_force
from twin_gait.simulation.log import work_sources
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName

SHOWN_SECONDS = 30.0  # of angles, on a screen; a narrower picture shows less
MOST_STRIDES = 10  # of a portrait
REFERENCE_STYLE: dict[str, Any] = {"color": REFERENCE_COLOUR, "linestyle": (0, (4, 2)), "linewidth": 1.6}
_FORCE_PANELS = (
    ("vertical force", "force / carried weight"),
    ("fore-aft force, forwards positive", "force / carried weight"),
    ("centre of pressure", "place on the sole"),
)
BAR = 0.7  # height of a phase bar, in rows


def draw_cycle(run: Run, *, width: float = SCREEN_WIDTH) -> Figure | None:
    """Draw the mean cycle of every joint with its range and the reference; None without strides."""
    records, names = run.leg_records(), run.table.phase_names
    if any(len(shown_strides(record)) == 0 for record in records):
        return None
    beginning = "heel strike" if records[0].contacts is not None else f"entry into {readable(names[0])}"
    figure = new_figure(run, f"Gait cycle from {beginning}", height=height_of(7.5, records), width=width)
    lines: list[Artist] = []
    for axes, record, joint in leg_panels(figure, records, flexion, sharex=True, sharey="row"):
        lines += _draw_mean_cycle(axes, run, record, joint)
        axes.label_outer()
    put_legend(figure, lines, phase_handles(names, np.concatenate([item.phases for item in records])))
    return figure


def _draw_mean_cycle(axes: Axes, run: Run, record: LegRecord, joint: JointName) -> list[Artist]:
    bounds, names = shown_strides(record), run.table.phase_names
    cycles = normalise_strides(record.angles[joint], bounds)
    shade_phases(axes, PERCENT, usual_phases(record.phases, bounds, len(names)), names)
    lines = _draw_mean_and_range(axes, np.degrees(cycles))
    title = f"{record.side} {joint}, {stride_count(len(bounds), len(record.strides(skip=0)))}"
    reference = reference_cycle(run.experiment, joint)
    if reference is not None:
        lines += draw_cycle_curve(
            axes, np.degrees(reference), **REFERENCE_STYLE, label="healthy, Koopman (2014)"
        )
        title += f", RMSE {math.degrees(root_mean_square_error(cycles, reference)):.1f}°"
    axes.set_title(title, fontsize="medium")
    return lines


def _draw_mean_and_range(axes: Axes, cycles: np.ndarray) -> list[Artist]:
    """Draw mean and range over strides."""
    low, high = cycles.min(axis=0), cycles.max(axis=0)
    label = "range over strides"
    spread = axes.fill_between(PERCENT, low, high, color=BLACK, alpha=0.25, linewidth=0, label=label)
    mean = draw_cycle_curve(axes, cycles.mean(axis=0), color=BLACK, linewidth=1.8, label="mean over strides")
    return [*mean, spread]


def draw_angles(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw the joint angles of the last seconds with the equilibrium of the virtual spring."""
    window = end_or_events(run, SHOWN_SECONDS * width / SCREEN_WIDTH)

    def draw(axes: Axes, record: LegRecord, joint: JointName) -> list[Artist]:
        name = f"{record.side}_{joint}"
        shown = [
            (record.angles[joint], BLACK, "-", "angle"),
            (run.log[f"{name}_equilibrium_rad"].to_numpy(), REFERENCE_COLOUR, ":", "equilibrium angle"),
        ]
        if run.experiment.interface is not None:
            shown.append((run.log[f"{name}_angle_rad"].to_numpy(), ORANGE, "--", "angle of the device"))
        lines: list[Artist] = []
        for values, colour, style, label in shown:
            degrees = np.degrees(values[window.rows])
            lines += axes.plot(window.time, degrees, color=colour, linestyle=style, label=label)
        return lines

    return draw_over_time(run, window, "Joint angles", flexion, draw, size=(width, 7.5))


def draw_torques(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw what the controller asks for, part by part, and what the motor gives."""
    window = last_strides(run, run.leg_records())
    limit = run.experiment.control.limits.torque

    def draw(axes: Axes, record: LegRecord, joint: JointName) -> list[Artist]:
        lines: list[Artist] = []
        for part, colour in TORQUE_COLOURS.items():
            values = run.log[f"{record.side}_{joint}_{part}_torque_Nm"].to_numpy()[window.rows]
            if np.any(values != 0.0):
                lines += axes.plot(window.time, values, color=colour, linewidth=1.3, label=readable(part))
        motor = run.log[f"{record.side}_{joint}_motor_torque_Nm"].to_numpy()[window.rows]
        lines += axes.plot(window.time, motor, color=BLACK, linewidth=2.0, label="motor torque")
        return [*lines, *limit_lines(axes, (limit, -limit), "--", "torque limit", 1.0)]

    title = "Motor torques and their parts"
    return draw_over_time(run, window, title, lambda _: "torque [N m]", draw, size=(width, 8.0))


def draw_currents(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw target and measured current of every motor, and the battery's power under them."""
    window = last_strides(run, run.leg_records())

    def draw(axes: Axes, record: LegRecord, joint: JointName) -> list[Artist]:
        name = f"{record.side}_{joint}"
        target = run.log[f"{name}_target_current_A"].to_numpy()[window.rows]
        measured = run.log[f"{name}_measured_current_A"].to_numpy()[window.rows]
        actuator, limits = run.experiment.plant.actuators[joint], run.experiment.control.limits
        at_torque = torque_to_current(limits.torque, actuator.torque_constant, actuator.gear_ratio)
        return [
            *axes.plot(window.time, target, color=ORANGE, linewidth=2.4, label="target current"),
            *axes.plot(window.time, measured, color=BLACK, linewidth=1.2, label="measured current"),
            *limit_lines(axes, (limits.current, -limits.current), "--", "current limit", 1.2),
            *limit_lines(axes, (at_torque, -at_torque), ":", "current at the torque limit", 1.2),
        ]

    def battery(axes: Axes) -> list[Artist]:
        power = run.log["battery_power_W"].to_numpy()[window.rows]
        continuous = run.experiment.plant.battery.continuous_power
        axes.axhline(0.0, color="0.6", linewidth=0.8)
        style_panel(axes, "battery, below 0 while the motors feed it", "power [W]")
        label = "continuous battery power"
        limit = axes.axhline(continuous, color=LIMIT_COLOUR, linestyle="-.", linewidth=1.2, label=label)
        curve = axes.plot(window.time, power, color=VERMILLION, linewidth=1.4, label="battery power")
        return [*curve, limit]

    title = "Motor currents and battery power"
    return draw_over_time(run, window, title, lambda _: "current [A]", draw, size=(width, 9.0), last=battery)


def draw_feet(run: Run, *, width: float = SCREEN_WIDTH) -> Figure | None:
    """Draw foot forces and clearances with the phases of both legs under them; None without ground."""
    records = run.leg_records()
    if any(record.contacts is None for record in records):
        return None
    window = last_strides(run, records)
    figure = new_figure(run, "Feet on the ground", height=8.5, width=width)
    force, clearance, bars = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 1))
    lines = [*_draw_forces(force, run, records, window), *_draw_clearances(clearance, records, window)]
    lines += [line for axes in (force, clearance) for line in mark_events(axes, run, window)]
    phases = [shown_phases(run, record, window) for record in records]
    rows = [(str(record.side), codes) for record, codes in zip(records, phases, strict=True)]
    draw_phase_bars(bars, window.time, rows, run.table.phase_names, height=BAR, alpha=0.9)
    style_panel(bars, "phase", "")
    bars.grid(visible=False, axis="y")
    bars.set_xlabel("time [s]")
    bars.set_xlim(window.time[0], window.time[-1])
    put_legend(figure, lines, phase_handles(run.table.phase_names, np.concatenate(phases)))
    return figure


def draw_ground_forces(run: Run, *, width: float = SCREEN_WIDTH) -> Figure | None:
    """Draw the force of the ground over the mean cycle beside a healthy one; None without strides."""
    records, walkway = run.leg_records(), run.walkway
    if walkway is None or any(len(shown_strides(record)) == 0 for record in records):
        return None
    names, healthy = run.table.phase_names, reference_ground_force(run.experiment)
    figure = new_figure(run, "Force of the ground over the gait cycle", height=9.5, width=width)
    heights = (3.0, 2.0, 1.4)
    grid = figure.subplots(3, len(records), squeeze=False, sharex=True, sharey="row", height_ratios=heights)
    label = "healthy, Winter (1991)"
    lines: list[Artist] = []
    for column, record in zip(grid.T, records, strict=True):
        bounds, phases = shown_strides(record), usual_phases(record.phases, shown_strides(record), len(names))
        for axes, (title, unit) in zip(column, _FORCE_PANELS, strict=True):
            style_panel(axes, f"{record.side} {title}", unit if record is records[0] else "")
            shade_phases(axes, PERCENT, phases, names)
        load, forward, place = (
            run.log[f"{record.side}_foot_{end}"].to_numpy()
            for end in ("normal_force_N", "friction_force_N", "pressure_place")
        )
        for number, force in enumerate((load, forward)):
            column[number].axhline(1.0 - number, color=LIMIT_COLOUR, linestyle=":", linewidth=1.2)
            lines += _draw_mean_and_range(
                column[number], normalise_strides(force, bounds) / walkway.carried_weight
            )
            if healthy is not None:
                style = {**REFERENCE_STYLE, "label": label}
                lines += draw_cycle_curve(column[number], healthy[number], **style)
        draw_cycle_curve(column[2], pressure_curve(place, load, bounds), color=BLACK, linewidth=1.8)
        for axes in column:
            axes.label_outer()
    grid[0, 0].set_ylim(bottom=0.0)
    grid[2, 0].set_yticks((0.0, 0.5, 1.0), ("heel", "middle", "toe"))
    grid[2, 0].set_ylim(-0.1, 1.15)
    put_legend(figure, lines, phase_handles(names, np.concatenate([item.phases for item in records])))
    return figure


def _draw_forces(axes: Axes, run: Run, records: list[LegRecord], window: Window) -> list[Artist]:
    lines: list[Artist] = []
    for record in records:
        assert record.normal_force is not None and record.contacts is not None  # checked by the caller
        colour, force = SIDE_COLOURS[record.side], record.normal_force[window.rows]
        lines += axes.plot(window.time, force, color=colour, linewidth=1.5, label=f"{record.side} foot")
        strikes = record.contacts.heel_strikes
        strikes = strikes[(strikes >= window.rows.start) & (strikes < window.rows.stop)]
        height, label = np.full(len(strikes), CONTACT_FORCE), f"{record.side} heel strike"
        lines += axes.plot(strikes * record.tick, height, "^", color=colour, markersize=8, label=label)
    label = "weight of wearer and device"
    lines.append(
        axes.axhline(run.body_weight, color=LIMIT_COLOUR, linestyle="--", linewidth=1.0, label=label)
    )
    axes.set_ylim(bottom=0.0)
    style_panel(axes, "normal force", "force [N]")
    return lines


def _draw_clearances(axes: Axes, records: list[LegRecord], window: Window) -> list[Artist]:
    lines: list[Artist] = []
    for record in records:
        assert record.clearance is not None  # checked by the caller
        height, colour = 1e3 * record.clearance[window.rows], SIDE_COLOURS[record.side]
        lines += axes.plot(window.time, height, color=colour, linewidth=1.5, label=f"{record.side} foot")
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    title = "clearance of the lowest point of the sole, negative while it is pressed in"
    style_panel(axes, title, "height [mm]")
    return lines


def draw_portrait(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw angle against velocity, coloured by phase, over the last settled strides or else the whole run."""
    records, names = run.leg_records(), run.table.phase_names
    title = "Phase portraits; a dot marks each change of phase"
    figure = new_figure(run, title, height=height_of(8.5, records), width=width)
    occurring = []
    unit = "{} velocity [°/s]".format
    for axes, record, joint in leg_panels(figure, records, unit, sharex="row", sharey="row"):
        bounds = shown_strides(record)[-MOST_STRIDES:]
        rows = slice(int(bounds[0, 0]), int(bounds[-1, 1])) if len(bounds) else slice(0, len(record.phases))
        phases = shown_phases(run, record, window_of(run, rows))
        speeds = run.log[wearer_column(run.log, record.side, joint, "velocity_rad_per_s")]
        angle, velocity = np.degrees(record.angles[joint][rows]), np.degrees(speeds.to_numpy()[rows])
        points, spells = np.column_stack((angle, velocity)), phase_spells(phases)
        colours = [colour_of(spell.phase, names) for spell in spells]
        # One collection: a line of its own for each of fifty spells takes ten times as long.
        paths = [points[spell.start : spell.end + 1] for spell in spells]
        axes.add_collection(LineCollection(paths, colors=colours, linewidths=1.3, zorder=2))
        changes = [spell.start for spell in spells if spell.start > 0]
        dots = colours[len(spells) - len(changes) :]
        axes.scatter(angle[changes], velocity[changes], s=4.0**2, c=dots, zorder=2.1)
        axes.autoscale_view()
        axes.axhline(0.0, color="0.6", linewidth=0.8)
        axes.set_xlabel(flexion(joint))
        occurring.append(phases)
    put_legend(figure, [], phase_handles(names, np.concatenate(occurring)))
    return figure


def draw_energy(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw work by source, change of energy, and the residual between them."""
    window, sources = whole_run(run), work_sources(run.log)
    energy = (run.log["kinetic_energy_J"] + run.log["potential_energy_J"]).to_numpy()
    works = {source: run.log[f"{source}_work_J"].to_numpy() for source in sources}
    balance = energy_balance(energy, np.array(list(works.values())))
    figure = new_figure(run, "Energy balance", height=7.5, width=width)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    lines: list[Artist] = []
    for source, work in works.items():
        if np.any(work != 0.0):
            colour, label = WORK_COLOURS[source], f"work of {source}"
            lines += upper.plot(window.time, work[window.rows], color=colour, linewidth=1.5, label=label)
    change = (energy - energy[0])[window.rows]
    lines += upper.plot(window.time, change, color=BLACK, linewidth=1.8, label="kinetic and potential energy")
    lines += mark_events(upper, run, window)
    style_panel(upper, "work since the start, and change of energy", "energy [J]")
    lower.plot(window.time, balance.residual[window.rows], color=BLACK, linewidth=1.2)
    share = 100.0 * balance.relative_residual
    style_panel(
        lower,
        f"energy less work: at most {balance.largest_residual:.2g} J of the {balance.throughput:.1f} J "
        f"exchanged ({share:.2g} %)",
        "energy [J]",
    )
    lower.set_xlabel("time [s]")
    lower.set_xlim(window.time[0], window.time[-1])
    put_legend(figure, lines)
    return figure


def draw_crutches(run: Run, *, width: float = SCREEN_WIDTH) -> Figure | None:
    """Draw lean of the trunk, forces on the crutches and work of the arms; None without crutches."""
    if any(f"{side}_arm_power_W" not in run.log for side in run.sides):
        return None
    window = whole_run(run)
    figure = new_figure(run, "Trunk, crutches and arms", height=8.0, width=width)
    lean, force, work = figure.subplots(3, 1, sharex=True)
    degrees = np.degrees(run.log[TRUNK_PITCH].to_numpy()[window.rows])
    lines: list[Artist] = [*lean.plot(window.time, degrees, color=BLACK, linewidth=1.5, label="trunk")]
    for side in run.sides:
        load = run.log[f"{side}_crutch_normal_force_N"].to_numpy()
        done = TICK * np.cumsum(run.log[f"{side}_arm_power_W"].to_numpy())
        for axes, values in ((force, load), (work, done)):
            label = f"{side} arm and crutch"
            lines += axes.plot(
                window.time, values[window.rows], color=SIDE_COLOURS[side], linewidth=1.5, label=label
            )
    style_panel(lean, "lean of the trunk, forwards positive", "angle [°]")
    style_panel(force, "force of the ground on the crutch, upwards", "force [N]")
    style_panel(work, "work of the arm since the start", "work [J]")
    for axes in (lean, force, work):
        lines += mark_events(axes, run, window)
        axes.axhline(0.0, color="0.6", linewidth=0.8)
    work.set_xlim(window.time[0], window.time[-1])
    work.set_xlabel("time [s]")
    put_legend(figure, lines)
    return figure
