"""The page of the documentation on tables for anybody: the fit of the scaling law, and who walks with it.

``python -m twin_gait.studies.people.cohort_page docs`` fits (five minutes on two cores) and writes
``cohort.csv`` there; with ``--walk`` it lets the cohorts walk with the laws that the tables state (ten
minutes), and writes ``cohort.md``. ``--tuned`` adds people with tables of their own (half an hour more).
"""

from __future__ import annotations

import argparse
import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from twin_gait.configuration.experiments import DEFAULT_PRESET, load_experiment
from twin_gait.files import write_atomically
from twin_gait.gait.table import SCALING_EXPONENTS
from twin_gait.parameters import HEAVIEST_WEARER
from twin_gait.studies.jobs import Workers
from twin_gait.studies.people.cohort_walks import (
    DURATION,
    GENERATIONS,
    SPEEDS,
    SUPPORT,
    Walk,
    Work,
    draw_walkers,
    walk_cohort,
    walking_share,
)
from twin_gait.studies.people.scaling_fit import (
    SPEEDS as FIT_SPEEDS,
)
from twin_gait.studies.people.scaling_fit import (
    SUPPORTS,
    WALK,
    draw_people,
    fit_exponents,
    law_of,
    worth_of,
)
from twin_gait.studies.tune.stages import START_TABLES
from twin_gait.vocabulary import Outcome

FIT_PEOPLE, FIT_SEED = 48, 3
# The second of the cohorts' seeds, and this one, were never used while tables and laws were made.
TEST_SEED = 2028
COHORT, COHORT_SEEDS = 200, (11, 2027)
TUNED, TUNED_SEED = 30, 11
FIT_FILE, PAGE_FILE = "cohort.csv", "cohort.md"
CONFIDENCE = 0.95
_COHORT_HEADS = ("table", "seed", "walk", "95 % interval", "hip [°]", "knee [°]", "others")
STATED, FITTED, NONE = "stated", "fitted", "no law"

_LAWS = (
    (
        "stiffness in the stance phases",
        "carried mass: wearer and device, less the support",
        "`carried_mass_kg`",
        "`carried_mass_exponent`",
    ),
    (
        "distance of hip equilibria and hip thresholds from `hip_centre_deg`",
        "belt speed",
        "`speed_m_per_s`",
        "`speed_exponent`",
    ),
    ("the same distance", "wearer's height", "`height_m`", "`height_exponent`"),
)
_TEXT = """# A table for anybody

A gait table is found for one person. Its `scaling` adapts it to another one before the run, from mass,
height, support and belt speed alone. What is in the first column is multiplied by (quantity / reference) ^
exponent:

{laws}

A law whose reference is left out is off. At its references a table is what its file says.

## The exponents

CMA-ES looked for the exponents with which {people} people (seed {seed}) walk best on the mean: supports
{supports}, belt {speeds}, one walk of {walk:g} s each, cost as in [tuning](tune.md). {people} others (seed
{test_seed}) tell what a law is worth:

{fits}

Fitted is how people walk with the law, not the numbers of tables tuned one by one: these keep what a search
had no need to change. The tables state round numbers on the flat bottom that the searches come to. Seed
{test_seed} had no part in choosing them.
{worth}
With larger exponents of `treadmill` (−0.4 and 0.6, tried by hand) a heavy and short wearer does not come to
stand on both feet again on [the standing table](start_stop.md), which extends this one.

The law is one for wearers whom the belt carries along. A healthy person takes shorter steps when he walks
slower; in a [replay](replay.md) of his log `treadmill` needs another exponent of the speed.

Range of validity: what the fit has seen, {masses} and {heights}, supports {supports} and belt speeds
{speeds}.

## Who walks with it

{count} people a cohort, each with a condition of [those who ship](people.md) or as mass alone, {support}
support, belt {cohort_speeds}, {duration:g} s, the default engine and step. Seed {second} was not looked at
before tables and laws were fixed.

{cohorts}

{failures}
{tuned}
Errors are medians of RMSE from foot contact against Koopman et al. (2014), of the larger leg. All people and
all walks are simulated. Made by `python -m twin_gait.studies.people.cohort_page docs --walk{flags}`.
"""
_TUNED_TEXT = """
## Tuned one by one

The first {count} people of seed {seed}, each with a table of his own: `twin-gait tune` without
screening, {generations} generations (a whole tuning has some hundred).

{tunings}

"""


