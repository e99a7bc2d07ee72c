"""Blending laws compared: one walk with parameters that step, fade linearly or with minimum jerk."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from twin_gait.experiment import Experiment
from twin_gait.gait.table import TICK, Blending, BlendingLaw
from twin_gait.measures.effort import changes_at_switches
from twin_gait.measures.switching import blend_windows, sums_over, switching_energy, torque_jumps
from twin_gait.parameters import require
from twin_gait.report.blending import TorqueTrace
from twin_gait.report.canvas import readable
from twin_gait.runs.leg_summary import blend_length, switch_ticks
from twin_gait.runs.summary import summarise
from twin_gait.simulation import Run, simulate

DURATIONS = (25, 60, 120)  # [ticks]
# A blend of no length is a step whatever its law, so that one case stands for all of them.
CASES = (
    Blending(law=BlendingLaw.NONE, duration_ticks=0),
    *(
        Blending(law=law, duration_ticks=duration)
        for law in (BlendingLaw.LINEAR, BlendingLaw.MINIMUM_JERK)
        for duration in DURATIONS
    ),
)
TRACE_BEFORE, TRACE_AFTER = 30, 170  # [ticks]

# Column of the comparison by key of the summary of a joint; both sides are averaged, or the larger one taken.
_AVERAGED = {
    "jerk_rms_rad_per_s3": "jerk_rms_rad_per_s3",
    "jerk_dimensionless": "jerk_dimensionless",
    "switch_energy_J": "switch_energy_J",
    "switch_energy_put_in_J": "switch_energy_put_in_J",
    "saturated_share": "saturated_share",
}
_LARGEST = {"torque_jump_Nm": "switch_torque_jump_Nm", "torque_change_Nm": "switch_torque_change_Nm"}

_EFFECTS = ["tick", "side", "from", "to", "joint", "kind", "torque_jump_Nm", "torque_change_Nm", "energy_J"]
_SIGNALS = ("motor_command_torque_Nm", "measured_angle_rad", "stiffness_Nm_per_rad", "equilibrium_rad")


class BlendingComparison(NamedTuple):
    """What a comparison gives back.

    Attributes:
        table: One row per case: law, duration, outcome and stride time,
            then measures of each joint under the names of the summary, torques without ``switch_`` in front.
            Torques are the larger of the two sides, all else is their mean.
        switches: One row per case, switch and joint; see :func:`switch_effects`.
        traces: Commanded torque through the last switch of every kind in every case.
    """

    table: pd.DataFrame
    switches: pd.DataFrame
    traces: tuple[TorqueTrace, ...]

    def telling_switches(self) -> list[str]:
        """Two kinds of switch to look at, as the traces call them.

        The first changes a torque most in the first case, the second gains most in any other over that. There
        may be one, or none if nothing switched.
        """
        if not self.traces:
            return []
        first = self.table.loc[0, ["law", "duration_ms"]]
        is_first = (self.switches[list(first.index)] == first).all(axis=1)
        begins = self.switches[is_first].groupby("kind")["torque_change_Nm"].mean()
        cases = self.switches.groupby(["law", "duration_ms", "kind"])["torque_change_Nm"].mean()
        gains = cases.groupby("kind").max() - begins
        traced = {trace.kind for trace in self.traces}
        return [kind for kind in dict.fromkeys([begins.idxmax(), gains.idxmax()]) if kind in traced]


def with_blending(experiment: Experiment, blending: Blending) -> Experiment:
    """The experiment with another way to blend, all else equal."""
    return replace(experiment, table=replace(experiment.table, blending=blending))


def compare_blending(
    experiment: Experiment,
    cases: Sequence[Blending] = CASES,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> BlendingComparison:
    """Simulate one experiment once for each way to blend.

    Args:
        experiment: What all cases have in common.
        cases: Ways to blend; at least one.
        progress: Called with cases done and in all.

    Returns:
        The comparison.

    Raises:
        ParameterError: If there is no case.
    """
    require(len(cases) > 0, "cases", "at least one way to blend", len(cases))
    rows: list[dict[str, Any]] = []
    effects: list[pd.DataFrame] = []
    traces: list[TorqueTrace] = []
    for number, blending in enumerate(cases, start=1):
        run = simulate(with_blending(experiment, blending))
        case: dict[str, Any] = {
            "law": str(blending.law),
            "duration_ms": round(blending.duration_ticks * TICK * 1e3),
        }
        rows.append({**case, **_row(run)})
        found = switch_effects(run)
        effects.append(found.assign(**case))
        traces += _traces(run, found, case)
        if progress is not None:
            progress(number, len(cases))
    return BlendingComparison(pd.DataFrame(rows), pd.concat(effects, ignore_index=True), tuple(traces))


def switch_effects(run: Run) -> pd.DataFrame:
    """What every switch of a run does to every joint of its leg.

    Args:
        run: The run.

    Returns:
        One row per switch and joint: ``tick``, ``side``, ``from``, ``to``, ``joint``, ``kind`` (these four in
        words), ``torque_jump_Nm`` (largest change of the commanded torque in one tick until the end of the
        blend), ``torque_change_Nm`` (largest change from before the switch) and ``energy_J`` (put into the
        virtual spring until the end of the blend).
    """
    rows: list[tuple[Any, ...]] = []
    for side in run.sides:
        phases = {item.tick: (item.source, item.target) for item in run.switches if item.side is side}
        ticks, length = switch_ticks(run, side), blend_length(run.table.blending)
        windows = blend_windows(ticks, length, len(run.log))
        for joint in run.table.joints:
            signals = [run.log[f"{side}_{joint}_{name}"].to_numpy() for name in _SIGNALS]
            command, energy = signals[0], switching_energy(*signals[1:])
            measures = (
                torque_jumps(command, windows),
                changes_at_switches(command, ticks, length).over_blending,
                sums_over(energy, windows),
            )
            for tick, *values in zip(ticks.tolist(), *measures, strict=True):
                source, target = phases[tick]
                kind = f"{side} {joint}, {readable(source)} to {readable(target)}"
                rows.append((tick, str(side), source, target, str(joint), kind, *values))
    return pd.DataFrame(rows, columns=_EFFECTS)


def _row(run: Run) -> dict[str, Any]:
    summary = summarise(run)
    sides = list(summary["sides"].values())
    row: dict[str, Any] = {
        "outcome": str(run.verdict.outcome),
        "stride_time_s": _over([side.get("stride_time_mean_s") for side in sides], np.mean),
    }
    for joint in run.table.joints:
        joints = [side["joints"][joint] for side in sides]
        row |= {
            f"{joint}_{name}": _over([item[key] for item in joints], np.max) for name, key in _LARGEST.items()
        }
        row |= {
            f"{joint}_{name}": _over([item[key] for item in joints], np.mean)
            for name, key in _AVERAGED.items()
        }
        row[f"{joint}_rmse_deg"] = _over(
            [side.get(f"rmse_{joint}_by_contact_deg") for side in sides], np.mean
        )
    return row


def _over(values: Sequence[float | None], reduce: Callable[[list[float]], Any]) -> float:
    """Mean or maximum of the values that are defined; NaN without any."""
    defined = [value for value in values if value is not None]
    return float(reduce(defined)) if defined else float("nan")


def _traces(run: Run, effects: pd.DataFrame, case: Mapping[str, Any]) -> list[TorqueTrace]:
    """The torque through the last switch of every kind that the record surrounds."""
    surrounded = effects["tick"].between(TRACE_BEFORE, len(run.log) - TRACE_AFTER - 1)
    span = np.arange(-TRACE_BEFORE, TRACE_AFTER + 1)
    traces = []
    for kind, rows in effects[surrounded].groupby("kind"):
        last = rows.iloc[-1]
        command = run.log[f"{last['side']}_{last['joint']}_motor_command_torque_Nm"].to_numpy()
        trace = command[int(last["tick"]) + span]
        traces.append(TorqueTrace(case["law"], case["duration_ms"], str(kind), span * TICK, trace))
    return traces


# ---------------------------------------------------------------------- as text

# Heading, column and format of the printed table; hip and knee share a cell.
_CELLS = (
    ("torque jump in a tick [N m]", "torque_jump_Nm", ".1f"),
    ("torque change over the blend [N m]", "torque_change_Nm", ".0f"),
    ("RMS jerk [rad/s³]", "jerk_rms_rad_per_s3", ".0f"),
    ("dimensionless jerk [10³]", "jerk_dimensionless", ".0f"),
    ("switching energy per stride [J]", "switch_energy_J", ".1f"),
    ("RMSE [°]", "rmse_deg", ".2f"),
    ("saturated [%]", "saturated_share", ".1f"),
)
_SCALES = {"jerk_dimensionless": 1e-3, "saturated_share": 1e2}


def comparison_text(table: pd.DataFrame) -> str:
    """The comparison as a Markdown table; two numbers in a cell are hip and knee.

    Args:
        table: Of a comparison.

    Returns:
        Lines of text.
    """
    heads = ["law", "ms", "outcome", "stride [s]", *(head for head, _, _ in _CELLS)]
    lines = [_line(heads), _line(["---"] * len(heads))]
    for row in table.to_dict("records"):
        cells = [readable(row["law"]), f"{row['duration_ms']}", row["outcome"], f"{row['stride_time_s']:.2f}"]
        for _, column, form in _CELLS:
            scale = _SCALES.get(column, 1.0)
            cells.append(
                " / ".join(f"{scale * row[f'{joint}_{column}']:{form}}" for joint in ("hip", "knee"))
            )
        lines.append(_line(cells))
    return "\n".join(lines)


def switches_text(switches: pd.DataFrame) -> str:
    """Means of what each kind of switch does, as a Markdown table; both sides together.

    Args:
        switches: From :func:`switch_effects`, of one run.

    Returns:
        Lines of text.
    """
    heads = ["switch", "joint", "torque jump in a tick [N m]", "torque change [N m]", "energy [J]"]
    lines = [_line(heads), _line(["---"] * len(heads))]
    measures = ["torque_jump_Nm", "torque_change_Nm", "energy_J"]
    means = switches.groupby(["from", "to", "joint"], sort=False)[measures].mean().reset_index()
    for row in means.to_dict("records"):
        name = f"{readable(row['from'])} to {readable(row['to'])}"
        jump, change, energy = (row[measure] for measure in measures)
        lines.append(_line([name, row["joint"], f"{jump:.1f}", f"{change:.0f}", f"{energy:+.1f}"]))
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
