"""Results of a replay and their folder: strides, onsets, agreement with recorded phases, a figure."""

from collections import Counter
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from twin_gait.files import write_atomically, write_json, write_parquet
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.labels import label_of
from twin_gait.measures.phases import phase_entries, phase_spells
from twin_gait.measures.reference import CYCLE
from twin_gait.measures.strides import stride_times, swing_shares
from twin_gait.palette import JOINT_COLOURS
from twin_gait.replay.foot_events import LONGEST_STRIDE, SHORTEST_STRIDE, foot_strikes, walking_strides
from twin_gait.replay.machine import Replay
from twin_gait.replay.samples import LEAST_HIP_RANGE
from twin_gait.replay.strides import angles_log
from twin_gait.report import canvas
from twin_gait.report.failures import failed_pictures
from twin_gait.report.pages import FIGURES_FOLDER
from twin_gait.report.state_diagram import name_to_words
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.runs.record import LOG_FILE, SUMMARY_FILE, SWITCHES_FILE, format_switches_csv
from twin_gait.runs.stride_table import STRIDES_FILE, strides_csv
from twin_gait.vocabulary import JointName, Side

PHASES_FILE = "phases.csv"
REPLAY = FolderKind("a replay", PHASES_FILE)
SHOWN_TICKS = 6000
# Distance of the hip between the ends of a stride over its range in the stride; walking has a smaller one.
OPEN_SHARE = 0.5
WIDTH, JOINT_HEIGHT, ROW_HEIGHT = 12.0, 2.2, 0.33  # [inches]


Stride = tuple[int, int, tuple[int, ...]]  # first tick, first tick of the next stride, phases in order


def stride_phases(phases: np.ndarray) -> list[Stride]:
    """Find the strides of a leg, each from an entry into the first phase of the table to the next entry.

    ``phases``: index of the phase at each tick, shape ``(n,)``.
    """
    spells, entries = phase_spells(phases), phase_entries(phases, 0)
    return [
        (int(start), int(end), tuple(item.phase for item in spells if start <= item.start < end))
        for start, end in pairwise(entries[entries > 0])  # tick 0 is no entry
    ]


def phase_onsets(phases: np.ndarray, bounds: np.ndarray | None = None) -> dict[int, np.ndarray]:
    """Compute the instants at which phases begin in the strides of a leg, in per cent of the stride.

    ``phases``: index of the phase at each tick, shape ``(n,)``. ``bounds``: first tick of each stride and of
    the next one, shape ``(m, 2)``; None for the strides of :func:`stride_phases`. Returns, for each phase
    that begins in a stride, one value for each stride in which it does; if it begins twice in a stride, its
    first entry counts.
    """
    if bounds is None:
        bounds = np.array([item[:2] for item in stride_phases(phases)], dtype=int).reshape(-1, 2)
    onsets, (starts, ends) = dict[int, np.ndarray](), bounds.T
    for phase in np.unique(phases).tolist():
        entries = phase_entries(phases, phase)
        entries = entries[entries > 0]  # tick 0 is no entry
        first = np.append(entries, len(phases))[np.searchsorted(entries, starts)]
        within = first < ends
        if within.any():
            onsets[phase] = CYCLE * ((first - starts) / (ends - starts))[within]
    return onsets


def _describe(values: np.ndarray) -> dict[str, Any]:
    """Return mean, sample standard deviation and number of values of strides."""
    sd = float(values.std(ddof=1)) if len(values) > 1 else None
    return {"mean": float(values.mean()), "sd": sd, "strides": len(values)}


def _unwrap(percent: np.ndarray) -> np.ndarray:
    """Return instants in [%] of cycles such that 99 % and 1 % are 2 % apart; their mean is in [0, 100)."""
    turns = percent / CYCLE
    centre = np.angle(np.exp(2j * np.pi * turns).mean()) / (2.0 * np.pi) % 1.0
    return np.asarray(CYCLE * (centre + (turns - centre + 0.5) % 1.0 - 0.5))


