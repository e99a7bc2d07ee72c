"""Fault campaigns: many seeded faults on one experiment, with one row and one outcome for each."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Unpack

import numpy as np
import pandas as pd

from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import TICK
from twin_gait.parameters.quantities import DEGREE, require
from twin_gait.simulation.run import Run
from twin_gait.studies.batch import run_episodes
from twin_gait.studies.jobs import WorkCallbacks
from twin_gait.studies.workers import Workers
from twin_gait.vocabulary import Outcome
from twin_gait.worlds.faults import LOSSES_OF_SUPPLY, Fault, FaultKind

FIRST_TIME = 1.0  # [s]; the gait has started by then
# Outcomes in the order of the table, best first.
OUTCOMES = (Outcome.WALKED, Outcome.HELD, Outcome.STALLED, Outcome.HUNG, Outcome.FELL, Outcome.DIVERGED)
REST = 2.0  # [s] after the last fault, to see the outcome

DRAWN_KINDS = tuple(kind for kind in FaultKind if kind not in LOSSES_OF_SUPPLY)
# Smallest and largest magnitude that is drawn, in SI units, from hardly noticeable to gross.
MAGNITUDES = {
    FaultKind.ENCODER_JUMP: (0.5 * DEGREE, 30.0 * DEGREE),
    FaultKind.ENCODER_OFFSET: (0.5 * DEGREE, 20.0 * DEGREE),
    FaultKind.ENCODER_DRIFT: (2.0 * DEGREE, 100.0 * DEGREE),
    FaultKind.MOTOR_STUCK: (5.0, 100.0),
    FaultKind.CONTROLLER_RUNAWAY: (20.0, 2000.0),
    FaultKind.SUPPLY_DIP: (2.0, 25.0),
}


# Endings of columns with measured values, which may be empty under a fault; all others must not be.
_MEASURED = ("_measured_angle_rad", "_velocity_fast_rad_per_s", "_velocity_slow_rad_per_s", "_phase")
_ROUNDING = 1e-9


def violations(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table of :func:`fault_row` in which a required property is violated."""
    kept = table["within_limits"] & (table["null_values"] == 0) & table["hold_kept"]
    return table[~(kept & (table["outcome"] != Outcome.DIVERGED))]


def draw_faults(experiment: Experiment, count: int, seed: int) -> list[Fault]:
    """Draw faults over kind, joint, time and magnitude.

    Kinds alternate, so that each is drawn equally often; side, joint and time are uniform, magnitudes are
    log-uniform between the bounds of ``MAGNITUDES`` with either sign. A loss of the supply is not drawn: it
    ends every walk, and ``examples/supply_loss.py`` simulates it. A fault depends on the seed and its
    position only: a longer campaign begins with the faults of a shorter one. Raises ParameterError if the run
    is too short for a fault and its consequences, or ``count`` or ``seed`` is too small.
    """
    require(count >= 1, "count", "1 or more faults", count)
    require(seed >= 0, "seed", "0 or more", seed)
    least = FIRST_TIME + REST
    require(experiment.duration >= least, "duration", f"{least:g} s or more", experiment.duration)
    feet = experiment.scenario.grounded
    kinds = [kind for kind in DRAWN_KINDS if feet or kind is not FaultKind.FOOT_LOAD_STUCK]
    return [_draw(experiment, kinds[index % len(kinds)], index, seed) for index in range(count)]


def _draw(experiment: Experiment, kind: FaultKind, index: int, seed: int) -> Fault:
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    sides = list(experiment.sides)
    side = sides[int(generator.integers(len(sides)))]
    joints = experiment.joints
    joint = joints[int(generator.integers(len(joints)))]
    time = round(float(generator.uniform(FIRST_TIME, experiment.duration - REST)), 3)
    magnitude = None
    if kind in MAGNITUDES:
        least, most = MAGNITUDES[kind]
        magnitude = math.exp(float(generator.uniform(math.log(least), math.log(most))))
        if kind is not FaultKind.SUPPLY_DIP and generator.random() < 0.5:
            magnitude = -magnitude
    return Fault(kind=kind, time=time, location=kind.location(side, joint), magnitude=magnitude)


