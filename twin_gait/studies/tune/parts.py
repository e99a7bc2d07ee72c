r"""What a walk is rated by: named parts, each with a goal and a weight, all from the numbers of the summary.

Every part is the smaller the better, and the larger of the two legs counts. A walk costs

.. math::

    J = \min\Bigl(J_{worst}, \sum_i w_i (x_i / g_i)^2\Bigr)

with value x, goal g and weight w of each part. A fall after a share s of the time costs
:math:`J_{worst} + (J_{fall} - J_{worst})(1 - s)`, more than any walk, and the less the later it comes.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from twin_gait.experiment import Experiment
from twin_gait.files import finite_or_none
from twin_gait.measures.effort import root_mean_square
from twin_gait.measures.leg_record import LegRecord, wearer_column
from twin_gait.measures.strides import (
    SKIPPED_STRIDES,
    error_parts,
    normalise_strides,
    root_mean_square_error,
    symmetry_index,
)
from twin_gait.measures.walk import WalkMeasures
from twin_gait.report.reference import reference_cycle, reference_measures
from twin_gait.runs.leg_summary import by_contact, joint_motion, joint_saturation, torque_at_switches
from twin_gait.simulation import Run, RunStatus
from twin_gait.vocabulary import JointName, PelvisGuide
from twin_gait.worlds.scenario import BELT_SPEED

WORST = 60.0  # cost of the worst walk that does not fall
FALL = 150.0  # cost of a fall at the start
# Without the excess the search trades one goal for the other; the tool is held to those of the errors.
HELD_TO, EXCESS = 20.0, 6.0  # weights
AIM = 0.9  # share of a goal beyond which the excess counts: a little better than asked for
NEEDED_CLEARANCE = 15.0  # [mm]; how far the toe stays below it is a part


@dataclass(frozen=True)
class Part:
    """One part of the objective."""

    name: str  # key in files
    title: str  # for people
    unit: str  # for people
    goal: float  # value that costs just the weight
    weight: float  # w, see the module
    excess: float = EXCESS  # weight e of what it lacks to its goal, see nominal_cost


SAMPLES_APART = 5  # [%] of a stride: of the deviations that the search learns from
ERROR_GOALS = {JointName.HIP: 4.0, JointName.KNEE: 6.5, JointName.ANKLE: 7.0}
_OTHERS, _FREE = (
    tuple(Part(name, **row) for name, row in rows.items())
    for rows in yaml.safe_load(Path(__file__).with_name("parts.yaml").read_text(encoding="utf-8")).values()
)


@lru_cache(maxsize=16)
def errors_of(joints: tuple[str, ...]) -> tuple[Part, ...]:
    """The errors of the joints that a table drives, in its order."""
    return tuple(
        Part(f"{joint}_error_deg", f"{joint} error", "°", ERROR_GOALS[JointName(joint)], 1.0, HELD_TO)
        for joint in joints
    )


@lru_cache(maxsize=16)
def parts_of(joints: tuple[str, ...]) -> tuple[Part, ...]:
    """What a table for these joints is rated by; an ankle that it does not drive counts a little."""
    ankle = Part("ankle_error_deg", "ankle error", "°", ERROR_GOALS[JointName.ANKLE], 0.25)
    carried = () if JointName.ANKLE in joints else (ankle,)
    offset = Part("offset_deg", "offset of a joint", "°", goal=2.5, weight=0.25)
    return (*errors_of(joints), offset, *carried, *_OTHERS)


def rated_parts(values: Mapping[str, float | None], joints: tuple[str, ...]) -> tuple[Part, ...]:
    """What a walk with these values is rated by."""
    return (*parts_of(joints), *(part for part in _FREE if part.name in values))


def part_values(run: Run, reference_speed: float | None = None) -> dict[str, float | None]:
    """Value of each part of a walk against a reference in [m] / [s]; None where it has too few strides."""
    legs = run.leg_records()
    sides = [_leg(run, leg) for leg in legs]
    joints = [joint for side in sides for joint in side["joints"].values()]
    walks = list(run.walk_measures().values())
    least = [side["toe_clearance_least_m"] for side in sides]
    # Contacts of a foot that has just landed; further contacts in swing are scuffs.
    bounces = [(side["further_contacts"] - side["scuffs"], side["strides"]) for side in sides]
    return {
        **{
            f"{joint}_error_deg": _off_reference(run, legs, joint, reference_speed, root_mean_square_error)
            for joint in (*legs[0].angles, JointName.ANKLE)  # driven or not
        },
        "offset_deg": _largest(
            _off_reference(run, legs, joint, reference_speed, lambda *item: abs(error_parts(*item).offset))
            for joint in legs[0].angles
        ),
        **_of_walk(run, walks, reference_speed),
        "stride_variation_pct": _percent(_largest(side["stride_time_variation"] for side in sides)),
        "second_contacts_per_stride": _per_stride(bounces),
        "scuffs_per_stride": _per_stride([(side["scuffs"], side["strides"]) for side in sides]),
        "saturated_pct": _percent(_largest(joint["saturated_share"] for joint in joints)),
        "torque_change_Nm": _largest(joint["switch_torque_change_Nm"] for joint in joints),
        "torque_jump_Nm": _largest(joint["switch_torque_jump_Nm"] for joint in joints),
        "clearance_lack_mm": None
        if None in least
        else max(0.0, NEEDED_CLEARANCE - 1e3 * float(np.min(least))),
        "asymmetry_pct": _percent(_asymmetry(sides)),
        **_of_free_trunk(run),
    }


def _of_free_trunk(run: Run) -> dict[str, float | None]:
    """Way and crutches; nothing where the pelvis is guided."""
    walking = run.experiment.scenario.walking
    if walking is None or run.experiment.scenario.pelvis is not PelvisGuide.FREE:
        return {}
    way = run.log["pelvis_forward_m"]
    speed = float(way.iloc[-1] - way.iloc[0]) / run.duration
    loads = (run.log.get(f"{side}_crutch_normal_force_N") for side in run.sides)
    shares = [float(load.mean()) / run.body_weight for load in loads if load is not None]
    return {
        "slowness_pct": _lack(100.0 * (1.0 - speed / walking.speed)),
        "crutch_load_pct": _percent(max(shares, default=0.0)),
    }


def _of_walk(
    run: Run, walks: Sequence[WalkMeasures], reference_speed: float | None
) -> dict[str, float | None]:
    """Parts of the ground's forces, the knee under them, and cadence; the worse leg."""
    assert run.walkway is not None  # a walk to be tuned is on a belt
    healthy = reference_measures(_as_referred(run, reference_speed))

    def worst(lack: Callable[[WalkMeasures], float]) -> float | None:
        """Largest lack of a leg, none below zero; None without a reference."""
        return _largest(_lack(lack(walk)) for walk in walks) if healthy else None

    push = sum(walk.fore_aft_force for walk in walks) / run.walkway.carried_weight
    return {
        "knee_at_contact_deg": worst(lambda walk: math.degrees(walk.knee_at_contact)),
        "yield_lack_deg": worst(lambda walk: math.degrees(healthy["knee_yield"] - walk.knee_yield)),
        "stride_time_error_pct": worst(
            lambda walk: 100.0 * abs(walk.stride_time / healthy["stride_time"] - 1.0)
        ),
        "load_peak_pct": worst(lambda walk: 100.0 * (walk.load_peak - 1.0)),
        "trough_pct": worst(lambda walk: 100.0 * (1.0 - walk.trough)),
        "slow_loading_pct": worst(lambda walk: 100.0 * (1.0 - walk.least_load)),
        "fore_aft_pct": _lack(100.0 * abs(push)),
        "propulsion_lack_pct": worst(
            lambda walk: 100.0 * (1.0 - walk.propulsion_peak / healthy["propulsion_peak"])
        ),
    }


