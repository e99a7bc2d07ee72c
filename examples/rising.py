"""How much force do rising and sitting down need from the arms, and how large are the other loads?

The presets ``sit_to_stand`` and ``stand_to_sit`` compared with published values of hips, knees and seat, and
the least axial force of the arms with which wearers of 55–95 kg and 1.60–1.90 m rise from seats of
0.40–0.50 m, and sit down. Some minutes; page: docs/background/overground.md.
"""

# %%
from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from gallery import read_options

from twin_gait import JointName, Run, load_experiment, simulate
from twin_gait.studies.jobs import run_jobs

SEATS, MASSES, HEIGHTS = (0.40, 0.45, 0.50), (55, 75, 95), (1.60, 1.75, 1.90)  # [m], [kg], [m]
WITHIN = 0.02  # share of the weight: width at which the bisection ends
HELD = 12.0  # [s] from the request to the end of a run
STANDS, SITS = 0.9, 0.5  # least share of standing height; of weight on the seat (assumptions)
GRAVITY = 9.81  # [m/s^2]


class Motion(NamedTuple):
    """Motion from the seat or to the seat."""

    preset: str
    request_time: float  # time of its request in [s]
    name: str


RISING, SITTING = Motion("sit_to_stand", 0.5, "rising"), Motion("stand_to_sit", 3.5, "sitting down")


class Case(NamedTuple):
    """Chair and wearer."""

    seat: float  # height of the seat in [m]
    mass: float  # mass of the wearer in [kg]
    height: float  # height of the wearer in [m]


class Mark(NamedTuple):
    """Published value or range in a panel."""

    panel: str
    low: float
    high: float
    source: str


# The source of a value with "recalled" was not found again, so that this value is uncertain.
PUBLISHED = {
    RISING.preset: (
        Mark("force / weight", 1.10, 1.25, "recalled: feet, peak"),
        Mark(
            "extension torque [N·m/kg]",
            0.7,
            0.7,
            "published: hip, least without arms (Yoshioka 2007)",
        ),
        Mark(
            "extension torque [N·m/kg]",
            0.9,
            0.9,
            "published: knee, least without arms (Yoshioka 2007)",
        ),
        Mark("trunk pitch [°]", 40.9, 76.7, "published: seat-off, full flexion, ± SD (NITK 2025)"),
        Mark("trunk pitch [°]", 35.0, 50.0, "recalled: peak, natural rising"),
        Mark("push of both arms / weight", 0.6, 0.6, "published: handles, most (Ackermann et al.)"),
    ),
    SITTING.preset: (
        Mark("force / weight", 1.4, 1.4, "published: seat, impact, mean (Chang 2014)"),
        Mark("push of both arms / weight", 0.25, 0.25, "published: arms, peak (Chang 2014)"),
    ),
}


# %%
def run_of(motion: Motion, case: Case | None = None, share: float | None = None) -> Run:
    """Simulate a motion of one case with a limit for both arms together as a share of the weight."""
    settings = [f"duration_s={motion.request_time + HELD}"]
    if case is not None:
        settings += [f"scenario.chair.height_m={case.seat}", *_person(case)]
    experiment = load_experiment(motion.preset, settings).experiment
    if share is not None:
        limit = 0.5 * share * experiment.build_world().body_weight
        settings.append(f"scenario.crutches.push_limit_N={limit}")
        experiment = load_experiment(motion.preset, settings).experiment
    return simulate(experiment)


def _person(case: Case) -> list[str]:
    return [f"patient.mass_kg={case.mass}", f"patient.height_m={case.height}"]


def standing_height(run: Run) -> float:
    """Return the pelvis height of a wearer on straight legs and flat feet in [m]."""
    model = run.experiment.build_world().model
    leg = model.legs[model.sides[0]]
    soles = (model.frame_position(np.zeros(model.nv), frame)[2] for frame in leg.contact_frames)
    return -float(min(soles))


