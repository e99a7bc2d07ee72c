"""What a replay tells, strides and agreement with recorded phases, and what it leaves behind in a folder."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from twin_gait.files import finite_or_none, write_atomically, write_json
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.phases import entry_lags, phase_entries, phase_spells
from twin_gait.replay.figure import joints_of, replay_figure
from twin_gait.replay.machine import Replay, assumed_signals
from twin_gait.report.canvas import save
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.runs.record import SUMMARY_FILE, SWITCHES_FILE, switches_csv
from twin_gait.vocabulary import Side


class Agreement(NamedTuple):
    """Replayed against recorded phases of one leg."""

    recorded: tuple[str, ...]  # names of the rows: the phases of the table, then further names of the log
    replayed: tuple[str, ...]  # names of the columns: the phases of the table
    confusion: np.ndarray  # ticks in each pair of phases, shape ``(n_recorded, n_replayed)``, integers
    # for each phase of the table, the time in [s] by which the replay enters it later than the record, for
    # every recorded entry; NaN for one that the replay has no partner for
    lags: dict[str, np.ndarray]

    @property
    def equal_share(self) -> float:
        """Share of the ticks with equal phases."""
        return float(np.trace(self.confusion) / self.confusion.sum())

    def phase_share(self, phase: str) -> float:
        """Share of the ticks recorded in a phase that the replay spends in it too.

        Returned in [0, 1]; NaN if it was not recorded.
        """
        index = self.recorded.index(phase)
        total = self.confusion[index].sum()
        return float(self.confusion[index, index] / total) if total else float("nan")


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
    confusion = np.zeros((len(rows), len(names)), dtype=int)
    np.add.at(confusion, (codes, replayed), 1)
    lags = {
        # entry_lags counts a phase that begins before the event as positive; a late replay is positive here.
        name: -entry_lags(_entries(replayed, index), _entries(codes, index), TICK)
        for index, name in enumerate(names)
    }
    return Agreement(rows, names, confusion, lags)


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
    entries = phase_entries(phases, 0)
    entries = entries[entries > 0]
    spells = phase_spells(phases)
    return [
        StridePhases(int(start), int(end), tuple(item.phase for item in spells if start <= item.start < end))
        for start, end in pairwise(entries)
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
    """Switches of a leg counted by transition, in the order of the table."""
    counts = Counter(switch.transition for switch in result.switches if switch.side is side)
    return [
        {"from": item.source, "to": item.target, "cause": item.cause, "count": counts[index]}
        for index, item in enumerate(result.table.transitions)
        if counts[index]
    ]


def _agreement(compared: Agreement) -> dict[str, Any]:
    return {
        "equal_share": compared.equal_share,
        "phase_share": {name: finite_or_none(compared.phase_share(name)) for name in compared.replayed},
        "confusion_ticks": {
            name: dict(zip(compared.replayed, row.tolist(), strict=True))
            for name, row in zip(compared.recorded, compared.confusion, strict=True)
        },
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
            save(replay_figure(result), staging / FIGURE)


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