def _lack(value: float) -> float | None:
    """A value, 0 if it is negative, None if it is not defined."""
    return None if math.isnan(value) else max(0.0, value)


def _leg(run: Run, leg: LegRecord) -> dict[str, Any]:
    """Those numbers of the summary of a leg that the parts are made of; None for what is not defined."""

    def defined(*numbers: Mapping[str, float]) -> dict[str, Any]:
        return {name: finite_or_none(value) for item in numbers for name, value in item.items()}

    joints = {
        joint: defined(
            joint_motion(leg, joint, SKIPPED_STRIDES),
            joint_saturation(run, leg, joint),
            torque_at_switches(run, leg, joint, SKIPPED_STRIDES),
        )
        for joint in leg.angles
    }
    return {**defined(by_contact(run, leg, SKIPPED_STRIDES)), "joints": joints}


class Rating(NamedTuple):
    """What a walk is worth: plain values only, which any process can send."""

    cost: float  # see the module
    values: dict[str, float | None]  # of the parts
    fell: bool  # whether it ended in a fall, a trip of the safety monitor or diverged
    lasted: float  # share of the time
    # of the mean strides from the reference, over goals; their squares add up to about those of the errors,
    # halved by the legs. Empty if a leg made no stride
    deviations: tuple[float, ...] = ()
    torque: float = math.nan  # root mean square over all motors in [N m], whose square heats their windings
    joints: tuple[str, ...] = (JointName.HIP, JointName.KNEE)  # that its table drives

    @property
    def parts(self) -> tuple[Part, ...]:
        """What it is rated by."""
        return rated_parts(self.values, self.joints)


