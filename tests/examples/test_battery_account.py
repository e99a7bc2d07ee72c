"""The account of the battery power adds up to the power of the log, and reacts to each loss."""

from __future__ import annotations

import battery_account as page
import numpy as np
import pytest

from twin_gait import Run, load_experiment, simulate


def walk(*settings: str) -> Run:
    return simulate(load_experiment("treadmill_guided", ["duration_s=4", *settings]).experiment)


@pytest.mark.parametrize("regeneration", [0.0, 0.7])
def test_the_terms_add_up_to_the_battery_power(regeneration: float) -> None:
    """Terms are computed from currents, velocities and torques; the power of the log is not among them."""
    run = walk(f"plant.electronics.regeneration={regeneration}")
    terms = page.account(run)
    assert sum(terms.values()) == pytest.approx(run.log["battery_power_W"].mean(), rel=0.01)
    assert all(power > 0.5 for power in terms.values())
    # Without the power that is not stored the account does not close.
    assert sum(terms.values()) - terms["braking power not stored"] < 0.97 * run.log["battery_power_W"].mean()


def test_gears_without_losses_have_none_and_the_work_of_friction_is_that_of_the_engine() -> None:
    """The work of friction is integrated by the engine within a tick, the account uses rows of the log."""
    run = walk(*(f"plant.actuators.{joint}.gear_efficiency=1" for joint in page.JOINTS))
    terms = page.account(run)
    assert terms["gears under load"] == pytest.approx(0.0, abs=1e-9)
    assert terms["friction without load"] == pytest.approx(
        -run.log["friction_work_J"].iloc[-1] / run.duration, rel=0.02
    )


def test_power_that_motors_pass_on_is_at_most_that_of_the_brakes() -> None:
    found = page.exchange(walk())
    assert 0.0 < found["passed_on_W"] <= min(found["driving_W"], found["braking_W"])
    table = load_experiment("treadmill_guided").experiment
    halved = page.each_phase(table, "friction_compensation_gain", 0.5)
    assert len(halved) == 10
    gain = table.table.phases["late_stance"].joints["hip"].friction_compensation_gain
    assert np.isclose(halved["table.phases.late_stance.hip.friction_compensation_gain"], 0.5 * gain)
