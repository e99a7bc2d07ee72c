"""Seeded runaways of a joint's command, alone and with a second fault, and random walks without a fault."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from injected_faults.deviation import largest_deviation
from matplotlib.figure import Figure

from twin_gait import Experiment, Run
from twin_gait.palette import BLUE, EVENT_COLOUR, GREY
from twin_gait.studies.batch import override_experiment
from twin_gait.studies.fault_campaign import draw_faults
from twin_gait.worlds.faults import Fault, FaultKind

RATES = (5.0, 2000.0)  # [N·m/s]: a third of the bound in a stride, and the torque limit in 30 ms
REST = 4.0  # [s] that a run lasts at least after the last runaway begins
APART = 0.5  # [s] between a runaway and a second fault, at most and either way
UNBOUNDED = 1e3  # [N·m]: the largest bound; a command trips as implausible at 300 N·m, long before
WITHOUT = {"control.safety.command_deviation_Nm": UNBOUNDED}


def draw_runaways(
    experiment: Experiment, count: int, seed: int, first_time: float
) -> list[tuple[Fault, ...]]:
    """Draw runaways, every second of them with a second fault.

    Sides, joints and signs are uniform, rates log-uniform, times uniform from ``first_time`` in [s] until the
    rest of the run. Kinds of second faults take turns, so that each is drawn equally often.
    """
    generator = np.random.default_rng(seed)
    seconds = draw_faults(experiment, count, seed)
    drawn: list[tuple[Fault, ...]] = []
    for index in range(count):
        rate = math.exp(generator.uniform(*map(math.log, RATES))) * generator.choice([-1.0, 1.0])
        side, joint = generator.choice(list(experiment.leg.legs)), generator.choice(experiment.joints)
        time = generator.uniform(first_time, experiment.duration - REST)
        runaway = Fault(
            kind=FaultKind.CONTROLLER_RUNAWAY,
            time=round(float(time), 3),
            location=f"{side}_{joint}",
            magnitude=round(float(rate), 2),
        )
        other, second = generator.uniform(-APART, APART), seconds[index // 2]
        size = None if second.magnitude is None else float(f"{second.magnitude:.4g}")
        second = replace(second, time=round(runaway.time + float(other), 3), magnitude=size)
        drawn.append((runaway, second) if index % 2 else (runaway,))
    return drawn


def with_faults(experiment: Experiment, faults: Sequence[Fault]) -> Experiment:
    """Return the experiment with these faults."""
    return replace(experiment, faults=tuple(faults))


def runaway_row(run: Run) -> dict[str, Any]:
    """Return the outcome of a run with a runaway."""
    runaway, trip = run.experiment.faults[0], run.trip
    return {
        "faults": " ".join(map(str, run.experiment.faults)),
        "joint": str(runaway.joint),
        "rate_Nm_per_s": runaway.magnitude_or_default,
        "time_s": runaway.time,
        "second": ", ".join(str(item.kind) for item in run.experiment.faults[1:]),
        "outcome": str(run.verdict.outcome or run.status),
        "cause": "" if trip is None else str(trip.cause),
        "trip_time_s": math.nan if trip is None else trip.time,
        "end_s": run.duration,
    }


def draw_walkers(count: int, seed: int) -> list[dict[str, Any]]:
    """Draw changes of an experiment: another wearer, belt, support, drive, sensors, blending and delay."""
    generator = np.random.default_rng(seed)
    drawn = []
    for index in range(count):
        ratio = generator.uniform(0.25, 1.0)
        changes: dict[str, Any] = {
            "patient.mass_kg": generator.uniform(50.0, 105.0),
            "patient.height_m": generator.uniform(1.55, 1.95),
            "scenario.belt_speed_km_per_h": generator.uniform(0.8, 2.2),
            "scenario.support.share": generator.uniform(0.3, 0.75),
            "plant.friction_ratio": {"hip": ratio, "knee": ratio},
            "table.blending.duration_ms": int(generator.integers(60, 201)),
            "control.delay_ms": int(generator.integers(0, 3)),
            "seed": index,
        }
        if index % 4:  # real encoders, two thirds of them with noise beside their counts
            noise = math.exp(generator.uniform(math.log(1e-6), math.log(1e-4))) if index % 4 > 1 else 0.0
            changes |= {"sensors.ideal": False, "sensors.angle_noise_rad": noise}
        drawn.append(changes)
    return drawn


def walker_of(experiment: Experiment, changes: dict[str, Any]) -> Experiment:
    """Return the experiment with some changes, and without the bound on the deviation."""
    return override_experiment(experiment, {**changes, **WITHOUT})


def walker_row(run: Run) -> dict[str, Any]:
    """Return the outcome of a walk without a fault, and the largest deviation of its commands."""
    return {
        "outcome": str(run.verdict.outcome or run.status),
        "cause": "" if run.trip is None else str(run.trip.cause),
        "deviation_Nm": largest_deviation(run),
    }


def draw_runaway_map(without: pd.DataFrame, table: pd.DataFrame) -> Figure:
    """Draw rate, end and outcome of each runaway, without and with the bound on the deviation."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    kinds = {"held": BLUE, "others": GREY, "fell": EVENT_COLOUR}
    for axes, (title, rows) in zip(panels, {"without": without, "with": table}.items(), strict=True):
        outcomes = rows["outcome"].where(rows["outcome"].isin(["held", "fell"]), "others")
        ends = rows["trip_time_s"].fillna(rows["end_s"]) - rows["time_s"]
        for outcome, colour in kinds.items():
            chosen = (outcomes == outcome) & (ends > 0.0)
            size = 10 if outcome == "fell" else 4
            rates = rows["rate_Nm_per_s"].abs()[chosen]
            axes.plot(rates, ends[chosen], ".", color=colour, markersize=size, label=outcome)
        axes.set(xscale="log", yscale="log", xlabel="rate of the runaway [N·m/s]")
        axes.set_title(f"{title} the bound on the deviation", loc="left")
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("time to the trip, or to the end [s]")
    panels[0].legend(frameon=False)
    return figure
