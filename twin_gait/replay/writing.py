"""What a replay leaves behind: summary, phases, switches and figure in a folder."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from twin_gait.files import finite_or_none, write_atomically
from twin_gait.gait.table import TICK
from twin_gait.replay.agreement import Agreement, agreement, meant_cycles, stride_phases
from twin_gait.replay.figure import joints_of, replay_figure
from twin_gait.replay.machine import Replay
from twin_gait.report.canvas import save
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.runs.record import SUMMARY_FILE, SWITCHES_FILE
from twin_gait.vocabulary import Side

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
        write_atomically(staging / SWITCHES_FILE, switches_csv(result))
        summary = json.dumps(summarise_replay(result), indent=2, ensure_ascii=False, allow_nan=False)
        write_atomically(staging / SUMMARY_FILE, f"{summary}\n")
        if pictures:
            (staging / FIGURE).parent.mkdir()
            save(replay_figure(result), staging / FIGURE)


def _phases_csv(result: Replay) -> str:
    """Phase of each leg at each tick, as CSV text."""
    names = np.array(result.table.phase_names)
    time = result.recording.time
    columns = [names[phases] for phases in result.phases.values()]
    header = ["tick", "time_s", *(f"{side}_phase" for side in result.phases)]
    lines = [",".join(header)]
    lines += [
        f"{tick},{instant:.3f},{','.join(row)}"
        for tick, (instant, row) in enumerate(zip(time, zip(*columns, strict=True), strict=True))
    ]
    return "\n".join(lines) + "\n"


def switches_csv(result: Replay) -> str:
    """Switches with their causes and what was measured then, in the columns of a run's file."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    joints = joints_of(result)
    measured = [f"{joint}_{name}" for joint in joints for name in ("angle_rad", "velocity_rad_per_s")]
    writer.writerow(["tick", "time_s", "side", "from", "to", "cause", *measured])
    for switch in result.switches:
        values = []
        for joint in joints:
            values.append(result.recording.angles[switch.side][joint][switch.tick])
            values.append(result.velocities[switch.side][joint][switch.tick])
        instant = result.recording.start + switch.time
        writer.writerow(
            [switch.tick, f"{instant:.3f}", *switch[1:5], *(repr(float(value)) for value in values)]
        )
    return buffer.getvalue()