def rate_walk(run: Run, reference_speed: float | None = None) -> Rating:
    """Rate a walk on the treadmill as tuning does: its cost, the parts that it is the sum of, and more.

    The reference walks at ``reference_speed`` in [m] / [s], or at that of the belt.
    """
    values, joints = part_values(run, reference_speed), tuple(run.table.joints)
    fell = run.trip is not None or run.status in (RunStatus.FELL, RunStatus.DIVERGED)
    end = run.duration if run.trip is None else run.trip.time
    lasted = min(1.0, end / run.experiment.duration)
    torques = run.log.filter(regex="_motor_torque_Nm$").to_numpy().ravel()
    cost, deviations = walk_cost(values, lasted, fell, joints), _deviations(run, reference_speed)
    return Rating(cost, values, fell, lasted, deviations, root_mean_square(torques), joints)


def walk_cost(
    values: Mapping[str, float | None], lasted: float, fell: bool, joints: tuple[str, ...]
) -> float:
    """Cost of a walk with these values that lasted for a share of the time.

    A walk whose errors are not defined because it hardly made a stride costs ``WORST``, any other part that
    is not defined its weight.
    """
    if fell:
        return WORST + (FALL - WORST) * (1.0 - lasted)
    if any(values[part.name] is None for part in errors_of(joints)):
        return WORST
    return min(WORST, sum(part_costs(values, joints).values()))


def part_costs(values: Mapping[str, float | None], joints: tuple[str, ...]) -> dict[str, float]:
    """Cost of each part; its weight where it is not defined."""
    costs = {}
    for part in rated_parts(values, joints):
        value = values[part.name]
        ratio = 1.0 if value is None else value / part.goal
        costs[part.name] = part.weight * ratio * ratio
    return costs


def nominal_cost(walk: Rating) -> float:
    r"""Cost of the walk that a table is tuned for, in which a goal that is missed costs more.

    .. math::

        J + \sum_i e_i \max(0, x_i / g_i - 0.9)^2

    Above half of ``WORST`` it bends so that it stays below that: a fall costs more than any walk, and of two
    bad walks the worse costs more.
    """
    if walk.fell or not walk.deviations:
        return walk.cost
    total = walk.cost + sum(lack * lack for lack in _lacks(walk))
    half = 0.5 * WORST
    return total if total <= half else WORST - half * half / total


