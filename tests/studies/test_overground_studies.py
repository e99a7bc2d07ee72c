"""Studies of many runs on the floor: there is no belt, and a walk may lean on crutches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from log_rows import log_matrix

from twin_gait import load_experiment, simulate
from twin_gait.gait.table import TICK
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.lane_engine import MIN_BLOCK_SIZE, LaneEngine
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.studies.batch import simulate_batch
from twin_gait.studies.compare.comparison import compare, draw_sample, find_controllers
from twin_gait.studies.sweep.spec import sweep_from_mapping
from twin_gait.studies.sweep.sweep import run_sweep
from twin_gait.studies.tune.objective import rate_walk, term_costs
from twin_gait.studies.tune.walks import build_cases


def floor(*settings: str):
    return load_experiment("overground", list(settings)).experiment


def way_of(run) -> float:
    way = run.log["pelvis_forward_m"].to_numpy()
    return float(way[-1] - way[0])


def test_no_case_of_a_tuning_changes_a_missing_belt():
    experiment = floor()
    assert not [name for name in build_cases(experiment, "robust") if "belt" in name]
    assert draw_sample(experiment, 1).scenario == experiment.scenario


def test_a_walk_with_crutches_is_also_rated_by_distance_and_crutch_load():
    run = simulate(floor("duration_s=8"))
    rated = rate_walk(run)
    lacking = 0.3 * 8.0 - way_of(run)
    assert rated.values["slowness_pct"] == pytest.approx(max(0.0, 100.0 * lacking / (0.3 * 8.0)))
    impulses = [run.log[f"{side}_crutch_normal_force_N"].sum() * 1e-3 for side in run.sides]
    share = max(impulses) / run.duration / run.body_weight
    assert rated.values["crutch_load_pct"] == pytest.approx(100.0 * share)
    assert 0.5 * (10.0 * share) ** 2 == pytest.approx(
        term_costs(rated.values, rated.joints)["crutch_load_pct"]
    )


def test_a_sweep_with_operating_modes_has_the_values_of_each_run_summary(tmp_path):
    rising = load_experiment("sit_to_stand", ["duration_s=1"]).experiment
    row = simulate_batch(rising, [{}]).iloc[0]
    whole = summarise_run(simulate(rising))
    assert (row["status"], row["outcome"]) == (whole["status"], whole["outcome"]) == ("completed", None)
    assert row["left_strides"] == whole["sides"]["left"]["strides"] == 0
    document = {
        "name": "rising", "experiment": "sit_to_stand", "settings": {"duration_s": 1},
        "method": "list", "episodes": [{"patient.mass_kg": 70}, {"patient.mass_kg": 72}],
    }  # fmt: skip
    swept = run_sweep(
        sweep_from_mapping(document, "rising.yaml", tmp_path), tmp_path / "swept", pictures=False
    )
    assert swept.summary["outcomes"] == {"completed": 2}


@pytest.mark.slow  # half a minute of walking, in a loop of its own for every controller
def test_controllers_are_compared_overground():
    found = compare(floor("duration_s=12"), find_controllers(["table", "gravity"]))
    table, gravity = (found.table[found.table["controller"] == name].iloc[0] for name in ("table", "gravity"))
    assert table["walked"] == 1.0 and gravity["walked"] == 0.0 and gravity["walked_s"] < 4.0
    energy = table["battery_power_W"] * (12.0 - TICK)  # from the first row to the last, as the way is
    assert table["energy_per_metre_J"] == pytest.approx(energy / way_of(found.runs["table"]))
    assert 0.5 < table["stride_length_m"] < 1.0


@pytest.mark.slow  # compiles the loop of the lanes
def test_in_lockstep_each_overground_walk_equals_its_single_run():
    given = [
        floor(f"patient.mass_kg={60 + 2 * number}", "duration_s=1.5") for number in range(MIN_BLOCK_SIZE)
    ]
    # One that falls leaves its lane early.
    given[1] = replace(given[1], scenario=replace(given[1].scenario, fall_lean=0.25))
    lanes = LaneEngine([CompiledEngine(build_setup(item)) for item in given]).run()
    for item, other in zip(given, lanes, strict=True):
        alone = CompiledEngine(build_setup(item)).run()
        assert alone.switches == other.switches and alone.status is other.status
        np.testing.assert_array_equal(log_matrix(alone), log_matrix(other))
    assert len({item.status for item in lanes}) == 2
