"""The table on the page about standing: for whom ``treadmill_start_stop`` starts, walks and stands again.

``python -m twin_gait.studies.people.stand_page docs`` takes two minutes and writes the rows between the two
marks of ``stand.md``, the rest of which is written by hand.
"""

from __future__ import annotations

import argparse
import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from twin_gait.configuration.experiments import load_experiment
from twin_gait.exceptions import TwinGaitError
from twin_gait.files import write_atomically
from twin_gait.simulation import Run, RunStatus, simulate
from twin_gait.studies.jobs import run_jobs
from twin_gait.studies.people.outcome_map import HEIGHTS, MASSES
from twin_gait.vocabulary import STAND

PRESET, PAGE = "treadmill_start_stop", "stand.md"
BEGIN, END = "<!-- trials: begin -->\n", "<!-- trials: end -->\n"
WALKING = 7.0  # [s] between the two commands, at least
STRIDE = 2.08  # [s], about that of the default walk: the moments are spread over it, no more hangs on it
STANDING = 4.0  # [s] that a wearer has to come to rest
LEAST_FORCE = 50.0  # [N] under either foot
MANY, FEW = 10, 5  # moments of the stride

STANDS, FALLS, OTHERWISE = "stand", "fall or trip", "not on both feet"


class Row(NamedTuple):
    """One line of the table.

    Attributes:
        what: Is changed.
        values: As they are printed.
        settings: One for each value, see ``--set``.
        moments: At which each of them is told to stand.
    """

    what: str
    values: str
    settings: tuple[tuple[str, ...], ...]
    moments: int


class Trial(NamedTuple):
    """A walk from stand to stand.

    Attributes:
        settings: What is changed.
        stop: Command to stand in [s].
    """

    settings: tuple[str, ...]
    stop: float


def _each(key: str, values: Iterable[float]) -> tuple[tuple[str, ...], ...]:
    return tuple((f"{key}={value:g}",) for value in values)


def _row(what: str, key: str, values: Sequence[float], unit: str = "") -> Row:
    return Row(what, ", ".join(f"{value:g}" for value in values) + unit, _each(key, values), FEW)


def _sizes(masses: Iterable[float], heights: Iterable[float]) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (f"patient.mass_kg={mass:g}", f"patient.height_m={height:g}")
        for mass, height in itertools.product(masses, heights)
    )


def _effort(share: float) -> tuple[str, ...]:
    joint = f"{{passive: 1, effort: {share:g}}}"
    return (f"patient.both={{hip: {joint}, knee: {joint}}}",)


_ENDS = (MASSES[0], MASSES[-1]), (HEIGHTS[0], HEIGHTS[-1])
ROWS = (
    Row("default wearer (70 kg, 1.75 m)", "", ((),), MANY),
    Row(
        "lightest and heaviest, shortest and tallest",
        "{:g} and {:g} kg, {:.2f} and {:.2f} m".format(*_ENDS[0], *_ENDS[1]),
        _each("patient.mass_kg", _ENDS[0]) + _each("patient.height_m", _ENDS[1]),
        MANY,
    ),
    Row(
        "mass and height",
        f"{', '.join(f'{x:g}' for x in MASSES)} kg by {', '.join(f'{x:.2f}' for x in HEIGHTS)} m",
        _sizes(MASSES, HEIGHTS),
        FEW,
    ),
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
    _row("share of the weight supported", "scenario.support.share", (0.3, 0.4, 0.5, 0.7)),
    Row(
        "friction of the joints over the model",
        "0.3, 0.8, 1.0",
        tuple((f"plant.friction_ratio={{hip: {ratio:g}, knee: {ratio:g}}}",) for ratio in (0.3, 0.8, 1.0)),
        FEW,
    ),
)


def trials_of(row: Row) -> tuple[Trial, ...]:
    """All walks of a line, the moments of each value side by side."""
    start = load_experiment(PRESET, ()).experiment.scenario.belt.start  # type: ignore[union-attr]
    stops = [start + WALKING + STRIDE * number / row.moments for number in range(row.moments)]
    return tuple(Trial(settings, stop) for settings in row.settings for stop in stops)


def ending(trial: Trial) -> str:
    """Let one wearer walk and stand again.

    Args:
        trial: Who and until when.

    Returns:
        ``STANDS``, ``FALLS`` or ``OTHERWISE``.
    """
    times = f"scenario.belt.stop_s={trial.stop}", f"duration_s={trial.stop + STANDING}"
    return ending_of(simulate(load_experiment(PRESET, [*trial.settings, *times]).experiment))


def ending_of(run: Run) -> str:
    """How a run from stand to stand ended."""
    if run.status is not RunStatus.COMPLETED or run.trip is not None:
        return FALLS
    last = run.log.iloc[-1]
    both = all(
        last[f"{side}_phase"] == STAND and last[f"{side}_foot_normal_force_N"] > LEAST_FORCE
        for side in run.sides
    )
    return STANDS if both else OTHERWISE


def line_of(row: Row, endings: Sequence[str]) -> str:
    """One line of the table.

    Args:
        row: What was tried.
        endings: Of :func:`trials_of`, in their order.

    Returns:
        Markdown.
    """
    groups = [endings[at : at + row.moments] for at in range(0, len(endings), row.moments)]
    good = Counter(group.count(STANDS) for group in groups)
    each = " each" if len(groups) > 1 else ""
    if len(good) == 1:
        (count,) = good
        text = f"{count} of {row.moments}{each}"
    else:
        text = f"{endings.count(STANDS)} of {len(endings)}"
    others = Counter(item for item in endings if item != STANDS)
    text += "".join(f", {count} {word}" for word, count in sorted(others.items()))
    return f"| {row.what} | {row.values} | {text} |"


def table_text(lines: Iterable[str]) -> str:
    """The whole table.

    Args:
        lines: See :func:`line_of`.

    Returns:
        Markdown.
    """
    return "\n".join(["| what | range | stops that end standing |", "|---|---|---|", *lines]) + "\n"


def write_page(folder: Path, workers: int) -> None:
    """Try all rows and write them into the page.

    Args:
        folder: Where the page is.
        workers: Processes.

    Raises:
        TwinGaitError: If the page has no marks.
    """
    path = folder / PAGE
    text = path.read_text(encoding="utf-8")
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise TwinGaitError(f"{path}: expected one {BEGIN.strip()} and one {END.strip()}")
    before, rest = text.split(BEGIN)
    lines = []
    for row in ROWS:
        trials = trials_of(row)
        lines.append(line_of(row, run_jobs(ending, trials, workers=workers)))
        print(lines[-1], flush=True)
    write_atomically(path, f"{before}{BEGIN}\n{table_text(lines)}\n{END}{rest.split(END)[1]}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("docs"))
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args()
    write_page(chosen.folder, chosen.workers)
