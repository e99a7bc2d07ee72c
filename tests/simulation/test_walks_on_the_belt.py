"""What feet and belt do to each other in walks that are simulated."""

from __future__ import annotations

import numpy as np
import pytest

from twin_gait import load_experiment, simulate
from twin_gait.measures.strides import stride_times
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import Side


def walk(*settings: str) -> Run:
    return simulate(load_experiment("treadmill_guided", settings).experiment)


@pytest.mark.parametrize(("share", "speed"), [(0.6, 1.5), (0.75, 1.5), (0.9, 0.8)])
def test_bouncing_foot_strikes_once_per_stride(share: float, speed: float) -> None:
    """With nine tenths of the weight gone a foot may land, be off for 0.25 s and more, and land again."""
    run = walk(f"scenario.support.share={share}", f"scenario.belt_speed_km_per_h={speed}")
    for record in run.leg_records():
        assert record.contacts is not None
        strikes = record.contacts.heel_strikes
        assert len(strikes) >= 5
        # The first entry may be the start, on the belt, and a foot may land after the last one and the end.
        assert (np.diff(np.searchsorted(strikes, record.first_phase_entries[1:])) == 1).all()
        assert stride_times(record.strides(), record.tick) == pytest.approx(
            np.mean(stride_times(record.strides_by_phase(), record.tick)), rel=0.03
        )


def test_belt_and_guide_forces_balance_over_whole_strides() -> None:
    """The momentum of a steady walk is the same at the end of a stride as at its start, but for a trifle."""
    run = walk()
    power, legs, walkway = run.walk_power(), run.walk_measures(), run.walkway
    assert power is not None and walkway is not None
    feet = sum(leg["fore_aft_force_N"] for leg in legs.values())
    assert power["guide_force_N"] == pytest.approx(-feet, abs=2e-4 * walkway.carried_weight)
    assert power["belt_W"] == pytest.approx(-feet * run.experiment.scenario.belt_speed)
    load = sum(run.leg_record(side).normal_force for side in run.sides)
    span = slice(*run.leg_record(Side.LEFT).strides()[[0, -1], [0, 1]])
    assert load[span].mean() == pytest.approx(walkway.carried_weight, rel=1e-3)
