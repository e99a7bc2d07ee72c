"""What feet and belt do to each other in walks that are simulated."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin_gait import load_experiment, simulate
from twin_gait.measures.strides import error_parts, normalise_strides, stride_times
from twin_gait.report.reference import reference_cycle
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName, Side


def walk(*settings: str) -> Run:
    return simulate(load_experiment("treadmill", settings).experiment)


def test_heel_that_bounces_for_a_fifth_of_the_stride_strikes_once() -> None:
    """With nine tenths of the weight gone the foot lands, is off for 0.25 s and more, and lands again."""
    record = walk("scenario.support.share=0.9", "scenario.belt_speed_km_per_h=0.8").leg_record(Side.LEFT)
    contacts = record.contacts
    assert contacts is not None and record.loaded is not None
    times = stride_times(record.strides(), record.tick)
    assert len(times) >= 3
    assert times == pytest.approx(times.mean(), rel=0.01)
    rises = np.flatnonzero(record.loaded[1:] & ~record.loaded[:-1]) + 1
    for strike in contacts.heel_strikes[1:-1]:
        bounce = rises[rises > strike][0]
        assert bounce - strike > 250  # ticks, of which the foot touches in less than 200
        assert bounce in contacts.further_contacts
        assert np.mean(record.loaded[strike:bounce]) < 0.5


def test_foot_that_lands_late_has_not_touched_before_and_errs_in_time() -> None:
    """At 75 % of support the foot hangs less than a millimetre over the belt for a tenth of the stride."""
    run = walk("scenario.support.share=0.75")
    record = run.leg_record(Side.LEFT)
    assert record.normal_force is not None and record.clearance is not None
    strides = record.strides()
    for strike in strides[:, 0]:
        before = slice(strike - 900, strike - 50)
        assert np.all(record.normal_force[before] == 0.0)
        assert record.clearance[before].min() > 0.0
    parts = {}
    for joint in record.angles:
        reference = reference_cycle(run.experiment, joint)
        assert reference is not None
        parts[joint] = error_parts(normalise_strides(record.angles[joint], strides), reference)
    # Of 15° and 24° most is that the foot lands a fifth of the cycle after the leg has come to rest.
    hip, knee = parts[JointName.HIP], parts[JointName.KNEE]
    assert math.degrees(hip.total) > 12.0 and math.degrees(knee.total) > 20.0
    assert -0.26 < hip.shift < -0.16 and -0.26 < knee.shift < -0.16
    assert hip.timing > 3.0 * hip.shape and knee.timing > 2.0 * knee.shape


def test_belt_pulls_as_much_as_the_guide_pushes_over_whole_strides() -> None:
    """The momentum of a steady walk is the same at the end of a stride as at its start."""
    run = walk()
    power, legs, walkway = run.walk_power(), run.walk_measures(), run.walkway
    assert power is not None and walkway is not None
    feet = sum(leg.fore_aft_force for leg in legs.values())
    assert power.guide_force == pytest.approx(-feet, rel=1e-3)
    assert power.belt == pytest.approx(-feet * walkway.belt_speed)
    load = sum(run.leg_record(side).normal_force for side in run.sides)
    span = slice(*run.leg_record(Side.LEFT).strides()[[0, -1], [0, 1]])
    assert load[span].mean() == pytest.approx(walkway.carried_weight, rel=1e-3)