def arrival(run: Run, phase: str) -> int:
    """Return the row at which both legs enter a phase, or the number of rows if they do not."""
    inside = np.all([run.log[f"{side}_phase"].to_numpy() == phase for side in run.sides], axis=0)
    entries = np.flatnonzero(inside[1:] & ~inside[:-1]) + 1
    return int(entries[0]) if len(entries) else len(inside)


def at_stop(run: Run, rows: int) -> bool:
    """Return whether a hip or knee was at its stop in the first rows."""
    joints = [f"{side}_{joint}" for side in run.sides for joint in (JointName.HIP, JointName.KNEE)]
    return any(run.log[f"{joint}_stop_torque_Nm"].iloc[:rows].abs().max() > 0.0 for joint in joints)


def risen(run: Run) -> bool:
    """Return whether the person has risen, regardless of the later motion of the crutches."""
    row = arrival(run, "upright")
    if row == len(run.log) or at_stop(run, row):
        return False
    return bool(run.log["pelvis_height_m"].iloc[row] > STANDS * standing_height(run))


def stays(run: Run) -> bool:
    """Return whether the person stands at the end with the crutches in front: no fall, trip or stop."""
    if run.reason or at_stop(run, len(run.log)):
        return False
    return bool(run.log["pelvis_height_m"].iloc[-1] > STANDS * standing_height(run))


def sits(run: Run) -> bool:
    """Return whether the seat carries the person at the end: no fall, trip or stop."""
    if run.reason or at_stop(run, len(run.log)):
        return False
    return bool(run.log["seat_force_N"].iloc[-1] > SITS * run.body_weight)


def pushes(run: Run) -> np.ndarray:
    """Return the axial force of both arms over the weight, shape ``(rows,)``."""
    arms = sum(run.log[f"{side}_arm_axial_force_N"].to_numpy() for side in run.sides)
    return np.maximum(arms, 0.0) / run.body_weight


def least(enough: Callable[[float], bool], most: float, within: float) -> float | None:
    """Return the smallest sufficient value by bisection; None if the largest one is not sufficient.

    All values above a sufficient one are assumed to be sufficient; otherwise one of several bounds is found.

    Args:
        enough: Function that returns whether a value is sufficient.
        most: Largest value, above 0.
        within: Width of the last interval, whose upper end is returned.
    """
    if not enough(most):
        return None
    low, high = 0.0, most
    while high - low > within:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


Reached = Callable[[Run], bool]
CRITERIA: dict[Motion, dict[str, Reached]] = {
    RISING: {"rise": risen, "stay up": stays},
    SITTING: {"sit": sits},
}


def columns_of(motion: Motion, case: Case) -> dict[str, str]:
    """Return the least limit of the arms, and their peak with the limit of the preset, in [%]."""
    free = run_of(motion, case)
    most = 2.0 * free.experiment.scenario.crutches.push_limit / free.body_weight
    criteria = CRITERIA[motion]

    @cache
    def results_with_limit(limit: float) -> dict[str, bool]:
        run = free if limit == most else run_of(motion, case, limit)
        return {name: enough(run) for name, enough in criteria.items()}

    found = {}
    for name in criteria:
        share = least(lambda value, name=name: results_with_limit(value)[name], most, WITHIN)
        found[f"{name}: least [%]"] = "fails" if share is None else f"{100.0 * share:.0f}"
    found[f"{motion.name}: peak [%]"] = f"{100.0 * pushes(free)[during(motion, free)].max():.0f}"
    found[f"{motion.name}: ends"] = free.reason or "completed"
    return found


def during(motion: Motion, run: Run) -> slice:
    """Return the rows from the request until the person has risen, or has sat down and one second more."""
    phase = "upright" if motion is RISING else "sit"
    return slice(round(motion.request_time * 1000), arrival(run, phase) + 1000 * (motion is SITTING))


def row_of(case: Case) -> dict[str, str]:
    """Return the results of both motions of one case as a row."""
    named = {
        "seat [m]": f"{case.seat:.2f}",
        "mass [kg]": f"{case.mass}",
        "height [m]": f"{case.height:.2f}",
    }
    return {**named, **columns_of(RISING, case), **columns_of(SITTING, case)}


