"""Walks from standing to standing, and their endings."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from twin_gait import Experiment, Run, RunStatus, load_experiment

PRESET = "treadmill_start_stop"
MASSES, HEIGHTS = (55.0, 65.0, 75.0, 85.0, 95.0), (1.60, 1.70, 1.80, 1.90)
WALKING = 7.0  # [s] between the two commands, at least
STRIDE = 2.08  # [s], about that of its walk: the moments are spread over it, no more depends on it
STANDING = 4.0  # [s] that a wearer has to come to rest
LEAST_FORCE = 50.0  # [N] under either foot
MANY, FEW = 10, 5  # moments of the stride
STANDS, FALLS, OTHERWISE = "stand", "fall or trip", "not on both feet"


class Row(NamedTuple):
    """One line of the table.

    Attributes:
        subject: Changed property.
        values: Printed values.
        settings: Settings of each value, see ``--set``.
        moments: Number of times of the command to stand for each value.
    """

    subject: str
    values: str
    settings: tuple[tuple[str, ...], ...]
    moments: int


class Trial(NamedTuple):
    """Walk from standing to standing: changed settings, and time of the command to stand in [s]."""

    settings: tuple[str, ...]
    stop: float


def _each(key: str, values: Iterable[float]) -> tuple[tuple[str, ...], ...]:
    return tuple((f"{key}={value:g}",) for value in values)


def _row(subject: str, key: str, values: Sequence[float], unit: str = "") -> Row:
    return Row(subject, ", ".join(f"{value:g}" for value in values) + unit, _each(key, values), FEW)


def _effort(share: float) -> tuple[str, ...]:
    joint = f"{{passive: 1, effort: {share:g}}}"
    return (f"patient.both={{hip: {joint}, knee: {joint}}}",)


_SIZES = tuple(
    (f"patient.mass_kg={mass:g}", f"patient.height_m={height:g}")
    for mass, height in itertools.product(MASSES, HEIGHTS)
)
_FRICTIONS = tuple(
    (f"plant.friction_ratio={{hip: {ratio:g}, knee: {ratio:g}}}",) for ratio in (0.3, 0.8, 1.0)
)
ROWS = (
    Row("default wearer (70 kg, 1.75 m)", "", ((),), MANY),
    Row(
        "lightest and heaviest, shortest and tallest",
        "55 and 95 kg, 1.60 and 1.90 m",
        _each("patient.mass_kg", (MASSES[0], MASSES[-1]))
        + _each("patient.height_m", (HEIGHTS[0], HEIGHTS[-1])),
        MANY,
    ),
    Row("mass and height", "55, 65, 75, 85, 95 kg by 1.60, 1.70, 1.80, 1.90 m", _SIZES, FEW),
    Row("right leg leading", "", (("scenario.leading=right",),), MANY),
    Row(
        "wearer's own effort and passive moments",
        "effort 0.5 and 1.0 at hip and knee",
        (_effort(0.5), _effort(1.0)),
        FEW,
    ),
    _row("belt speed", "scenario.belt_speed_km_per_h", (0.8, 0.9, 1.0, 1.2, 1.6, 1.8), " km/h"),
    _row("ramp", "scenario.belt.ramp_s", (0.4, 0.6, 1.2, 1.5, 1.75), " s"),
    _row("ramp", "scenario.belt.ramp_s", (2.0,), " s"),
    _row("delay of the belt", "scenario.belt.delay_s", (0.0, 0.1, 0.3, 0.4), " s"),
    _row("delay of the belt", "scenario.belt.delay_s", (0.6,), " s"),
    _row("share of the weight supported", "scenario.support.share", (0.4, 0.5, 0.7)),
    _row("share of the weight supported", "scenario.support.share", (0.3,)),
    Row("friction of the joints over the model", "0.3, 0.8, 1.0", _FRICTIONS, FEW),
)


def trials_of(row: Row) -> list[Trial]:
    """Return all walks of a row, with the times of each value in sequence."""
    start = load_experiment(PRESET).experiment.scenario.belt.start
    stops = [start + WALKING + STRIDE * number / row.moments for number in range(row.moments)]
    return [Trial(settings, stop) for settings in row.settings for stop in stops]


def walk_of(trial: Trial) -> Experiment:
    """Return the experiment of a trial: walking, and standing again."""
    times = f"scenario.belt.stop_s={trial.stop}", f"duration_s={trial.stop + STANDING}"
    return load_experiment(PRESET, [*trial.settings, *times]).experiment


def ending_of(run: Run) -> str:
    """Return the ending of a run from standing to standing: ``STANDS``, ``FALLS`` or ``OTHERWISE``."""
    if run.status is not RunStatus.COMPLETED or run.trip is not None:
        return FALLS
    last = run.log.iloc[-1]
    both = all(
        last[f"{side}_phase"] == "stand" and last[f"{side}_foot_normal_force_N"] > LEAST_FORCE
        for side in run.sides
    )
    return STANDS if both else OTHERWISE


def line_of(row: Row, endings: Sequence[str]) -> dict[str, str]:
    """Return one line of the table from the endings of :func:`trials_of` in their order."""
    groups = [endings[at : at + row.moments] for at in range(0, len(endings), row.moments)]
    good = {group.count(STANDS) for group in groups}
    if len(good) == 1:
        text = f"{good.pop()} of {row.moments}{' each' if len(groups) > 1 else ''}"
    else:
        text = f"{endings.count(STANDS)} of {len(endings)}"
    others = Counter(item for item in endings if item != STANDS)
    text += "".join(f", {count} {word}" for word, count in sorted(others.items()))
    return {"what": row.subject, "range": row.values, "stops that end standing": text}
