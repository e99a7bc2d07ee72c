"""What a replay tells and leaves behind in a folder: strides, agreement with recorded phases, a picture."""

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import blended_transform_factory

from twin_gait.files import finite_or_none, write_atomically, write_json
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.phases import entry_lags, phase_entries, phase_spells
from twin_gait.palette import BLACK, JOINT_COLOURS
from twin_gait.replay.machine import Replay, assumed_signals
from twin_gait.report import canvas
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.runs.record import SUMMARY_FILE, SWITCHES_FILE, switches_csv
from twin_gait.vocabulary import JointName, Side


class Agreement(NamedTuple):
    """Replayed against recorded phases of one leg."""

    # ticks in each pair of phases: rows are recorded ones, those of the table first, then further names of
    # the log; columns are replayed ones
    confusion: pd.DataFrame
    # for each phase of the table, the time in [s] by which the replay enters it later than the record, for
    # every recorded entry; NaN for one that the replay has no partner for
    lags: dict[str, np.ndarray]

    @property
    def equal_share(self) -> float:
        """Share of the ticks with equal phases."""
        ticks = self.confusion.to_numpy()
        return float(np.trace(ticks) / ticks.sum())

    def phase_share(self, phase: str) -> float:
        """Share of the ticks recorded in a phase that the replay spends in it too.

        Returned in [0, 1]; NaN if it was not recorded.
        """
        row = self.confusion.loc[phase].to_dict()
        total = sum(row.values())
        return row[phase] / total if total else float("nan")


def agreement(result: Replay) -> dict[Side, Agreement]:
    """Compare replayed with recorded phases.

    Returns one comparison for each leg whose phases were recorded.
    """
    names = result.table.phase_names
    return {
        side: _compare(result.phases[side], recorded, names)
        for side, recorded in result.recording.phases.items()
    }


def _compare(replayed: np.ndarray, recorded: np.ndarray, names: tuple[str, ...]) -> Agreement:
    further = sorted(set(recorded.tolist()) - set(names))
    rows = (*names, *further)
    codes = pd.Index(rows).get_indexer(recorded)
    counts = pd.crosstab(recorded, np.array(names)[replayed])
    lags = {
        # entry_lags counts a phase that begins before the event as positive; a late replay is positive here.
        name: 0.0 - entry_lags(_entries(replayed, index), _entries(codes, index), TICK)
        for index, name in enumerate(names)
    }
    return Agreement(counts.reindex(index=rows, columns=names, fill_value=0), lags)


def _entries(phases: np.ndarray, phase: int) -> np.ndarray:
    """Entries into a phase, without the stay that the record begins with."""
    entries = phase_entries(phases, phase)
    return entries[entries > 0]


class StridePhases(NamedTuple):
    """Phases of one stride, from an entry into the first phase of the table to the next."""

    start: int  # first tick
    end: int  # first tick of the next stride
    phases: tuple[int, ...]  # indices of the phases in order

    @property
    def duration(self) -> float:
        """In [s]."""
        return (self.end - self.start) * TICK


def meant_cycles(table: GaitTable) -> set[tuple[int, ...]]:
    """Orders of phases that a stride may have."""
    if not table.cycles:
        return {tuple(range(len(table.phases)))}
    cycles = [tuple(map(table.phase_index, cycle)) for cycle in table.cycles]
    return {cycle[cycle.index(0) :] + cycle[: cycle.index(0)] for cycle in cycles if 0 in cycle}


def stride_phases(phases: np.ndarray) -> list[StridePhases]:
    """Split a leg's phases into strides. ``phases``: index of the phase at each tick, shape ``(n,)``."""
    spells = phase_spells(phases)
    return [
        StridePhases(int(start), int(end), tuple(item.phase for item in spells if start <= item.start < end))
        for start, end in pairwise(_entries(phases, 0))
    ]


PHASES_FILE = "phases.csv"
REPLAY = FolderKind("a replay", PHASES_FILE)
FIGURE = "figures/replay.png"


