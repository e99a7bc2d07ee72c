"""Strides of a live walk by condition, the time between two changes of its parameters."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from twin_gait.experiment.events import Change
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import TICK
from twin_gait.measures import strides
from twin_gait.measures.leg_record import LegRecord
from twin_gait.measures.switching import span_sums
from twin_gait.report.reference import reference_cycle
from twin_gait.runs.leg_summary import MeasuredLeg
from twin_gait.simulation.run import Run
from twin_gait.simulation.settings import apply_changes, first_settings
from twin_gait.studies.compare.measures import device_torque


class Condition(NamedTuple):
    """Part of a walk with constant parameters."""

    start: int  # first tick
    end: int  # tick after the last one
    experiment: Experiment  # experiment with the parameters of this condition


def conditions_of(run: Run) -> list[Condition]:
    """Return the conditions of a walk in their order, up to a trip.

    A change at the start of the walk belongs to the first condition.
    """
    last = len(run.columns) if run.trip is None else run.trip.tick
    changes = [event for event in run.experiment.events if isinstance(event, Change) and event.tick < last]
    starts = sorted({0, *(event.tick for event in changes)})
    settings, found = first_settings(run.experiment), []
    for start, end in zip(starts, [*starts[1:], last], strict=True):
        for event in (item for item in changes if item.tick == start):
            settings = apply_changes(settings, event.changes)
        found.append(Condition(start, end, settings.experiment))
    return found


def strides_by_condition(run: Run) -> pd.DataFrame:
    """Return a row for each stride of each leg of a walk, with its condition and measures.

    Columns: ``condition``, counted from 0; ``side``; ``start_s``; ``settled``, which is false for the first
    strides of a condition and for a stride in which the parameters change; then the measures of the stride by
    their keys, NaN if not defined.
    """
    conditions = conditions_of(run)
    rows = [row for record in run.leg_records() for row in _strides_of_leg(run, record, conditions)]
    return pd.DataFrame(rows, columns=None if rows else ["condition", "side", "start_s", "settled"])


def _strides_of_leg(run: Run, record: LegRecord, conditions: list[Condition]) -> Iterator[dict[str, object]]:
    bounds = record.strides(skip=0)
    owners = np.searchsorted([item.start for item in conditions], bounds[:, 0], side="right") - 1
    work = _work_shares(run, record, bounds)
    for index, condition in enumerate(conditions):
        mine = np.flatnonzero(owners == index)
        measures = _measures(run, record, condition, bounds[mine]) | {"wearer_work_share": work[mine]}
        for number, (start, end) in enumerate(bounds[mine].tolist()):
            yield {
                "condition": index,
                "side": str(record.side),
                "start_s": start * TICK,
                "settled": number >= strides.SKIPPED_STRIDES and end <= condition.end,
                **{key: float(values[number]) for key, values in measures.items()},
            }


def _measures(run: Run, record: LegRecord, condition: Condition, bounds: np.ndarray) -> dict[str, np.ndarray]:
    """Compute gait measures of strides of one condition, each of shape ``(n_strides,)``."""
    found = {"stride_time_s": strides.stride_times(bounds, TICK)}
    walking, contacts = condition.experiment.scenario.walking, record.contacts
    if contacts is not None and record.normal_force is not None and walking is not None:
        found["swing_share"] = strides.swing_shares(bounds, contacts.toe_offs)
        if carried := walking.carried_share * run.body_weight:
            peaks = strides.stride_extremes(record.normal_force, bounds) if len(bounds) else np.zeros((0, 2))
            found["load_peak"] = peaks[:, 1] / carried
    for joint, angles in MeasuredLeg(run, record).reference_joint_angles().items():
        reference = reference_cycle(condition.experiment, joint)
        if joint in record.angles and reference is not None:
            cycles = strides.normalise_strides(angles, bounds)
            errors = [strides.root_mean_square_error(cycle[None, :], reference) for cycle in cycles]
            found[f"{joint}_error_total_deg"] = np.degrees(errors)
    return found


def _work_shares(run: Run, record: LegRecord, bounds: np.ndarray) -> np.ndarray:
    """Compute the share of the wearer in the positive work of wearer and device in each stride."""
    leg, device, wearer = MeasuredLeg(run, record), np.zeros(len(bounds)), np.zeros(len(bounds))
    for joint in record.driven:
        velocity = leg.wearer_joint_velocity(joint)
        armature = run.experiment.plant.actuators[joint].armature
        torque = device_torque(leg.log, f"{record.side}_{joint}", armature)
        device += TICK * span_sums(np.maximum(torque * velocity, 0.0), bounds)
        voluntary = leg.column(joint, "voluntary_torque_Nm")
        wearer += TICK * span_sums(np.maximum(voluntary * velocity, 0.0), bounds)
    total = device + wearer
    share = np.full(len(bounds), np.nan)
    np.divide(wearer, total, out=share, where=total > 0.0)
    return share
