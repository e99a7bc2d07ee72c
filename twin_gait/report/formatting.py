"""Texts about a run for people: its wearer, and a table of the walk."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from twin_gait.configuration.identity import identify_parts, identify_wearer
from twin_gait.experiment.experiment import Experiment
from twin_gait.labels import label_of
from twin_gait.measures.load_shape import TWO_PEAKS
from twin_gait.measures.strides import describe_stride_count


def describe_wearer(experiment: Experiment) -> list[str]:
    """Describe the wearer and the walk: belt speed between its ramps, and body-weight support."""
    patient, walking, wearer = experiment.patient, experiment.scenario.walking, ["no wearer"]
    if patient is not None:
        name, size = identify_wearer(patient).label, f"{patient.mass:g} kg, {patient.height:.2f} m"
        wearer = [f"{name}, {size}" if name else size]
    walk = []
    if walking is not None and walking.belt.cruise:
        walk.append(f"{3.6 * walking.belt.cruise:.2f} km/h")
    if walking is not None and walking.support_share:
        walk.append(f"{100.0 * walking.support_share:.0f} % of the weight supported")
    return wearer + [", ".join(walk)] * bool(walk)


def describe(experiment: Experiment) -> list[str]:
    """Describe in short texts the properties that distinguish two runs: wearer, walk and device."""
    parts = identify_parts(experiment)
    named = [f"{key} {parts[key].label}" for key in ("table", "device", "controller")]
    return [*describe_wearer(experiment), *named]


DASH = "–"


def amount(value: float | None, unit: str = "") -> str:
    """Format a number with its unit and about three significant digits; a dash for None."""
    if value is None:
        return DASH
    decimals = sum(abs(value) < bound for bound in (1.0, 10.0, 100.0))
    return f"{round(value, decimals) + 0.0:.{decimals}f} {unit}".strip().replace("-", "−")


def walk_table(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return a table of the measures of the legs and of healthy walking, by their names in the summary.

    ``summary``: summary of a run; those of earlier versions lack such measures. Returns a head and a row for
    each measure, with its label and in its display unit; empty without strides on a belt. A leg without a
    measure, such as the power of own muscles in a leg that is driven whole, has a dash.
    """
    legs = {side: leg for side, leg in summary["sides"].items() if leg.get("walk") and leg["strides_counted"]}
    if not legs:
        return []
    healthy = summary["walk_reference"]
    found = [_measures(leg) for leg in legs.values()]
    rows = [("", *legs, "healthy")]
    for name in dict.fromkeys(name for measures in found for name in measures):
        values = [measures.get(name) for measures in found]
        if any(value is not None for value in values):
            label = label_of(name)
            reference = amount(label.convert(healthy[name])) if name in healthy else ""
            rows.append((label.title, *map(amount, map(label.convert, values)), reference))
    return rows


def _measures(leg: Mapping[str, Any]) -> dict[str, float | None]:
    both = leg.get("double_support_share")
    found = {"stride_time_s": leg["stride_time_mean_s"], "double_support_share": both, **leg["walk"]}
    for joint, parts in leg.get("errors", {}).items():
        found |= {f"{joint}_error_{part}": value for part, value in parts.items()}
    return found


def belt_carries_note(summary: Mapping[str, Any]) -> str:
    """Return a sentence if the belt drives the walk; otherwise an empty string."""
    power = summary.get("power")
    if not power or not power["belt_driven"]:
        return ""
    force = amount(power["guide_force_N"], "N")
    return f"The belt drives this walk: it drags the feet backwards against {force} at the pelvis."


def extrapolation_note(summary: Mapping[str, Any]) -> str:
    """Return sentences if wearer or walk are outside of the range of the model; otherwise an empty string.

    ``summary``: summary of a run; those of earlier versions lack the notes.
    """
    return str((summary.get("patient") or {}).get("notes", ""))


def unstable_step_note(summary: Mapping[str, Any]) -> str:
    """Return a sentence if the energy balance shows that the step was too large; otherwise an empty string.

    ``summary``: summary of a run; those of earlier versions lack the step.
    """
    if summary.get("step_stable") is not False:
        return ""
    residual, step = 100.0 * summary["energy_residual_share"], 1e3 * summary["step_s"]
    return (
        f"The energy balance of this run is open by {residual:.2g} %: the step of {step:g} ms is too large "
        f"for it, and its results may be wrong. Repeat it with --set integration.step_ms={step / 2:g}."
    )


def missing_peaks(summary: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each leg whose load has no loading peak, trough and push-off peak."""
    patterns = {side: leg.get("load_pattern", TWO_PEAKS) for side, leg in summary["sides"].items()}
    return [
        f"The load of the {side} foot has no loading and push-off peak with a trough between them: {pattern}."
        for side, pattern in patterns.items()
        if pattern != TWO_PEAKS and summary["sides"][side]["strides_counted"]
    ]


def describe_strides(leg: Mapping[str, Any]) -> str:
    """Describe the strides of a leg in a summary: time, swing, double support; by phases without ground."""
    by = "_by_phase" if leg["strides"] is None else ""
    counted = leg[f"strides{by}_counted"]
    counted_by = "no ground contact, strides counted from the phases: " if by else ""
    text = counted_by + describe_stride_count(counted, leg[f"strides{by}"])
    if counted:
        text += f" of {leg[f'stride_time{by}_mean_s']:.2f} s"
    if leg.get("swing_share") is not None:
        text += f", swing {100.0 * leg['swing_share']:.0f} %"
    if leg.get("double_support_share") is not None:
        text += f", double support {100.0 * leg['double_support_share']:.0f} %"
    return text


def format_table(table: Sequence[Sequence[str]]) -> Iterator[str]:
    """Return a table as lines of text, with the numbers aligned to the right."""
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))] if table else []
    for row in table:
        cells = [text.rjust(width) for text, width in zip(row[1:], widths[1:], strict=True)]
        yield "  ".join([row[0].ljust(widths[0]), *cells]).rstrip()