def summarise_replay(result: Replay) -> dict[str, Any]:
    """Results of a replay as plain numbers.

    Returned by leg: strides and how many pass through a whole cycle of the table, switches by cause, and the
    agreement with recorded phases where there are some.
    """
    compared, names = agreement(result), result.table.phase_names
    return {
        "log": result.recording.source,
        "table": result.table.name,
        "duration_s": result.recording.n_ticks * TICK,
        "assumed_signals": assumed_signals(result.recording, result.table),
        "cycles": [[names[index] for index in cycle] for cycle in sorted(meant_cycles(result.table))],
        "sides": {
            str(side): {
                **_strides(result, side),
                "switches": _switches(result, side),
                "agreement": _agreement(compared[side]) if side in compared else None,
            }
            for side in result.recording.sides
        },
    }


def _strides(result: Replay, side: Side) -> dict[str, Any]:
    strides = stride_phases(result.phases[side])
    cycles = meant_cycles(result.table)
    durations = np.array([item.duration for item in strides])
    return {
        "strides": len(strides),
        "strides_with_the_whole_cycle": sum(item.phases in cycles for item in strides),
        "stride_time_mean_s": float(durations.mean()) if len(strides) else None,
    }


def _switches(result: Replay, side: Side) -> list[dict[str, Any]]:
    """Switches of a leg counted by transition: into postures, then in the order of the table."""
    own = (item for item in result.switches if item.side is side)
    counts = Counter((item.transition, item.source, item.target, item.cause) for item in own)
    return [
        {"from": source, "to": target, "cause": cause, "count": count}
        for (_, source, target, cause), count in sorted(counts.items())
    ]


def _agreement(compared: Agreement) -> dict[str, Any]:
    return {
        "equal_share": compared.equal_share,
        "phase_share": {name: finite_or_none(compared.phase_share(name)) for name in compared.lags},
        "confusion_ticks": compared.confusion.to_dict("index"),
        "entry_lags_s": {
            name: [finite_or_none(lag) for lag in lags.tolist()] for name, lags in compared.lags.items()
        },
    }


def write_replay(result: Replay, target: Path, *, force: bool = False, pictures: bool = True) -> None:
    """Write phases, switches, summary and figure into a folder that appears when all is written.

    ``force``: whether the folder of an earlier replay may be replaced; ``pictures``: whether to draw the
    figure. Raises RunDirectoryError if it exists, or cannot be written.
    """
    with staged_directory(target, REPLAY, force=force) as staging:
        write_atomically(staging / PHASES_FILE, _phases_csv(result))
        write_atomically(staging / SWITCHES_FILE, replayed_switches_csv(result))
        write_json(staging / SUMMARY_FILE, summarise_replay(result))
        if pictures:
            (staging / FIGURE).parent.mkdir()
            canvas.save(replay_figure(result), staging / FIGURE)


def _phases_csv(result: Replay) -> str:
    """Phase of each leg at each tick, as CSV text."""
    names = np.array(result.table.phase_names)
    phases = {f"{side}_phase": names[phases] for side, phases in result.phases.items()}
    time = [f"{instant:.3f}" for instant in result.recording.time]
    table = pd.DataFrame({"time_s": time, **phases}).rename_axis("tick")
    return table.to_csv(lineterminator="\n")


def replayed_switches_csv(result: Replay) -> str:
    """Switches with their causes and what was measured then, in the columns of a run's file."""
    measured = {"angle_rad": result.recording.angles, "velocity_rad_per_s": result.velocities}
    return switches_csv(
        result.switches,
        joints_of(result),
        lambda side, joint, name: measured[name][side][joint],
        result.recording.start,
    )


SHOWN_TICKS = 6000
WIDTH, JOINT_HEIGHT, BAND_HEIGHT = 12.0, 1.9, 0.33  # [inches]
LETTER, LABEL_MARGIN = 4.2, 14.0  # [points] that a letter of a cause and its line take above the first panel
CLOSE = 0.012  # switches nearer than this share of the width share one place for their labels