def residuals(walk: Rating) -> np.ndarray | None:
    """Numbers whose squares add up to about the :func:`nominal_cost` of a walk; None of one that fell.

    The errors are told sample by sample, and so more than by a number for each joint.
    """
    if walk.fell or not walk.deviations:
        return None
    costs = part_costs(walk.values, walk.joints)
    others = [math.sqrt(costs[part.name]) for part in walk.parts[len(walk.joints) :]]
    return np.array([*walk.deviations, *others, *_lacks(walk)])


def _lacks(walk: Rating) -> list[float]:
    """Roots of what each part costs beyond ``AIM`` of its goal; 0 of one that is not defined."""
    ratios = ((walk.values[part.name] or 0.0) / part.goal for part in walk.parts)
    return [
        math.sqrt(part.excess) * max(0.0, ratio - AIM) for part, ratio in zip(walk.parts, ratios, strict=True)
    ]


def _deviations(run: Run, reference_speed: float | None) -> tuple[float, ...]:
    """Mean strides less the reference over goal, every 5 %, with squares that add up to 1 at the goals."""
    legs = run.leg_records()
    found: list[float] = []
    for leg in legs:
        for joint, angles in leg.angles.items():
            cycles = normalise_strides(angles, leg.strides())
            reference = _reference(run, joint, reference_speed)
            if not len(cycles) or reference is None:
                return ()
            apart = np.degrees(cycles.mean(axis=0) - reference)[:-1:SAMPLES_APART]
            found += (apart / (ERROR_GOALS[joint] * math.sqrt(len(legs) * len(apart)))).tolist()
    return tuple(found)


def _as_referred(run: Run, reference_speed: float | None) -> Experiment:
    """The experiment, on a belt at the speed of the reference walk if one is given."""
    experiment = run.experiment
    if reference_speed is None:
        return experiment
    return replace(experiment, scenario=experiment.scenario.adjusted(BELT_SPEED, reference_speed))


def _reference(run: Run, joint: JointName, reference_speed: float | None) -> np.ndarray | None:
    """Reference angles in [rad] at ``PERCENT``; those of the summary unless a speed is given."""
    return reference_cycle(_as_referred(run, reference_speed), joint)


def _off_reference(
    run: Run,
    legs: Sequence[LegRecord],
    joint: JointName,
    reference_speed: float | None,
    measure: Callable[[np.ndarray, np.ndarray], float],
) -> float | None:
    """Measure of the strides, from foot contact to foot contact, and the reference in [deg], larger leg."""
    reference = _reference(run, joint, reference_speed)
    found: list[float | None] = []
    for leg in legs:
        angles = leg.angles.get(joint)
        if joint is JointName.ANKLE:  # the wearer's, which a brace may move against the device
            column = wearer_column(run.log.columns, leg.side, joint, "angle_rad")
            angles = run.log[column].to_numpy() if column in run.log else None
        if reference is None or angles is None:
            return None
        off = measure(normalise_strides(angles, leg.strides()), reference)
        found.append(finite_or_none(math.degrees(off)))
    return _largest(found)


def _largest(values: Iterable[float | None]) -> float | None:
    """Largest value; None if there is none, or one is not defined."""
    listed = list(values)
    if not listed or any(value is None for value in listed):
        return None
    return max(float(value) for value in listed if value is not None)


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def _per_stride(counted: Iterable[tuple[int, int]]) -> float | None:
    return _largest(count / strides if strides else None for count, strides in counted)


def _asymmetry(sides: Sequence[Mapping[str, Any]]) -> float | None:
    """Largest symmetry index, without its sign, of the share of swing and the ranges of the joints."""
    pairs = [[side["swing_share"] for side in sides]]
    for joint in sides[0]["joints"]:
        pairs.append([side["joints"][joint]["range_of_motion_deg"] for side in sides])
    return _largest(None if None in pair else abs(symmetry_index(*pair)) for pair in pairs)