def recorded_strides(result: Replay, side: Side) -> dict[str, Any] | None:
    """Summarise the strides between recorded foot strikes; None if none were recorded."""
    recording = result.recording
    if side not in recording.foot_strikes:
        return None
    bounds = walking_strides(foot_strikes(recording, side)[0])
    offs = np.rint((recording.foot_offs.get(side, np.zeros(0)) - recording.start) / TICK)
    stance = CYCLE * (1.0 - swing_shares(bounds, offs))
    stance = stance[np.isfinite(stance)]
    names, onsets = result.table.phase_names, phase_onsets(result.phases[side], bounds)
    return {
        "stride_time_s": _describe(stride_times(bounds, TICK)) if len(bounds) else None,
        "foot_off_percent": _describe(stance) if len(stance) else None,
        "phase_onset_percent": {names[phase]: _describe(_unwrap(item)) for phase, item in onsets.items()},
    }


def doubtful_strides(hip: np.ndarray, strides: Sequence[Stride]) -> list[str]:
    """Find strides of implausible duration or motion of the hip; return one line for each reason.

    ``hip``: angle of the hip in [rad], shape ``(n,)``.
    """
    lasts = np.array([TICK * (end - start) for start, end, _ in strides])
    moves = np.array([np.ptp(np.degrees(hip[start : end + 1])) for start, end, _ in strides])
    ends = np.array([abs(np.degrees(hip[end] - hip[start])) for start, end, _ in strides])
    shortest, longest = SHORTEST_STRIDE, LONGEST_STRIDE
    found = {
        f"shorter than {shortest:g} s": lasts < shortest,
        f"longer than {longest:g} s": lasts > longest,
        f"with less than {LEAST_HIP_RANGE:g} deg of hip motion": moves < LEAST_HIP_RANGE,
        "no whole cycle of the hip, whose angle at the end differs from that at the start": ends
        > OPEN_SHARE * moves,
    }
    return [
        f"{wrong.sum()} of {len(strides)} strides by the table are {text}: these are no strides of walking"
        for text, wrong in found.items()
        if wrong.any()
    ]


def allowed_cycles(table: GaitTable) -> set[tuple[int, ...]]:
    """Return the orders of phases that a stride may have."""
    if not table.cycles:
        return {tuple(range(len(table.phases)))}
    cycles = [tuple(map(table.phase_index, cycle)) for cycle in table.cycles]
    return {cycle[cycle.index(0) :] + cycle[: cycle.index(0)] for cycle in cycles if 0 in cycle}


def summarise_replay(result: Replay) -> dict[str, Any]:
    """Summarise the results of a replay as plain numbers.

    For each leg: the number of strides, and how many pass through a whole cycle of the table; the onset of
    each phase in the stride; switches by cause; and the share of the ticks whose phase equals the recorded
    one, if phases were recorded. For the log: the gaps that were interpolated, and warnings.
    """
    names, recorded = np.array(result.table.phase_names), result.recording.phases
    cycles, sides, warnings = allowed_cycles(result.table), {}, list(result.recording.warnings)
    for side in result.recording.sides:
        phases, leg_switches = result.phases[side], (item for item in result.switches if item.side is side)
        strides = stride_phases(phases)
        # Switches into postures come first, then all others in the order of the table.
        counts = Counter((item.transition, item.source, item.target, item.cause) for item in leg_switches)
        if (side, JointName.HIP) in result.recording.angles:
            doubts = doubtful_strides(result.recording.angles[side, JointName.HIP], strides)
            warnings += [f"{side}: {text}" for text in doubts]
        mean = TICK * (strides[-1][1] - strides[0][0]) / len(strides) if strides else None
        sides[str(side)] = {
            "strides": len(strides),
            "strides_with_the_whole_cycle": sum(passed in cycles for _, _, passed in strides),
            "stride_time_mean_s": mean,
            "phase_onset_percent": {
                str(names[phase]): _describe(values) for phase, values in phase_onsets(phases).items()
            },
            "recorded_strides": recorded_strides(result, side),
            "switches": [
                {"from": source, "to": target, "cause": cause, "count": count}
                for (_, source, target, cause), count in sorted(counts.items())
            ],
            "equal_share": float(np.mean(names[phases] == recorded[side])) if side in recorded else None,
        }
    return {
        "log": result.recording.source,
        "table": result.table.name,
        "duration_s": result.recording.n_ticks * TICK,
        "assumed_signals": dict(result.assumed),
        "interpolated_gaps": [gap._asdict() for gap in result.recording.gaps],
        "warnings": warnings,
        "cycles": [names[list(cycle)].tolist() for cycle in sorted(cycles)],
        "sides": sides,
    }