def joints_of(result: Replay) -> list[str]:
    """Joints of the table that were recorded."""
    legs = result.recording.angles.values()
    return [joint for joint in result.table.joints if all(joint in angles for angles in legs)]


def replay_figure(result: Replay) -> Figure:
    """Draw the last seconds of a replay, one column of panels for each leg."""
    recording, joints = result.recording, joints_of(result)
    time = recording.time[-SHOWN_TICKS:]
    names = list(result.table.phase_names)
    names += sorted({str(name) for phases in recording.phases.values() for name in phases} - set(names))
    strips = {side: _strips(result, side, names) for side in recording.sides}
    heights = [JOINT_HEIGHT] * len(joints) + [BAND_HEIGHT * max(map(len, strips.values())) + 0.25]
    figure = Figure(figsize=(WIDTH, sum(heights) + 2.1), layout="constrained")
    figure.suptitle(
        f"{Path(recording.source).name} through the gait table {result.table.name}", fontsize="large"
    )
    panels = figure.subplots(
        len(heights), len(strips), sharex=True, sharey="row", squeeze=False, height_ratios=heights
    )
    longest = max((len(item.cause) for item in result.switches), default=0)
    first = recording.n_ticks - len(time)
    lines: list[Artist] = []
    for column, side in enumerate(recording.sides):
        mine = [item for item in result.switches if item.side is side and item.tick >= first]
        switches = [(float(time[item.tick - first]), item.cause) for item in mine]
        for axes, joint in zip(panels[:-1, column], joints, strict=True):
            canvas.shade_phases(axes, time, strips[side][0][1], names)
            for instant, _ in switches:
                axes.axvline(instant, color="0.45", linewidth=0.7, linestyle=(0, (2, 2)))
            angle = np.degrees(recording.angles[side][joint][first:])
            colour = JOINT_COLOURS[JointName(joint)] if joint in set(JointName) else BLACK
            lines += axes.plot(time, angle, color=colour, label=f"{joint} angle")
            canvas.style_panel(axes, "", canvas.flexion(joint) if column == 0 else "")
        _draw_strips(panels[-1, column], time, strips[side], names)
        _label_causes(panels[0, column], switches, float(time[-1] - time[0]))
        panels[0, column].set_title(f"{side} leg", pad=LABEL_MARGIN + LETTER * longest)
        panels[-1, column].set_xlabel("time [s]")
    occurring = np.concatenate([phases for rows in strips.values() for _, phases in rows])
    canvas.put_legend(figure, lines, canvas.phase_handles(names, occurring))
    return figure


def _strips(result: Replay, side: Side, names: Sequence[str]) -> list[tuple[str, np.ndarray]]:
    """Indices of the replayed and, if there are some, the recorded phases."""
    strips = [("replayed", result.phases[side][-SHOWN_TICKS:])]
    if side in result.recording.phases:
        recorded = result.recording.phases[side].tolist()[-SHOWN_TICKS:]
        strips.append(("recorded", np.array([names.index(name) for name in recorded])))
    return strips


def _draw_strips(
    axes: Axes, time: np.ndarray, strips: Sequence[tuple[str, np.ndarray]], names: Sequence[str]
) -> None:
    canvas.draw_phase_bars(axes, time, strips, names, height=0.8, linewidth=0)
    axes.set_ylim(0.5 - len(strips), 0.5)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)


def _label_causes(axes: Axes, switches: Sequence[tuple[float, str]], span: float) -> None:
    """Write the causes upright above the first panel; close ones are pushed apart."""
    transform = blended_transform_factory(axes.transData, axes.transAxes)
    last = -np.inf
    for instant, cause in switches:
        last = max(instant, last + 2.0 * CLOSE * span)
        axes.annotate(
            canvas.readable(cause),
            xy=(instant, 1.0),
            xytext=(last, 1.06),
            xycoords=transform,
            textcoords=transform,
            rotation=90,
            fontsize="x-small",
            ha="center",
            va="bottom",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 0},
        )