def fit_rows(name: str, workers: Workers) -> list[dict[str, object]]:
    """Fit the laws of a shipped table, and see what laws are worth.

    Args:
        name: Of the table.
        workers: Who works.

    Returns:
        A row for each law: no law, the stated one, the fitted one, and that with each exponent left out.
    """
    base = load_experiment(DEFAULT_PRESET, [f"table={name}"]).experiment
    people, others = draw_people(FIT_PEOPLE, FIT_SEED), draw_people(FIT_PEOPLE, TEST_SEED)
    fitted = fit_exponents(base, people, workers=workers, progress=_say)
    stated = {exponent: getattr(base.table.scaling, exponent) for exponent in SCALING_EXPONENTS}
    laws = {NONE: dict.fromkeys(SCALING_EXPONENTS, 0.0), STATED: stated, FITTED: fitted}
    laws |= {f"without {exponent}": {**fitted, exponent: 0.0} for exponent, x in fitted.items() if x != 0.0}
    rows: list[dict[str, object]] = []
    for law, exponents in laws.items():
        seen, new = (worth_of(base, group, law_of(base, exponents), workers) for group in (people, others))
        worth = {"mean_fitted": seen.mean, "mean_others": new.mean, "median_others": new.median}
        rows.append(
            {
                "table": name,
                "law": law,
                **exponents,
                **{key: round(value, 3) for key, value in worth.items()},
                "falls": seen.falls + new.falls,
            }
        )
    return rows


def cohort_text(
    fits: pd.DataFrame,
    cohorts: Mapping[tuple[str, int], Sequence[Walk]],
    tuned: Sequence[Walk],
    plain: Sequence[Walk],
) -> str:
    """Text of the page.

    Args:
        fits: Content of ``cohort.csv``.
        cohorts: Walks by table and seed.
        tuned: Walks with tables tuned one by one; empty if nobody was.
        plain: Walks of the same people with the shipped table.

    Returns:
        Markdown.
    """
    people = draw_people(FIT_PEOPLE, FIT_SEED)
    masses = [item.patient.mass for item in people]
    heights = [item.patient.height for item in people]
    heads = (
        "table",
        "law",
        *SCALING_EXPONENTS,
        "mean cost, fitted",
        "mean cost, others",
        "median, others",
        "fall",
    )
    return _TEXT.format(
        laws=_markdown(("what", "follows", "reference", "exponent"), _LAWS),
        people=FIT_PEOPLE,
        seed=FIT_SEED,
        test_seed=TEST_SEED,
        walk=WALK,
        supports=f"{SUPPORTS[0]:.0%} to {SUPPORTS[1]:.0%}",
        speeds=f"{FIT_SPEEDS[0]:.2f} to {FIT_SPEEDS[1]:.2f} m/s",
        worth="\n".join(_worth(fits, name) for name in START_TABLES),
        fits=_markdown(heads, ([str(value) for value in row] for row in fits.itertuples(index=False))),
        masses=f"{min(masses):.0f} to {max(masses):.0f} kg (the device carries {HEAVIEST_WEARER:g})",
        heights=f"{min(heights):.2f} to {max(heights):.2f} m",
        count=COHORT,
        support=f"{SUPPORT:.0%}",
        cohort_speeds=f"{SPEEDS[0]:g} to {SPEEDS[1]:g} m/s",
        duration=DURATION,
        second=COHORT_SEEDS[1],
        cohorts=_markdown(
            _COHORT_HEADS,
            (_cohort_row(table, str(seed), walks) for (table, seed), walks in cohorts.items()),
        ),
        failures=_failures(cohorts),
        tuned=_tuned_text(tuned, plain) if tuned else "",
        flags=" --tuned" if tuned else "",
    )


