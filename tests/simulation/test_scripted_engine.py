"""Events of an experiment: when they act, what they change, and where they are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from errors import raises

from twin_gait import load_experiment, load_run, simulate
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware.exoskeleton_unit import engine_without_bus
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.simulator import create_engine, simulate_blocks

KEYS = ("early_stance", "middle_stance", "late_stance", "swing_flexion", "swing_extension")
STIFFER = ", ".join(f"table.phases.{name}.knee.stiffness_Nm_per_rad: 110" for name in KEYS)


def bench(events: str, *settings: str) -> Experiment:
    return load_experiment("bench_leg", ["duration_s=1.2", f"events={events}", *settings]).experiment


def test_a_change_fades_in_by_the_minimum_jerk_law_from_its_tick_on_and_nothing_changes_before():
    plain = simulate(bench("[]"))
    run = simulate(bench(f"[{{time_s: 0.95, set: {{{STIFFER}}}, fade_ms: 200}}]"))
    assert run.log[:950].equals(plain.log[:950])
    stiffness = run.log["right_knee_stiffness_Nm_per_rad"].to_numpy()
    s = np.clip((np.arange(950, 1200) - 950 + 1) / 200, 0.0, 1.0)  # Flash and Hogan (1985), written out anew
    share = 10 * s**3 - 15 * s**4 + 6 * s**5
    before = stiffness[949]
    same = (run.log["right_phase"] == run.log["right_phase"].iloc[949]).to_numpy()[950:]
    np.testing.assert_allclose(stiffness[950:][same], (before + share * (110 - before))[same], rtol=1e-12)
    assert same[:100].all() and stiffness[-1] == pytest.approx(110)


def test_a_push_and_a_stop_act_in_their_ticks():
    push = "{time_s: 0.305, push: {joint: right_knee, torque_Nm: 7.5, duration_ms: 123}}"
    run = simulate(bench(f"[{push}, {{time_s: 0.9, stop: true}}]"))
    pushed = np.flatnonzero(run.log["right_knee_external_torque_Nm"])
    assert pushed.tolist() == list(range(305, 428))
    assert run.trip is not None and (run.trip.tick, run.trip.location) == (900, "operator")
    assert np.flatnonzero(run.log["safety_state"])[0] == 900


def test_a_set_at_the_start_without_a_fade_walks_as_an_experiment_with_those_values():
    table = [f"table.phases.{name}.knee.stiffness_Nm_per_rad=110" for name in KEYS]
    direct = simulate(bench("[]", *table))
    run = simulate(bench(f"[{{time_s: 0, set: {{{STIFFER}}}, fade_ms: 0}}]"))
    assert run.log.equals(direct.log) and run.switches == direct.switches


def test_together_and_from_the_folder_it_is_the_same_run(tmp_path):
    experiment = bench(f"[{{time_s: 0.4, set: {{{STIFFER}}}}}, {{time_s: 0.8, stop: true, by: Ann}}]")
    run = simulate(experiment)
    for _, other in simulate_blocks([experiment, bench("[]"), experiment]):
        assert other.log.equals(run.log) == bool(other.experiment.events)
    run.save(tmp_path / "run")
    stored = load_run(tmp_path / "run")
    assert stored.experiment.events == experiment.events
    assert simulate(stored.experiment).log.equals(stored.log)


def test_without_events_the_engine_is_the_compiled_one():
    assert type(create_engine(build_setup(bench("[]")))) is CompiledEngine


def test_the_reference_engine_and_the_firmware_refuse_events_in_one_line():
    experiment = bench("[{time_s: 0.8, stop: true}]")
    with raises(ParameterError, "events", "--set events=[]") as error:
        simulate(bench("[{time_s: 0.8, stop: true}]", "engine=pinocchio"))
    assert "\n" not in str(error.value)
    with raises(ParameterError, "events"):
        engine_without_bus(experiment)


def test_events_after_the_end_and_changes_that_cannot_be_made_are_errors():
    with raises(ParameterError, "0.5 s", "0.8"):
        replace(bench("[{time_s: 0.8, stop: true}]"), duration=0.5)
