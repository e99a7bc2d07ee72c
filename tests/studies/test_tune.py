"""Tuning without walking: the numbers, the cost, screening and search, and going on where it was stopped."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from errors import raises, states
from hypothesis import given
from hypothesis import strategies as st

from twin_gait.cli import studies as command
from twin_gait.configuration.documents import table_document
from twin_gait.configuration.experiments import load_experiment
from twin_gait.configuration.gait_table_file import gait_table_from_mapping, load_gait_table
from twin_gait.exceptions import MissingOptionalDependency, ParameterError, TwinGaitError
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import GaitTable
from twin_gait.parameters.wearer import Patient
from twin_gait.simulation.simulation_setup import scaled_table
from twin_gait.studies.tune import tune as stages
from twin_gait.studies.tune.draws import draw_ranges, draw_worlds
from twin_gait.studies.tune.evolution import Evolution, rank_in_two_rounds
from twin_gait.studies.tune.objective import (
    FALL,
    WORST,
    Rating,
    nominal_cost,
    objective_terms,
    residuals,
    term_costs,
    walk_cost,
)
from twin_gait.studies.tune.result import verdict
from twin_gait.studies.tune.search import (
    FACTORS,
    MAX_GENERATIONS_WITHOUT_GAIN,
    PARTS_OF_STEPS,
    REACH,
    Descent,
    Generation,
)
from twin_gait.studies.tune.space import (
    SETTINGS,
    apply_coordinates,
    editable_document,
    split_sides,
    tunable_parameters,
)
from twin_gait.studies.tune.tune import TuningSettings, tune
from twin_gait.studies.tune.walks import TuningStopped, build_cases, weighted_cost
from twin_gait.vocabulary import Side


@pytest.fixture(scope="module")
def shipped() -> GaitTable:
    return load_gait_table("treadmill_guided")


def _parse(document: Mapping[str, Any]) -> GaitTable:
    return gait_table_from_mapping(dict(document), "the test", "treadmill_guided")


# ---------------------------------------------------------------------- numbers


def test_every_phase_and_joint_has_four_parameters_and_optional_ones_on_request(shipped: GaitTable) -> None:
    bare = tunable_parameters(shipped, thresholds=False, blending=False)
    assert len(bare) == 4 * 5 * 2
    more = {item.name for item in tunable_parameters(shipped)} - {item.name for item in bare}
    text = json.dumps(table_document(shipped)["transitions"])
    angle_guards = text.count("angle_deg <") + text.count("angle_deg >")
    assert len(more) == angle_guards + 1
    assert "blending.duration_ms" in more


def test_the_start_point_gives_the_initial_table(shipped: GaitTable) -> None:
    parameters = tunable_parameters(shipped)
    start = [item.start_coordinate for item in parameters]
    again = _parse(apply_coordinates(editable_document(shipped), parameters, start))
    for phase, values in shipped.phases.items():
        for joint, impedance in values.joints.items():
            found = again.phases[phase].joints[joint]
            assert found.stiffness == pytest.approx(impedance.stiffness, rel=1e-12)
            assert found.equilibrium_angle == pytest.approx(impedance.equilibrium_angle, rel=1e-12)
            assert found.damping_ratio == impedance.damping_ratio
            assert found.friction_compensation_gain == impedance.friction_compensation_gain
    assert again.transitions == shipped.transitions
    assert again.blending == shipped.blending


@given(data=st.data())
def test_another_value_changes_one_number_and_nothing_else(data: st.DataObject) -> None:
    table = load_gait_table("treadmill_guided")
    document = editable_document(table)
    parameter = data.draw(st.sampled_from(tunable_parameters(table)))
    coordinate = data.draw(st.floats(0.0, 1.0))
    before, after = _leaves(document), _leaves(apply_coordinates(document, [parameter], [coordinate]))
    differing = {key for key in before if before[key] != after[key]}
    assert before.keys() == after.keys()
    assert differing <= {parameter.path}
    assert parameter.lower - 1e-9 <= parameter.value(coordinate) <= parameter.upper + 1e-9
    value = after[parameter.path]
    shown = value if parameter.guard is None else str(value).split()[-1]
    assert float(shown) == pytest.approx(parameter.value(coordinate))


def _leaves(node: Any, path: tuple[Any, ...] = ()) -> dict[tuple[Any, ...], Any]:
    if isinstance(node, Mapping):
        return {key: leaf for name in node for key, leaf in _leaves(node[name], (*path, name)).items()}
    if isinstance(node, list):
        return {key: leaf for i, item in enumerate(node) for key, leaf in _leaves(item, (*path, i)).items()}
    return {path: node}


def test_a_separate_side_has_separate_parameters(shipped: GaitTable) -> None:
    document = table_document(shipped)
    document["sides"] = {"left": {"swing_flexion": {"knee": {"equilibrium_rad": 0.9}}}}
    lopsided = _parse(document)
    parameters = tunable_parameters(lopsided, thresholds=False, blending=False)
    assert len(parameters) == 4 * 5 * 2 + 4 * 2
    (own,) = [item for item in parameters if item.name == "sides.left.swing_flexion.knee.equilibrium_deg"]
    changed = _parse(apply_coordinates(editable_document(lopsided), [own], [1.0]))
    assert changed.phases == _parse(editable_document(lopsided)).phases
    found = changed.side_phases["left"]["swing_flexion"].joints["knee"].equilibrium_angle  # type: ignore[index]
    assert math.degrees(found) == pytest.approx(own.upper, abs=0.05)


def test_separately_tuned_legs_have_separate_parameters(shipped: GaitTable) -> None:
    apart = split_sides(shipped)
    assert all(apart.phases_of(side) == shipped.phases_of(side) for side in Side)
    parameters = tunable_parameters(apart, thresholds=False, blending=False)
    assert len(parameters) == 2 * 4 * 5 * 2
    (own,) = [item for item in parameters if item.name == "sides.right.late_stance.knee.stiffness_Nm_per_deg"]
    changed = _parse(apply_coordinates(editable_document(apart), [own], [1.0]))
    assert changed.phases_of(Side.LEFT) == _parse(editable_document(shipped)).phases_of(Side.LEFT)
    stiffness = changed.phases_of(Side.RIGHT)["late_stance"].joints["knee"].stiffness
    assert stiffness == pytest.approx(own.upper * 180.0 / math.pi)


def test_a_start_outside_the_usual_bounds_widens_them(shipped: GaitTable) -> None:
    document = table_document(shipped)
    document["phases"]["early_stance"]["hip"]["stiffness_Nm_per_rad"] = 20.0 * 180.0 / math.pi
    found = tunable_parameters(_parse(document), thresholds=False, blending=False)[0]
    assert found.upper == pytest.approx(20.0)
    assert found.value(found.start_coordinate) == pytest.approx(20.0)


def test_a_tuned_table_does_not_inherit_waivers(shipped: GaitTable) -> None:
    assert shipped.waivers
    assert "waive" not in editable_document(shipped)


# ---------------------------------------------------------------------- cost

JOINTS = ("hip", "knee")
PARTS = objective_terms(JOINTS)
AT_GOAL = {part.name: part.goal for part in PARTS}


def test_at_all_goals_a_walk_costs_the_sum_of_the_weights() -> None:
    weights = sum(part.weight for part in PARTS)
    assert walk_cost(AT_GOAL, 1.0, False, JOINTS) == pytest.approx(weights)
    assert walk_cost(
        {name: 2.0 * goal for name, goal in AT_GOAL.items()}, 1.0, False, JOINTS
    ) == pytest.approx(4.0 * weights)


def _walk_with(values: Mapping[str, float | None]) -> Rating:
    return Rating(walk_cost(values, 1.0, False, JOINTS), dict(values), False, 1.0, (0.1,))


def test_a_goal_that_is_missed_costs_more_than_one_that_is_surpassed_saves() -> None:
    """By hand, for goals of 3.5°, 4.5° and 60 N·m.

    (1.75/3.5)² = 0.25, (4.375/3.5)² + 20 (1.25 - 0.9)² = 1.5625 + 2.45, 1.1²/4 + 6 (1.1 - 0.9)² = 0.5425.
    """
    free = dict.fromkeys(AT_GOAL, 0.0)
    assert nominal_cost(_walk_with({**free, "hip_error_deg": 1.75})) == pytest.approx(0.25)
    assert nominal_cost(_walk_with({**free, "hip_error_deg": 4.375})) == pytest.approx(1.5625 + 2.45)
    assert nominal_cost(_walk_with({**free, "torque_change_Nm": 66.0})) == pytest.approx(0.5425)
    even = nominal_cost(_walk_with({**free, "hip_error_deg": 3.5, "knee_error_deg": 5.5}))
    traded = nominal_cost(_walk_with({**free, "hip_error_deg": 2.6, "knee_error_deg": 6.9}))
    assert even < traded


@given(st.lists(st.floats(0.0, 1e3), min_size=2, max_size=2))
def test_the_worse_of_two_walks_costs_more_and_any_fall_the_most(errors: list[float]) -> None:
    better, worse = (
        nominal_cost(_walk_with({**AT_GOAL, "hip_error_deg": error})) for error in sorted(errors)
    )
    assert better <= worse <= WORST
    assert nominal_cost(Rating(walk_cost({}, 1.0, True, JOINTS), {}, True, 1.0)) >= WORST


def test_residuals_add_up_to_the_cost() -> None:
    """If errors consist of two deviations, their squares add up to the cost."""
    values = {**AT_GOAL, "hip_error_deg": 5.0, "torque_jump_Nm": 9.0, "scuffs_per_stride": None}
    walk = Rating(walk_cost(values, 1.0, False, JOINTS), values, False, 1.0, (5.0 / 3.5, 1.0))
    found = residuals(walk)
    assert found @ found == pytest.approx(nominal_cost(walk))
    assert len(residuals(Rating(50.0, {}, True, 0.5, (1.0,)))) == 0


def test_missed_goals_count_in_the_nominal_walk_only() -> None:
    nominal, other = _walk_with({**AT_GOAL, "hip_error_deg": 5.0}), Rating(6.0, {}, False, 1.0)
    assert nominal_cost(nominal) > nominal.cost
    assert weighted_cost([nominal, other]) == pytest.approx(0.75 * nominal_cost(nominal) + 0.25 * 6.0)
    fallen = Rating(40.0, {}, True, 0.5)
    assert weighted_cost([fallen]) == 40.0


def test_a_part_that_is_not_defined_costs_its_weight() -> None:
    assert term_costs({**AT_GOAL, "stride_variation_pct": None}, JOINTS) == term_costs(AT_GOAL, JOINTS)


@given(lasted=st.floats(0.0, 1.0), later=st.floats(0.0, 1.0))
def test_a_fall_costs_more_than_any_walk_and_less_the_later_it_comes(lasted: float, later: float) -> None:
    early, late = sorted((lasted, later))
    worst = walk_cost({name: 1e3 for name in AT_GOAL}, 1.0, False, JOINTS)
    costs = [walk_cost({}, share, True, JOINTS) for share in (early, late)]
    assert worst == WORST
    assert WORST <= costs[1] <= costs[0] <= FALL


def test_standing_costs_as_much_as_the_worst_walk() -> None:
    assert walk_cost({**AT_GOAL, "knee_error_deg": None}, 1.0, False, JOINTS) == WORST


@pytest.mark.parametrize(
    ("before", "after", "word"),
    [(5.0, 4.0, "better"), (4.0, 5.0, "traded"), (4.0, 4.01, "same"), (None, 4.0, "not defined")],
)
def test_a_part_is_better_traded_or_the_same(before: float | None, after: float, word: str) -> None:
    assert verdict(before, after, 4.0) == word


def test_finalists_come_from_all_stretches_of_the_search_the_latest_first() -> None:
    at = [
        Generation([coordinate], 9.0 - coordinate, []) for coordinate in (0.0, 1.0, 1.0, 2.0, 3.0, 4.0, 4.0)
    ]
    assert [item.point for item in stages.leaders(at, 3)] == [[4.0], [2.0], [0.0]]
    assert [item.point for item in stages.leaders(at[:3], 5)] == [[1.0], [0.0]]


def test_three_quarters_of_the_cost_of_a_table_are_its_nominal_walk() -> None:
    walks = [
        Rating(4.0, {}, False, 1.0),
        *(Rating(cost, {}, False, 1.0) for cost in (6.0, 10.0)),
    ]
    assert weighted_cost(walks) == pytest.approx(0.75 * 4.0 + 0.25 * 8.0)


# ---------------------------------------------------------------------- cases


def test_another_mass_does_not_change_the_device_parameters() -> None:
    nominal = load_experiment("treadmill_guided").experiment
    stiffness = scaled_table(nominal, nominal.build_world()).phases
    cases = build_cases(nominal, "robust")
    for world in (cases["mass −10 %"], cases["mass +10 %"]):
        assert isinstance(world.patient, Patient) and isinstance(nominal.patient, Patient)
        assert abs(world.patient.mass / nominal.patient.mass - 1.0) == pytest.approx(0.1)
        assert world.control.patient == nominal.patient
        found = scaled_table(world, world.build_world()).phases
        for phase, values in stiffness.items():
            for joint, impedance in values.joints.items():
                assert found[phase].joints[joint].stiffness == pytest.approx(impedance.stiffness, rel=1e-9)


def test_the_robust_set_contains_the_documented_cases() -> None:
    nominal = load_experiment("treadmill_guided").experiment
    worlds = list((build_cases(nominal, "robust") | build_cases(nominal, "search")).values())
    ratios = {ratio for world in worlds for ratio in world.plant.friction_ratio.values()}
    assert {0.35, 1.0} <= ratios
    assert {23.0, 33.6} <= {world.plant.battery.voltage for world in worlds}
    assert any(world.sensors.angle_noise > 0.0 and not world.sensors.ideal for world in worlds)
    assert len({world.scenario.support.share for world in worlds}) == 3  # type: ignore[union-attr]
    assert len({world.scenario.belt_speed for world in worlds}) == 3  # type: ignore[union-attr]
    assert worlds[0] == nominal


def test_draws_are_in_their_ranges_and_the_device_receives_the_wearer() -> None:
    nominal = load_experiment("treadmill_guided").experiment
    nominal = replace(nominal, control=replace(nominal.control, patient=Patient(mass=80.0, height=1.8)))
    worlds = list(draw_worlds(nominal, 16, seed=3, stream=0).values())
    ranges = draw_ranges(nominal)
    drawn = {
        "patient.height_m": [world.patient.height for world in worlds],
        "support_share": [world.scenario.support.share for world in worlds],
        "belt_speed": [world.scenario.belt_speed for world in worlds],
        "scenario.contact.stiffness_N_per_m1p5": [world.scenario.contact.stiffness for world in worlds],
        "gear_efficiency": [next(iter(w.plant.actuators.values())).gear_efficiency for w in worlds],
        "friction_ratio": [next(iter(w.plant.friction_ratio.values())) for w in worlds],
    }
    for key, values in drawn.items():
        low, high = ranges[key]["lower"], ranges[key]["upper"]
        middle = math.sqrt(low * high) if ranges[key].get("logarithmic") else 0.5 * (low + high)
        assert low <= min(values) and max(values) <= high, key
        assert sum(value < middle for value in values) == 8, key  # a Latin hypercube
    for world in worlds:
        assert world.control.patient.height == world.patient.height
        assert world.patient.mass / world.control.patient.mass == pytest.approx(1.0, abs=0.05)
        assert not world.sensors.ideal


def test_draws_depend_on_seed_and_stream_only() -> None:
    nominal = load_experiment("treadmill_guided").experiment
    first = draw_worlds(nominal, 4, seed=3, stream=0)
    assert draw_worlds(nominal, 4, seed=3, stream=0) == first
    masses = {
        tuple(world.patient.mass for world in draw_worlds(nominal, 4, seed=seed, stream=stream).values())
        for seed, stream in ((3, 0), (3, 1), (4, 0))
    }
    assert len(masses) == 3


def test_draws_on_the_floor_have_arms_and_no_belt() -> None:
    worlds = draw_worlds(load_experiment("overground").experiment, 4, seed=0, stream=0).values()
    assert len({world.scenario.arms.delay for world in worlds}) == 4
    assert all(0.15 <= world.scenario.arms.delay <= 0.19 for world in worlds)


def test_a_leg_on_a_bench_cannot_be_tuned() -> None:
    bench = load_experiment("bench_leg").experiment
    with raises(ParameterError, "bench_leg", "--patient"):
        tune(bench, TuningSettings())


# ---------------------------------------------------------------------- search


def _valley(point: Sequence[float]) -> np.ndarray:
    """A bent valley in six numbers, whose bottom lies where all are 0.7."""
    x = np.array(point)
    return np.array([*(3.0 * (x[1:] - x[:-1] + 0.5 * (x[:-1] - 0.7) ** 2)), *(0.3 * (x - 0.7)), 0.0])


def _searched(descent: Descent, generations: int) -> Descent:
    for _ in range(generations):
        points = descent.neighbours()
        descent.update_slopes(points, [[_valley(point)] for point in points])
        candidates = [*((None, point) for point in points), *descent.candidate_steps()]
        costs = [float(_valley(point) @ _valley(point)) for _, point in candidates]
        best = int(np.argmin(costs))
        if costs[best] < descent.cost:
            damping, point = candidates[best]
            descent.accept_step(point, costs[best], [_valley(point)], damping)
        else:
            descent.reject_steps()
    return descent


def _begun() -> Descent:
    start = [0.2] * 6
    return Descent(start, float(_valley(start) @ _valley(start)), [_valley(start)])


def test_the_search_finds_the_bottom_of_a_valley() -> None:
    begun = _begun().cost
    assert _searched(_begun(), 20).cost < 1e-3 * begun


def test_the_slopes_of_a_plane_are_found_and_descended() -> None:
    plane, at = np.array([[2.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.array([0.5, 0.5, 0.5])
    own = plane @ at - 1.2
    descent = Descent(at.tolist(), float(own @ own), [own])
    points = descent.neighbours()
    np.testing.assert_allclose(np.array(points) - at, REACH * np.eye(3), atol=1e-12)
    descent.update_slopes(points, [[plane @ np.array(point) - 1.2] for point in points])
    np.testing.assert_allclose(descent.slopes[0], plane.T, rtol=1e-9, atol=1e-9)
    damping, point = descent.candidate_steps()[0]
    step = -np.linalg.solve(plane.T @ plane + damping**2 * np.eye(3), plane.T @ own)
    np.testing.assert_allclose(point, np.clip(at + step, 0.0, 1.0), atol=1e-6)


def test_slopes_of_several_worlds_are_stacked_with_their_weights() -> None:
    planes = [np.array([[2.0, 0.0], [0.0, 1.0]]), np.array([[1.0, 1.0]])]
    levels, weights, at = [1.2, 0.4], (0.75, 0.25), np.array([0.5, 0.5])

    def walk(point: np.ndarray) -> list[np.ndarray]:
        return [plane @ point - level for plane, level in zip(planes, levels, strict=True)] + [np.zeros(0)]

    own = walk(at)
    descent = Descent(at.tolist(), 1.0, own, (*weights, 1.0))  # the table does not walk in the third world
    points = descent.neighbours()
    descent.update_slopes(points, [walk(np.array(point)) for point in points])
    damping, point = descent.candidate_steps()[0]
    pairs = list(zip(weights, planes, strict=True))
    square = sum(weight * plane.T @ plane for weight, plane in pairs) + damping**2 * np.eye(2)
    ascent = sum(weight * plane.T @ here for (weight, plane), here in zip(pairs, own[:2], strict=True))
    np.testing.assert_allclose(point, np.clip(at - np.linalg.solve(square, ascent), 0.0, 1.0), atol=1e-6)


def test_a_world_in_which_the_table_begins_to_walk_gets_slopes_of_its_own() -> None:
    descent = Descent([0.5], 1.0, [np.ones(2), np.zeros(0)], (0.5, 0.5))
    descent.update_slopes(descent.neighbours(), [[np.full(2, 1.1), np.ones(3)]])
    kept = descent.slopes[0]
    descent.accept_step([0.55], 0.9, [np.full(2, 1.1), np.ones(3)], 1.0)
    assert descent.slopes[0] is kept and descent.slopes[1] is None


def test_a_step_to_another_kind_of_gait_gives_no_slope_and_earlier_slopes_fade() -> None:
    descent = Descent([0.5, 0.5], 1.0, [np.array([1.0, 0.0])], slopes=[np.diag([4.0, 2.0])])
    descent.update_slopes(descent.neighbours(), [[np.zeros(0)], [np.array([9.0, 0.0])]])
    np.testing.assert_array_equal(descent.slopes[0], np.diag([2.0, 1.0]))


def test_parameters_are_varied_up_and_down_in_turn_within_their_range() -> None:
    descent = Descent([0.5, 0.01, 0.99], 1.0, [np.ones(1)])
    up = descent.neighbours()
    descent.reject_steps()
    down = descent.neighbours()
    moves = [
        [round(point[index] - descent.point[index], 9) for index, point in enumerate(found)]
        for found in (up, down)
    ]
    assert moves == [[REACH, REACH, -REACH], [-0.6 * REACH, 0.6 * REACH, -0.6 * REACH]]


@given(st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6))
def test_candidates_stay_in_the_cube(at: list[float]) -> None:
    descent = Descent(at, 1.0, [10.0 * _valley(at)])
    points = descent.neighbours()
    descent.update_slopes(points, [[10.0 * _valley(point)] for point in points])
    for point in (*points, *(point for _, point in descent.candidate_steps())):
        assert min(point) >= 0.0 and max(point) <= 1.0


def test_a_search_is_deterministic() -> None:
    whole = _searched(_begun(), 9)
    np.random.seed(99)  # noqa: NPY002  # what others draw must not matter
    assert _searched(_begun(), 9).point == whole.point


def test_a_search_that_gains_nothing_ends() -> None:
    descent = Descent([0.5], 1.0, [np.ones(1)])
    for _ in range(MAX_GENERATIONS_WITHOUT_GAIN):
        assert not descent.has_ended
        descent.reject_steps()
    assert descent.has_ended
    assert descent.reach < REACH


# ---------------------------------------------------------------------- the whole, with a bowl for a walk


class Bowl:
    """Walks whose cost is a bowl over two numbers of the table; everything else does not matter.

    A walk whose angle is more than ``cliff`` degrees from the optimum falls.
    """

    def __init__(self) -> None:
        self.walks = 0
        self.cliff = math.inf

    def __call__(
        self,
        walks: Sequence[Experiment],
        workers: object,
        *,
        should_stop: Callable[[], bool] | None = None,
    ) -> list[Rating]:
        results = []
        for walk in walks:
            if should_stop is not None and should_stop():
                raise TuningStopped
            self.walks += 1
            swing = walk.table.phases["swing_flexion"].joints
            stiffness = math.radians(swing["knee"].stiffness)
            angle = math.degrees(swing["hip"].equilibrium_angle)
            hip = 2.0 + abs(angle - 45.0)
            knee = 4.0 + 20.0 * abs(math.log(stiffness / 3.0))
            values: dict[str, float | None] = {part.name: 0.0 for part in PARTS}
            values |= {"hip_error_deg": hip, "knee_error_deg": knee}
            residuals = ((angle - 45.0) / 20.0, math.log(stiffness / 3.0))
            fell, lasted = abs(angle - 45.0) > self.cliff, 20.0 / (20.0 + abs(angle - 45.0))
            cost = walk_cost(values, lasted, fell, JOINTS)
            results.append(Rating(cost, values, fell, lasted, () if fell else residuals))
        return results


@pytest.fixture
def bowl(monkeypatch: pytest.MonkeyPatch) -> Bowl:
    walks = Bowl()
    monkeypatch.setattr(stages.walks, "walk_all", walks)
    monkeypatch.setattr(stages, "precompile", lambda walked, total, on_compile: None)
    monkeypatch.setattr(stages.walks, "quick_errors", lambda walked: ())
    return walks


SHORT = TuningSettings(generations=3, seed=4)


def test_the_influential_parameters_are_optimised(bowl: Bowl) -> None:
    experiment = load_experiment("treadmill_guided").experiment
    messages: list[str] = []
    result = tune(experiment, TuningSettings(generations=12), report=messages.append)
    best = result.ranked[0].table["phases"]["swing_flexion"]
    assert best["hip"]["equilibrium_deg"] == pytest.approx(45.0, abs=1.0)
    assert best["knee"]["stiffness_Nm_per_deg"] == pytest.approx(3.0, abs=0.2)
    assert result.initial is not None
    assert result.ranked[0].cost < result.initial.cost
    costs = [float(line.split("cost ")[1].split()[0]) for line in messages if "search" in line]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < costs[0]


@pytest.mark.parametrize("walks_before", [0, 2, 60, 130, 250])
def test_a_stopped_tuning_has_no_result(bowl: Bowl, walks_before: int) -> None:
    experiment = load_experiment("treadmill_guided").experiment
    assert tune(experiment, SHORT, should_stop=lambda: bowl.walks >= walks_before) is None


def tune_noting_walks(
    bowl: Bowl, experiment: Experiment, settings: TuningSettings
) -> tuple[Any, list[list[Experiment]]]:
    """Return a tuning, and the walks of each of its rounds."""
    portions: list[list[Experiment]] = []

    def noted(walks: Sequence[Experiment], *rest: Any, **options: Any) -> list[Rating]:
        portions.append(list(walks))
        return bowl(walks, *rest, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages.walks, "walk_all", noted)
        return tune(experiment, settings), portions


def test_only_the_best_of_a_generation_are_simulated_in_the_other_cases(bowl: Bowl) -> None:
    experiment = load_experiment("treadmill_guided").experiment
    _, portions = tune_noting_walks(bowl, experiment, TuningSettings(generations=1))
    nominal, others = [*portions[1], *portions[2]], portions[3]
    alone = bowl(nominal, None)
    order = sorted(range(len(nominal)), key=lambda index: nominal_cost(alone[index]))[: stages.RACED]
    size = len(build_cases(experiment, "search")) - 1
    assert len(others) == size * stages.RACED
    assert all(walk.patient == experiment.patient for walk in nominal)
    assert all(walk.patient != experiment.patient for walk in others)
    raced = [walk.table.phases for walk in others[::size]]
    assert raced == [nominal[index].table.phases for index in order]


ROBUST = TuningSettings(robust=True, generations=40, population=12, draws=1, held_out=2, seed=1, spread=0.2)


def test_a_robust_search_finds_the_optimum_from_elsewhere(bowl: Bowl) -> None:
    experiment = load_experiment("treadmill_guided").experiment
    for settings in (ROBUST, replace(ROBUST, scatter=0.3, seed=2)):
        best = tune(experiment, settings).ranked[0].table["phases"]["swing_flexion"]
        assert best["hip"]["equilibrium_deg"] == pytest.approx(45.0, abs=1.5)
        assert best["knee"]["stiffness_Nm_per_deg"] == pytest.approx(3.0, abs=0.4)


def test_a_robust_search_is_judged_in_worlds_that_it_has_not_seen(bowl: Bowl) -> None:
    experiment = load_experiment("treadmill_guided").experiment
    result, portions = tune_noting_walks(bowl, experiment, replace(ROBUST, generations=2))
    start, neighbours, steps, raced, *_, held_out = portions
    assert len(start) == 1 + ROBUST.draws
    assert len(neighbours) == len(result.parameters) * (1 + ROBUST.draws)
    assert len(steps) == len(FACTORS) * len(PARTS_OF_STEPS)
    assert len(raced) == stages.RACED * ROBUST.draws
    assert len(held_out) == len(result.ranked) * (1 + ROBUST.held_out)
    searched, judged = (
        {walk.patient.mass for walk in walks} - {experiment.patient.mass} for walks in (start, held_out)
    )
    assert {walk.patient.mass for walk in (*neighbours, *raced)} == searched | {experiment.patient.mass}
    assert len(searched) == ROBUST.draws and len(judged) == ROBUST.held_out and not searched & judged


def test_a_start_that_falls_is_evolved_until_it_walks(bowl: Bowl) -> None:
    experiment = load_experiment("treadmill").experiment
    start = math.degrees(experiment.table.phases["swing_flexion"].joints["hip"].equilibrium_angle)
    bowl.cliff = 0.7 * abs(start - 45.0)
    result, portions = tune_noting_walks(bowl, experiment, ROBUST)
    assert 0 < result.evolved < ROBUST.generations
    first_all, first_half = portions[1:3]
    assert len(first_all) == ROBUST.population
    assert len(first_half) == ROBUST.draws * ROBUST.population // 2
    costs = [generation.cost for generation in result.generations[result.evolved + 1 :]]
    assert costs == sorted(costs, reverse=True)
    best = result.ranked[0].table["phases"]["swing_flexion"]
    assert best["hip"]["equilibrium_deg"] == pytest.approx(45.0, abs=1.5)
    assert result.initial.falls == 1 + ROBUST.held_out and result.ranked[0].falls == 0


def test_numbers_of_the_experiment_are_searched_with_the_table(bowl: Bowl) -> None:
    key, experiment = "scenario.support.damping_Ns_per_m", load_experiment("treadmill_guided").experiment
    settings = replace(ROBUST, generations=2, also={key: (50.0, 90.0, 130.0)})
    result, portions = tune_noting_walks(bowl, experiment, settings)
    walked = {walk.scenario.support.damping for walks in portions for walk in walks}
    assert walked == {90.0, 94.0, 86.0}  # the start, then 5 % of the range up and down
    assert result.initial.table[SETTINGS] == {key: 90.0}


def test_a_range_of_an_experiment_that_does_not_rise_is_rejected_by_its_key() -> None:
    experiment = load_experiment("treadmill_guided").experiment
    with raises(ParameterError, "scenario.support.damping_Ns_per_m", "130.0"):
        tune(experiment, replace(ROBUST, also={"scenario.support.damping_Ns_per_m": (130.0, 90.0, 50.0)}))


def test_ranks_of_the_second_round_come_before_those_of_the_first() -> None:
    first = [5.0, 1.0, 9.0, 3.0, 2.0]
    costs = rank_in_two_rounds(first, lambda chosen: {at: {1: 7.0, 4: 4.0, 3: 20.0}[at] for at in chosen})
    assert sorted(range(5), key=costs.__getitem__) == [4, 1, 3, 0, 2]


def test_a_robust_search_without_its_package_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cma", None)
    with raises(MissingOptionalDependency, "cma", "twin-gait[robust]"):
        Evolution([0.5], spread=0.1, population=4, seed=0)


def test_the_search_rejects_a_table_with_an_error(bowl: Bowl) -> None:
    experiment = load_experiment("treadmill_guided").experiment
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages.walks, "quick_errors", lambda walked: ("unstable",))
        result = tune(experiment, TuningSettings(generations=2))
    assert all(item.table == editable_document(experiment.table) for item in result.ranked)
    assert len({item.cost for item in result.generations}) == 1


# ---------------------------------------------------------------------- mistakes of a user


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (["--minutes", "0"], ("minutes", "0")),
        (["--seed", "-1"], ("seed", "0", "-1")),
        (["--generations", "0"], ("generations", "1", "100000")),
        (["--workers", "0"], ("--workers", "1", "0")),
        (["--workers", "1", "--scheduler", "tcp://x"], ("--workers", "--scheduler")),
        (["--patient", "nobody"], ("nobody",)),
        (["bench_leg"], ("bench_leg",)),
        (["--draws", "3"], ("--draws", "--robust")),
        (["--robust", "--population", "3"], ("population", "4", "3")),
        (["--robust", "--also", "scenario.nothing=0:1:2"], ("scenario.nothing",)),
    ],
)
def test_a_mistake_is_refused_in_one_line_without_a_folder(
    arguments: list[str], facts: tuple[str, ...], tmp_path: Path
) -> None:
    parser = argparse.ArgumentParser()
    command.add_parser(parser.add_subparsers())
    out = tmp_path / "out"
    with pytest.raises(TwinGaitError) as raised:
        command.tune(parser.parse_args(["tune", "--out", str(out), *arguments]))
    assert states(str(raised.value), *facts)
    assert "\n" not in str(raised.value)
    assert not out.exists()
