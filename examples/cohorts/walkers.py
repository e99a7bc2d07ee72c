"""Virtual people on the treadmill: their properties, and their walks as changes of one experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from cohorts.people import cohort
from scipy import stats

from twin_gait import Patient
from twin_gait.configuration.experiments import list_patients

MASS_ALONE = "mass alone"
SPEEDS = (0.36, 0.42)  # belt [m/s]
SUPPORT = 0.6
DURATION = 60.0  # [s]
CONFIDENCE = 0.95


def sizes_of(person: Patient) -> dict[str, float | str]:
    """Return stature, mass and sex by keys of an experiment."""
    return {
        "patient.mass_kg": person.mass,
        "patient.height_m": person.height,
        "patient.sex": str(person.sex),
    }


def walkers(count: int, seed: int) -> list[dict[str, Any]]:
    """Return a cohort as changes of an experiment, each with an evenly drawn condition and belt speed.

    Walker i is the same in a cohort of any size. Those who are mass alone have no entry ``patient``.
    """
    conditions = [MASS_ALONE, *list_patients()]
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))
    low, high = SPEEDS
    found = []
    for person, (which, share) in zip(cohort(count, seed), generator.uniform(size=(count, 2)), strict=True):
        condition = conditions[int(which * len(conditions))]
        somebody = {} if condition == MASS_ALONE else {"patient": condition}
        speed = {"scenario.belt_speed_m_per_s": float(low + share * (high - low))}
        found.append({**somebody, **sizes_of(person), **speed})
    return found


def cohort_row(name: str, seed: int, walks: pd.DataFrame) -> dict[str, Any]:
    """Return a row: share of walks with Wilson's interval, and median errors of those who walk."""
    walked = walks[walks["outcome"] == "walked"]
    interval = stats.binomtest(len(walked), len(walks)).proportion_ci(CONFIDENCE, "wilson")
    others = walks["outcome"][walks["outcome"] != "walked"].value_counts()
    return {
        "table": name,
        "seed": seed,
        "walk": f"{len(walked)} of {len(walks)} ({len(walked) / len(walks):.1%})",
        "95 % interval": f"{interval.low:.1%} to {interval.high:.1%}",
        "hip [°]": median_error(walked, "hip"),
        "knee [°]": median_error(walked, "knee"),
        "others": ", ".join(f"{count} {word}" for word, count in others.items()) or "none",
    }


def median_error(walked: pd.DataFrame, joint: str) -> str:
    """Return the median over the walks of the larger RMSE of both legs from foot contact."""
    errors = walked[[f"{side}_rmse_{joint}_by_contact_deg" for side in ("left", "right")]].max(axis=1)
    return f"{errors.median():.1f}" if errors.notna().any() else "–"


def failures(name: str, seed: int, walks: pd.DataFrame, people: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a sentence about each person who does not walk."""
    return [
        f"{name}, seed {seed}, number {row.episode}: {people[row.episode].get('patient', MASS_ALONE)}, "
        f"{people[row.episode]['patient.mass_kg']:.0f} kg, {people[row.episode]['patient.height_m']:.2f} m "
        f"{row.outcome} after {row.duration_s:.1f} s"
        for row in walks.itertuples()
        if row.outcome != "walked"
    ]