def write_replay(
    result: Replay,
    target: Path,
    *,
    strides: pd.DataFrame | None = None,
    force: bool = False,
    pictures: bool = True,
) -> None:
    """Write phases, switches, strides, summary and figure into a folder that appears when it is complete.

    ``strides``: from :func:`twin_gait.replay.strides.replay_strides`; with them the joint angles are written
    too. ``force``: whether the folder of an earlier replay may be replaced. ``pictures``: whether to draw the
    figure. Raises RunDirectoryError if the folder exists, or cannot be written.
    """
    names, recording = np.array(result.table.phase_names), result.recording
    phases = {f"{side}_phase": names[phases] for side, phases in result.phases.items()}
    time = [f"{instant:.3f}" for instant in recording.time]
    table = pd.DataFrame({"time_s": time, **phases}).rename_axis("tick")
    measured = {"angle_rad": recording.angles, "velocity_rad_per_s": result.velocities}
    switches = format_switches_csv(
        result.switches,
        recorded_joints(result),
        lambda side, joint, name: measured[name][side, joint],
        recording.start,
    )
    with staged_directory(target, REPLAY, force=force) as staging:
        write_atomically(staging / PHASES_FILE, table.to_csv(lineterminator="\n"))
        if strides is not None:
            write_atomically(staging / STRIDES_FILE, strides_csv(strides))
            write_parquet(staging / LOG_FILE, angles_log(result))
        write_atomically(staging / SWITCHES_FILE, switches)
        failed = dict[str, str]()
        if pictures:
            drawings = {"replay": partial(replay_figure, result)}
            failed = canvas.write_pictures(drawings, staging / FIGURES_FOLDER).failed
        write_json(staging / SUMMARY_FILE, {**summarise_replay(result), **failed_pictures(failed)})


def recorded_joints(result: Replay) -> list[str]:
    """Return the joints of the table that were recorded."""
    angles, sides = result.recording.angles, result.recording.sides
    return [joint for joint in result.table.joints if all((side, joint) in angles for side in sides)]


def replay_figure(result: Replay) -> Figure:
    """Draw the last seconds of a replay, one column of panels for each leg."""
    recording, joints = result.recording, recorded_joints(result)
    time, names = recording.time[-SHOWN_TICKS:], list(result.table.phase_names)
    names += sorted({str(name) for phases in recording.phases.values() for name in phases} - set(names))
    heights = [JOINT_HEIGHT] * len(joints) + [ROW_HEIGHT] * bool(recording.phases)
    figure = Figure(figsize=(WIDTH, sum(heights) + 2.0), layout="constrained")
    figure.suptitle(f"{Path(recording.source).name} through the gait table {result.table.name}")
    shape = len(heights), len(recording.sides)
    panels = figure.subplots(*shape, sharex=True, sharey="row", squeeze=False, height_ratios=heights)
    lines = list[Artist]()
    for column, side in zip(panels.T, recording.sides, strict=True):
        for axes, joint in zip(column, joints, strict=False):
            canvas.style_panel(axes, "", label_of(f"{joint}_flexion_rad").axis)
            canvas.shade_phases(axes, time, result.phases[side][-SHOWN_TICKS:], names)
            angle = np.degrees(recording.angles[side, joint][-SHOWN_TICKS:])
            lines += axes.plot(time, angle, color=JOINT_COLOURS[JointName(joint)], label=f"{joint} angle")
        causes = {"transform": column[0].get_xaxis_transform(), "rotation": 90, "size": "x-small"}
        for switch in result.switches:
            switch_time = recording.start + switch.time
            if switch.side is side and switch_time >= time[0]:
                column[0].text(switch_time, 1.03, name_to_words(switch.cause), ha="center", **causes)
        if side in recording.phases:
            recorded = [names.index(name) for name in recording.phases[side][-SHOWN_TICKS:]]
            canvas.shade_phases(column[-1], time, np.array(recorded), names)
            column[-1].set_yticks([0.5], ["recorded"])
        column[-1].set_xlabel(f"{side} leg, time [s]")
    canvas.put_legend(figure, lines, canvas.phase_handles(names, np.arange(len(names))))
    return figure