def _worth(fits: pd.DataFrame, table: str) -> str:
    costs = fits[fits["table"] == table].set_index("law")["mean_others"]
    gain = 1.0 - costs[STATED] / costs[NONE]
    word = "less" if gain >= 0.0 else "more"
    return f"With the law of `{table}` the others cost {abs(gain):.1%} {word} than without one."


def _tuned_text(tuned: Sequence[Walk], plain: Sequence[Walk]) -> str:
    rows = ((f"{START_TABLES[0]}, scaled", plain), ("tuned", tuned))
    return _TUNED_TEXT.format(
        count=len(tuned),
        seed=TUNED_SEED,
        generations=GENERATIONS,
        tunings=_markdown(_COHORT_HEADS, (_cohort_row(name, str(TUNED_SEED), walks) for name, walks in rows)),
    )


def _cohort_row(table: str, seed: str, walks: Sequence[Walk]) -> tuple[str, ...]:
    others = Counter(item.outcome for item in walks if item.outcome != Outcome.WALKED)
    interval = stats.binomtest(len(walks) - others.total(), len(walks)).proportion_ci(CONFIDENCE, "wilson")
    return (
        table,
        seed,
        f"{len(walks) - others.total()} of {len(walks)} ({walking_share(walks):.1%})",
        f"{interval.low:.1%} to {interval.high:.1%}",
        _median(walks, "hip_error_deg"),
        _median(walks, "knee_error_deg"),
        ", ".join(f"{count} {word}" for word, count in others.items()) or "none",
    )


def _median(walks: Sequence[Walk], part: str) -> str:
    found = [item.parts[part] for item in walks if item.outcome == Outcome.WALKED]
    values = [value for value in found if value is not None]
    return f"{float(np.median(np.array(values, dtype=float))):.1f}" if values else "–"


def _failures(cohorts: Mapping[tuple[str, int], Sequence[Walk]]) -> str:
    lines = [
        f"- {table}, seed {seed}, number {item.walker.number}: {item.walker.condition}, "
        f"{item.walker.sizes['patient.mass_kg']:.0f} kg, {item.walker.sizes['patient.height_m']:.2f} m, "
        f"{item.walker.speed:.2f} m/s {item.outcome} after {item.lasted:.1f} s "
        f"({item.reason})"
        for (table, seed), walks in cohorts.items()
        for item in walks
        if item.outcome != Outcome.WALKED
    ]
    return "Those who do not walk:\n\n" + "\n".join(lines) if lines else "Everybody walks."


def _markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def _say(done: int, total: int) -> None:
    print(f"{done} of {total}", flush=True)


def write_fit(folder: Path, workers: Workers) -> None:
    """Fit the laws of all tables and write ``cohort.csv``."""
    rows = [row for name in START_TABLES for row in fit_rows(name, workers)]
    text = io.StringIO()
    pd.DataFrame(rows).to_csv(text, index=False, lineterminator="\n")
    write_atomically(folder / FIT_FILE, text.getvalue())


def write_page(folder: Path, workers: Workers, tuned: bool) -> None:
    """Let the cohorts walk, if asked for with tables tuned one by one too, and write ``cohort.md``."""
    cohorts = {
        (table, seed): walk_cohort([Work(item, table) for item in draw_walkers(COHORT, seed)], workers, _say)
        for table in START_TABLES
        for seed in COHORT_SEEDS
    }
    people = draw_walkers(TUNED, TUNED_SEED) if tuned else ()
    apart = walk_cohort([Work(item, START_TABLES[0], True) for item in people], workers, _say)
    plain = cohorts[START_TABLES[0], TUNED_SEED][:TUNED]
    fits = pd.read_csv(folder / FIT_FILE)
    write_atomically(folder / PAGE_FILE, cohort_text(fits, cohorts, apart, plain))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("docs"))
    parser.add_argument("--walk", action="store_true", help="walk with the stated law instead of fitting it")
    parser.add_argument("--tuned", action="store_true", help="and with tables tuned one by one")
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args()
    with Workers(chosen.workers) as standing:
        if chosen.walk:
            write_page(chosen.folder, standing, chosen.tuned)
        else:
            write_fit(chosen.folder, standing)
