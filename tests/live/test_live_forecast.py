"""Tests of the forecast of a change before it is applied, which does not affect the walk."""

import json
from contextlib import closing

import numpy as np
import pytest
from errors import states
from test_live_loop import Rig, say, wait_for

from twin_gait.configuration.experiments import load_experiment
from twin_gait.live.controls import ControlPanel
from twin_gait.live.forecast import HORIZON, predict
from twin_gait.live.session import LiveSession
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.settings import loop_numbers
from twin_gait.simulation.stepping import SteppedRun

# Of the default treadmill walk: each ends it within seconds, and the check has nothing against any of them.
FALLS = [
    ("swing_flexion.knee.equilibrium", 60.0),
    ("swing_flexion.knee.equilibrium", 28.0),
    ("swing_flexion.hip.stiffness", 0.6),
]


@pytest.fixture(scope="module")
def panel():
    return ControlPanel(load_experiment("treadmill_guided", ["duration_s=60"]).experiment)


@pytest.fixture(scope="module")
def walks(panel):
    """Return a walk after eight seconds, and another one for the prediction."""
    walking, ahead = SteppedRun(panel.simulation_setup), SteppedRun(panel.simulation_setup)
    walking.advance(8000)
    return walking, ahead


def changed(panel, *changes):
    settings = panel.preset
    for name, value in changes:
        settings = panel.set(settings, name, value)
    return settings


def moment_of(walk):
    return json.loads(json.dumps(walk.snapshot()))


@pytest.mark.parametrize("change", FALLS)
def test_a_change_that_ends_the_walk_is_predicted_to_the_tick(panel, walks, change):
    walking, ahead = walks
    moment = moment_of(walking)
    forecast = predict(ahead, moment, changed(panel, change))
    assert forecast.bad
    # What really comes, by a walk that is changed indeed.
    real = SteppedRun(panel.simulation_setup)
    real.restore(moment)
    real.set(loop_numbers(changed(panel, change)))
    real.advance(HORIZON)
    if real.trip is not None:
        assert states(forecast.text, "trips", f"{(real.trip.tick - 8000) * 1e-3:.1f} s")
    if real.status is RunStatus.FELL:
        assert states(forecast.text, "falls", f"{(real.tick - 1 - 8000) * 1e-3:.1f} s")
    assert real.trip is not None or real.status is RunStatus.FELL


def test_a_harmless_change_walks_on_with_its_deviation_and_saturation(panel, walks):
    walking, ahead = walks
    forecast = predict(ahead, moment_of(walking), changed(panel, ("late_stance.hip.stiffness", 1.3)))
    assert not forecast.bad and forecast.text.startswith("walks on for the ")
    assert 0.0 < forecast.rmse_deg["hip"] < forecast.rmse_deg["knee"] < 20.0
    assert 0.0 < forecast.saturated_share < 0.2


def test_after_the_end_a_restart_is_predicted_and_a_manual_step_is_awaited(panel, walks):
    walking, ahead = walks
    over = SteppedRun(panel.simulation_setup)
    over.advance(1000)
    over.stop()
    over.advance(500)
    forecast = predict(ahead, moment_of(over), changed(panel))
    assert not forecast.bad and forecast.text.startswith("after a new start walks on")
    by_hand = predict(ahead, moment_of(walking), changed(panel, ("manual", True)))
    assert not by_hand.bad and by_hand.text.startswith("does not fall")


@pytest.mark.slow  # a loop of its own
def test_a_sitting_wearer_without_a_walk_command_does_not_fall():
    panel = ControlPanel(load_experiment("stand_to_sit").experiment)
    walking, ahead = SteppedRun(panel.simulation_setup), SteppedRun(panel.simulation_setup)
    walking.advance(100)
    forecast = predict(ahead, moment_of(walking), changed(panel))
    assert not forecast.bad and states(forecast.text, "does not fall", f"{HORIZON / 1000:.0f} s")


def test_a_forecast_that_is_discarded_leaves_the_log_as_it_would_have_been_bit_for_bit(panel):
    plain = Rig(panel.simulation_setup, [], longest=4000)
    plain.loop.walk()
    script = [(1.0 + 0.3 * n, {"serial": n, "command": "snapshot"}) for n in range(5)]
    with_snapshots = Rig(panel.simulation_setup, script, longest=4000)
    with_snapshots.loop.walk()
    assert all("snapshot" in with_snapshots.answers()[n] for n in range(5))
    ahead = SteppedRun(panel.simulation_setup)
    predict(ahead, with_snapshots.answers()[3]["snapshot"], changed(panel, FALLS[0]))
    np.testing.assert_array_equal(with_snapshots.takes[0].rows, plain.takes[0].rows)
    assert with_snapshots.takes[0].events == ()


@pytest.mark.slow
def test_a_session_forecasts_a_try_without_applying_it(tmp_path):
    loaded = load_experiment("treadmill_guided", ["duration_s=60"])
    with closing(LiveSession(loaded=loaded, folder=tmp_path / "run", pictures=False)) as session:
        session.start()
        name, value = FALLS[0]
        wait_for(lambda: session.walk.frame["tick"])
        response = say(session, kind="try", control=name, value=value)
        assert response.response == "forecast" and response.forecast["bad"] and response.subject == name
        assert response.forecast["text"] in response.text
        assert not any(item.changed for item in session.state().controls)
        unsafe = say(session, kind="try", control="middle_stance.hip.gain", value=0.95)
        assert unsafe.response == "refused" and unsafe.text.startswith("unstable")
        applied = say(session, kind="set", control=name, value=value)
        assert applied.response == "applied"  # it is for the therapist to decide