def fault_row(run: Run) -> dict[str, Any]:
    """Summarise a run with one fault.

    Returns the fault in its notation, kind, side, joint, time and magnitude; outcome; cause, place and time
    of the trip (empty without one), and the time from fault to trip, unless the trip came first; largest
    motor torque and current, and whether both are inside their limits in every tick; the number of empty
    values among commands and plant; and whether the hold, once entered, lasts to the end.
    """
    (fault,) = run.experiment.faults
    trip, limits = run.trip, run.experiment.control.limits
    joints = [(side, joint) for side in run.experiment.sides for joint in run.experiment.joints]
    # Largest magnitudes of each joint; NaN if a value is empty.
    torque, current = (
        np.array([np.abs(run.log[f"{side}_{joint}_{name}"].to_numpy()).max() for side, joint in joints])
        for name in ("motor_torque_Nm", "measured_current_A")
    )
    torque_limit = np.array([limits[joint].torque for _, joint in joints])
    current_limit = np.array([limits[joint].current for _, joint in joints])
    plant = [name for name in run.log if not str(name).endswith(_MEASURED)]
    late = math.nan if trip is None else round((trip.time - fault.time) / TICK) * TICK
    return {
        "fault": str(fault),
        "kind": str(fault.kind),
        "side": None if fault.side is None else str(fault.side),
        "joint": None if fault.joint is None else str(fault.joint),
        "time_s": fault.time,
        "magnitude": fault.magnitude_or_default if fault.kind.units else math.nan,
        "outcome": str(run.verdict.outcome or run.status),
        "cause": "" if trip is None else str(trip.cause),
        "trip_location": "" if trip is None else trip.location,
        "trip_time_s": math.nan if trip is None else trip.time,
        "detection_s": math.nan if late < 0.0 else late,
        "torque_peak_Nm": float(torque.max()),
        "current_peak_A": float(current.max()),
        "within_limits": bool(
            np.all(torque <= torque_limit + _ROUNDING) and np.all(current <= current_limit + _ROUNDING)
        ),
        "null_values": int((~np.isfinite(run.log[plant].to_numpy())).sum()),
        "hold_kept": trip is None or bool((run.log["safety_state"].iloc[trip.tick + 2 :] == 1.0).all()),
    }


def simulate_faults(
    experiment: Experiment,
    faults: Sequence[Fault],
    *,
    row: Callable[[Run], dict[str, Any]] = fault_row,
    workers: int | Workers = 1,
    **watch: Unpack[WorkCallbacks],
) -> pd.DataFrame:
    """Simulate an experiment once for each fault, which replaces faults of its own; return a row for each.

    ``row``: function that summarises a run. Other arguments and errors are those of
    :func:`twin_gait.studies.batch.run_episodes`; a run that cannot be simulated is a ParameterError. If the
    work was stopped, only the rows of the first faults are returned.
    """
    experiment_of = partial(_with_fault, experiment)
    rows = run_episodes(
        experiment_of,
        row,
        faults,
        workers=workers,
        episode_name=lambda index: f"fault {faults[index]}",
        **watch,
    )
    return pd.DataFrame(rows)


def _with_fault(experiment: Experiment, fault: Fault) -> Experiment:
    return replace(experiment, faults=(fault,))


def outcome_table(table: pd.DataFrame) -> pd.DataFrame:
    """Count outcomes and times of detection by kind of fault, and for all kinds: texts and counts.

    Detection is the time from the fault to the trip: a frozen encoder on a joint at rest is not yet
    dangerous, and is detected when the joint moves. A run without a request to walk that nothing ended is
    *completed*.
    """
    every = pd.concat([table, table.assign(kind="all")])
    outcomes = list(dict.fromkeys([*map(str, OUTCOMES), *sorted(table["outcome"])]))
    counts = pd.crosstab(every["kind"], every["outcome"]).reindex(columns=outcomes, fill_value=0)
    noticed = every[every["detection_s"].notna()].groupby("kind")
    causes = noticed["cause"].agg(
        lambda found: ", ".join(f"{k} {n}" for k, n in found.value_counts().items())
    )
    late = {"detection: median": noticed["detection_s"].median(), "longest": noticed["detection_s"].max()}
    texts = {name: (1e3 * times).map("{:.0f} ms".format) for name, times in late.items()}
    counts.insert(0, "runs", counts.sum(axis=1))
    rows = counts.astype(object).assign(**{"detected by": causes, **texts}).astype(object).fillna("–")
    order = [str(kind) for kind in FaultKind if kind in rows.index]
    return rows.loc[[*order, "all"]].rename_axis("fault").reset_index()