# %%
def curves_of(run: Run) -> dict[str, dict[str, np.ndarray]]:
    """Return curves of the panels by label; motor torques over the carried mass, extension positive."""
    log, weight = run.log, run.body_weight
    feet = sum(log[f"{side}_foot_normal_force_N"].to_numpy() for side in run.sides)
    torques = {}
    for joint in (JointName.HIP, JointName.KNEE):
        both = sum(log[f"{side}_{joint}_motor_torque_Nm"].to_numpy() for side in run.sides)
        torques[str(joint)] = -0.5 * both * GRAVITY / weight
    return {
        "force / weight": {"seat": log["seat_force_N"].to_numpy() / weight, "feet": feet / weight},
        "extension torque [N·m/kg]": torques,
        "trunk pitch [°]": {"trunk": np.degrees(log["trunk_pitch_rad"].to_numpy())},
        "push of both arms / weight": {"arms": pushes(run)},
    }


def draw(runs: dict[Motion, Run]) -> plt.Figure:
    """Draw forces, torques, trunk and arms of each motion over time, with published values."""
    figure, axes = plt.subplots(4, len(runs), figsize=(11, 11), sharex="col", layout="constrained")
    for column, (motion, run) in enumerate(runs.items()):
        axes[0, column].set_title(motion.name)
        axes[-1, column].set_xlabel("time [s]")
        rows = slice(round(1000 * (motion.request_time - 0.5)), None)
        for axis, (panel, curves) in zip(axes[:, column], curves_of(run).items(), strict=True):
            for label, values in curves.items():
                axis.plot(run.log["time_s"][rows], values[rows], label=label, linewidth=1.0)
            draw_marks(axis, [mark for mark in PUBLISHED[motion.preset] if mark.panel == panel])
            axis.set_ylabel(panel)
            axis.margins(x=0.0, y=0.25)
            axis.legend(frameon=False, fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        axes[0, column].set_title(motion.name, pad=34)
    return figure


def draw_marks(axis: plt.Axes, marks: list[Mark]) -> None:
    """Draw ranges as bands, and values as lines."""
    for number, mark in enumerate(marks):
        if mark.low < mark.high:
            axis.axhspan(mark.low, mark.high, color=("C2", "C4")[number % 2], alpha=0.15, label=mark.source)
        else:
            colour = f"C{number}" if len(marks) > 1 else "0.4"
            axis.axhline(mark.low, color=colour, linestyle="--", linewidth=1.0, label=mark.source)


def beside_published(runs: dict[Motion, Run]) -> list[dict[str, str]]:
    """Return peaks of the presets, from the request to standing or sitting, with published values."""
    found = []
    for motion, run in runs.items():
        rows = during(motion, run)
        for panel, curves in curves_of(run).items():
            marks = [mark for mark in PUBLISHED[motion.preset] if mark.panel == panel]
            ranges = (f"{m.low:g}" + f" to {m.high:g}" * (m.high > m.low) for m in marks)
            others = (f"{text} ({mark.source})" for text, mark in zip(ranges, marks, strict=True))
            peaks = ", ".join(f"{label} {values[rows].max():.2f}" for label, values in curves.items())
            found.append(
                {"motion": motion.name, "peak of": panel, "simulated": peaks, "others": "; ".join(others)}
            )
    return found


# %%
if __name__ == "__main__":
    form = read_options("rising")
    shown = {motion: run_of(motion) for motion in (RISING, SITTING)}
    draw(shown).savefig(form.out / "rising.png", dpi=110)
    comparison = beside_published(shown)
    grid = [Case(*case) for case in itertools.product(SEATS, MASSES, HEIGHTS)]
    cases = run_jobs(row_of, grid[13:14] if form.quick else grid, workers=form.workers)
    for line in (*comparison, *cases):
        print(line)
    form.write_results({"comparison": comparison, "within_percent": 100.0 * WITHIN, "cases": cases})
