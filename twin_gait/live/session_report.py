"""Report of a live session on one printed page, compared with the last session of the same patient."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from twin_gait.configuration.events import changed_keys
from twin_gait.configuration.experiments import experiment_from_mapping
from twin_gait.configuration.identity import identify_parts
from twin_gait.control.safety import TripCause
from twin_gait.experiment.events import Push
from twin_gait.files import finite_or_none
from twin_gait.gait.table import TICK
from twin_gait.labels import label_of
from twin_gait.leg_model.anthropometry import wearer_notes
from twin_gait.live.controls import EVERYTHING, ControlPanel
from twin_gait.live.protocol import Control
from twin_gait.live.session_strides import WORK_SHARE
from twin_gait.live.session_walks import SessionWalks, find_previous, read_walks_of
from twin_gait.measures.outcome import EventKind
from twin_gait.measures.strides import normalise_strides
from twin_gait.report.formatting import DASH, amount, describe_wearer
from twin_gait.report.pages import render
from twin_gait.report.reference import reference_cycle, reference_notes
from twin_gait.report.session_figures import Curves, Mark, draw_course, draw_cycles
from twin_gait.simulation.settings import first_settings
from twin_gait.vocabulary import JointName, Side

MOST_CHANGES, MOST_CONDITIONS = 10, 5  # rows and columns for which one page is large enough
MOST_NAMES = 4  # parameters that a sentence lists
COURSE = ("stride_time_s", "knee_error_total_deg", WORK_SHARE)  # measures in the picture over time


def session_report(records: Path, session: int) -> str:
    """Return the report of a session as one self-contained page.

    ``records``: folder of the record; ``session``: number of the session. Raises the errors of
    :func:`read_walks_of`.
    """
    walks = read_walks_of(records, session)
    previous = find_previous(records, walks)
    record, changes = walks.record, list(_changes(walks))
    shown, omitted = _shown_conditions(walks)
    columns, rows = _stride_table(walks, shown, previous)
    content = {
        "title": f"Session of {record['patient'] or 'a wearer without a name'}",
        "subtitle": " · ".join(filter(None, (_date(record["began"]), record["user"], f"session {session}"))),
        "number": session,
        "facts": _facts(walks),
        "changes": changes[:MOST_CHANGES],
        "more_changes": max(len(changes) - MOST_CHANGES, 0),
        "columns": columns,
        "rows": rows,
        "omitted": omitted,
        "comparison": _comparison(walks, previous),
        "events": list(_events(walks)),
        "notes": _notes(walks),
        "cycles": _cycles_picture(walks, shown),
        "course": _course_picture(walks),
    }
    return render("session_report.html", content)


# ---------------------------------------------------------------------- parts of the page


def _date(began: str) -> str:
    """Return a time of the record as local date and time."""
    return f"{datetime.fromisoformat(began).astimezone():%-d %B %Y, %H:%M}"


def _facts(walks: SessionWalks) -> dict[str, str]:
    """Return person, walk, device, table and controller at the start, and the outcome of the walks."""
    record, experiment = walks.record, walks.runs[0].experiment
    patient, parts = experiment.patient, identify_parts(experiment)
    who = [record["patient"] or "no name"]
    if patient is not None:
        age = [] if patient.age is None else [f"{patient.age:g} years"]
        who += [f"{patient.mass:g} kg", f"{patient.height:.2f} m", str(patient.sex), *age]
    ended = record["ended"] and f" to {_date(record['ended']).rpartition(', ')[2]}"
    outcomes = ", ".join(str(run.verdict.outcome or run.status) for run in walks.runs)
    return {
        "Patient": ", ".join(who),
        "Time": f"{_date(record['began'])}{ended or ', still running'}",
        "Walk": "; ".join(describe_wearer(experiment)[1:]) or DASH,
        "Result": f"{walks.starts[-1]:.0f} s in {_plural(len(walks.runs), 'walk')}: {outcomes}",
        "Gait table": parts["table"].label,
        "Device": f"{parts['device'].label}, controller {parts['controller'].label}",
    }


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")


def _changes(walks: SessionWalks) -> Iterator[dict[str, str]]:
    """Yield a row for each changed parameter: condition, time, parameter, values before and after, user."""
    document = dict(walks.record["document"])
    panel = ControlPanel(experiment_from_mapping(document, "experiment", Path()))
    controls, walk = {item.name: item for item in panel.controls(panel.preset)}, 0
    for entry in walks.record["log"]:
        if entry["response"] != "applied":
            continue
        walk += entry["subject"] == "restart"
        control = controls.get(entry["subject"])
        if control is None and entry["subject"] != EVERYTHING:
            continue
        yield {
            "condition": _condition_at(walks, walk, entry["tick"]),
            "time": _time(walks, walk, entry["tick"] * TICK),
            "parameter": "all parameters" if control is None else _full_name(control),
            "before": "" if control is None else _shown(entry["before"], control),
            "after": "as at the start" if control is None else _shown(entry["value"], control),
            "by": entry["user"],
        }


def _condition_at(walks: SessionWalks, walk: int, tick: int) -> str:
    begun = [at for at, (one, item) in enumerate(walks.conditions) if one == walk and item.start <= tick]
    return str(begun[-1] + 1) if begun else ""


def _time(walks: SessionWalks, walk: int, seconds: float) -> str:
    """Return a time of a walk, with the number of the walk if there are several."""
    return f"walk {walk + 1}, {seconds:.1f} s" if len(walks.runs) > 1 else f"{seconds:.1f} s"


def _full_name(control: Control) -> str:
    place = " ".join(filter(None, (control.phase, control.side, control.joint))).replace("_", " ")
    return f"{place}: {control.label}" if place else control.label


def _shown(value: Any, control: Control) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return amount(value, control.unit) if isinstance(value, int | float) else str(value).replace("_", " ")


def _shown_conditions(walks: SessionWalks) -> tuple[list[int], int]:
    """Return the numbers of the conditions that the page shows, and the number of those left out."""
    counted = sorted(walks.settled["condition"].unique().tolist())
    if len(counted) <= MOST_CONDITIONS:
        return counted, 0
    return [counted[0], *counted[1 - MOST_CONDITIONS :]], len(counted) - MOST_CONDITIONS


def _stride_table(
    walks: SessionWalks, shown: Sequence[int], previous: SessionWalks | None
) -> tuple[list[tuple[str, str]], list[list[str]]]:
    """Return heads of two lines and rows of the table of strides, with the last session at the end."""
    heads = []
    for number in shown:
        walk, item = walks.conditions[number - 1]
        span = _time(walks, walk, item.start * TICK).removesuffix(" s")
        heads.append((f"condition {number}", f"{span}–{item.end * TICK:.1f} s"))
    last = None if previous is None or not shown else max(previous.settled["condition"])
    if previous is not None and last is not None:
        heads += [("last session", f"condition {last}"), ("difference", "to the last")]
    rows = []
    sides = list(dict.fromkeys(walks.strides["side"]))
    for key, side in itertools.product(walks.keys, sides):
        found = [walks.cell(number, side, key) for number in shown]
        if not any(count for _, _, count in found):
            continue
        cells = [_mean_and_deviation(*item) for item in found]
        if previous is not None and last is not None:
            before = previous.cell(last, side, key)
            change = amount(finite_or_none(found[-1][0] - before[0]))
            cells += [
                _mean_and_deviation(*before),
                change if change[:1] in "−–" else f"+{change}",
            ]
        rows.append([f"{label_of(key).title}, {side}", *cells])
    counts = [[str(walks.cell(number, side, walks.keys[0])[2]) for number in shown] for side in sides]
    if rows:
        empty = [""] * (len(heads) - len(shown))
        rows.insert(
            0, [f"strides, {' and '.join(sides)}", *map(" and ".join, zip(*counts, strict=True)), *empty]
        )
    return heads, rows


def _mean_and_deviation(mean: float, deviation: float, count: int) -> str:
    """Return mean and standard deviation, with one more digit if that is small; a dash without strides."""
    text = amount(finite_or_none(mean))
    if count < 2:
        return text
    decimals = len(text.partition(".")[2])
    decimals += deviation < 0.5 * 10.0**-decimals
    return f"{mean:.{decimals}f} ± {deviation:.{decimals}f}".replace("-", "−")


def _comparison(walks: SessionWalks, previous: SessionWalks | None) -> str:
    """Compare the settings at the start with those at the end of the last session."""
    if previous is None:
        return "The record has no earlier session of this patient."
    record = previous.record
    last = f"The last session is number {record['id']} of {_date(record['began'])}."
    before, now = (
        first_settings(item.experiment) for item in (previous.conditions[-1][1], walks.conditions[0][1])
    )
    keys = [key for key in changed_keys(before, now) if not key.startswith("monitor.")]
    if not keys:
        return f"{last} This session began with the settings at its end."
    names = ", ".join(label_of(key).name for key in keys[:MOST_NAMES])
    more = f" and {len(keys) - MOST_NAMES} more" if len(keys) > MOST_NAMES else ""
    return f"{last} This session began with other settings than those at its end: {names}{more}."


def _events(walks: SessionWalks) -> Iterator[str]:
    """Yield faults, trips, falls and pushes with their times, and the number of rejected changes."""
    for walk, run in enumerate(walks.runs):
        stopped = run.trip is not None and run.trip.cause is TripCause.OPERATOR
        found = [
            (event.time, "emergency stop" if stopped and event.kind is EventKind.TRIP else event.text)
            for event in run.events
        ]
        pushes = (event for event in run.experiment.events if isinstance(event, Push))
        found += [(event.tick * TICK, f"push of {event.torque:g} N·m on {event.joint}") for event in pushes]
        for time, text in sorted(found):
            yield f"{_time(walks, walk, time)}: {text.replace('_', ' ')}"
    if refusals := walks.record["refusals"]:
        yield f"{_plural(refusals, 'request')} rejected"


def _notes(walks: SessionWalks) -> list[str]:
    """Return a sentence for each range of the model that a condition is outside of."""
    experiments = [item.experiment for _, item in walks.conditions]
    notes = [note for experiment in experiments for note in reference_notes(experiment)]
    first = experiments[0]
    if first.patient is not None:
        notes = [*wearer_notes(first.patient, first.leg.heaviest_wearer), *notes]
    return list(dict.fromkeys(notes))


def _cycles_picture(walks: SessionWalks, shown: Sequence[int]) -> bytes | None:
    """Draw the gait cycle of the first and the last condition; None without strides of every leg."""
    curves = {str(number): _curves(walks, number) for number in dict.fromkeys((*shown[:1], *shown[-1:]))}
    if not curves or any(len(cycles) == 0 for item in curves.values() for cycles in item.values()):
        return None
    experiment = walks.conditions[shown[-1] - 1][1].experiment
    joints = dict.fromkeys(joint for _, joint in next(iter(curves.values())))
    healthy = {joint: reference_cycle(experiment, joint) for joint in joints}
    return draw_cycles(curves, {joint: angle for joint, angle in healthy.items() if angle is not None})


def _curves(walks: SessionWalks, number: int) -> Curves:
    """Return the angles of the settled strides of a condition by leg and joint."""
    run, found = walks.runs[walks.conditions[number - 1][0]], dict[tuple[Side, JointName], np.ndarray]()
    for record in run.leg_records():
        chosen = walks.settled["condition"].eq(number) & walks.settled["side"].eq(str(record.side))
        rows = walks.settled[chosen]
        ends = rows["start_s"] + rows["stride_time_s"]
        bounds = np.rint(np.column_stack((rows["start_s"], ends)) / TICK).astype(int)
        for joint, angles in record.angles.items():
            found[record.side, joint] = normalise_strides(angles, bounds)
    return found


def _course_picture(walks: SessionWalks) -> bytes | None:
    """Draw some measures over the time of the session; None without strides."""
    keys = [key for key in COURSE if key in walks.keys and walks.strides[key].notna().any()]
    if not keys:
        return None
    marks = [
        Mark(float(walks.starts[walk]) + item.start * TICK, str(number), item.start == 0)
        for number, (walk, item) in enumerate(walks.conditions, start=1)
    ]
    return draw_course(walks.strides, keys, marks[1:], float(walks.starts[-1]))
