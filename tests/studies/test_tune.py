"""Tuning without walking: the numbers, the cost, screening and search, and going on where it was stopped."""

from __future__ import annotations

import argparse
import itertools
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_gait.cli import tune as command
from twin_gait.configuration import load_experiment
from twin_gait.configuration.documents import table_document
from twin_gait.configuration.gait_table_file import gait_table_from_mapping, load_gait_table
from twin_gait.exceptions import (
    MissingOptionalDependency,
    ParameterError,
    RunDirectoryError,
    TwinGaitError,
)
from twin_gait.experiment.problem import scaled_table
from twin_gait.gait.table import GaitTable
from twin_gait.parameters import Patient
from twin_gait.simulation import RunStatus
from twin_gait.studies.tune import search as screening
from twin_gait.studies.tune import stages
from twin_gait.studies.tune import state as tune_settings
from twin_gait.studies.tune.cases import NOMINAL, departures, robust_cases, search_cases
from twin_gait.studies.tune.outcome import verdict
from twin_gait.studies.tune.parts import FALL, PARTS, WORST, Rating, excess_cost, part_costs, walk_cost
from twin_gait.studies.tune.search import Generation, Search
from twin_gait.studies.tune.space import (
    Parameter,
    editable_document,
    parameters_of,
    table_with,
    with_own_sides,
)
from twin_gait.studies.tune.state import STATE_FILE, Progress, Settings, open_state, write_state
from twin_gait.studies.tune.tune import tune
from twin_gait.studies.tune.walks import Ask, nominal_cost, weighted_cost
from twin_gait.vocabulary import Side


@pytest.fixture(scope="module")
def shipped() -> GaitTable:
    return load_gait_table("treadmill")


def _parse(document: Mapping[str, Any]) -> GaitTable:
    return gait_table_from_mapping(dict(document), "the test", "treadmill")


# ---------------------------------------------------------------------- numbers


def test_every_phase_and_joint_has_its_four_numbers_and_more_where_asked(shipped: GaitTable) -> None:
    bare = parameters_of(shipped, thresholds=False, blending=False)
    assert len(bare) == 4 * 5 * 2
    more = {item.name for item in parameters_of(shipped)} - {item.name for item in bare}
    text = json.dumps(table_document(shipped)["transitions"])
    angle_guards = text.count("angle_deg <") + text.count("angle_deg >")
    assert len(more) == angle_guards + 1
    assert "blending.duration_ms" in more


def test_the_start_gives_the_table_that_it_began_with(shipped: GaitTable) -> None:
    parameters = parameters_of(shipped)
    start = [item.start_coordinate for item in parameters]
    again = _parse(table_with(editable_document(shipped), parameters, start))
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
    table = load_gait_table("treadmill")
    document = editable_document(table)
    parameter = data.draw(st.sampled_from(parameters_of(table)))
    coordinate = data.draw(st.floats(0.0, 1.0))
    before, after = _leaves(document), _leaves(table_with(document, [parameter], [coordinate]))
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


def test_a_side_of_its_own_has_numbers_of_its_own(shipped: GaitTable) -> None:
    document = table_document(shipped)
    document["sides"] = {"left": {"swing_flexion": {"knee": {"equilibrium_rad": 0.9}}}}
    lopsided = _parse(document)
    parameters = parameters_of(lopsided, thresholds=False, blending=False)
    assert len(parameters) == 4 * 5 * 2 + 4 * 2
    (own,) = [item for item in parameters if item.name == "sides.left.swing_flexion.knee.equilibrium_deg"]
    changed = _parse(table_with(editable_document(lopsided), [own], [1.0]))
    assert changed.phases == _parse(editable_document(lopsided)).phases
    found = changed.side_phases["left"]["swing_flexion"].joints["knee"].equilibrium_angle  # type: ignore[index]
    assert math.degrees(found) == pytest.approx(own.upper, abs=0.05)


def test_legs_told_apart_have_numbers_of_their_own(shipped: GaitTable) -> None:
    apart = with_own_sides(shipped)
    assert all(apart.phases_of(side) == shipped.phases_of(side) for side in Side)
    parameters = parameters_of(apart, thresholds=False, blending=False)
    assert len(parameters) == 2 * 4 * 5 * 2
    (own,) = [item for item in parameters if item.name == "sides.right.late_stance.knee.stiffness_Nm_per_deg"]
    changed = _parse(table_with(editable_document(apart), [own], [1.0]))
    assert changed.phases_of(Side.LEFT) == _parse(editable_document(shipped)).phases_of(Side.LEFT)
    stiffness = changed.phases_of(Side.RIGHT)["late_stance"].joints["knee"].stiffness
    assert stiffness == pytest.approx(own.upper * 180.0 / math.pi)


def test_a_shipped_table_gives_way_to_a_better_shipped_one_and_ones_own_does_not(shipped: GaitTable) -> None:
    assert [table.name for table in stages.start_tables(shipped)] == list(stages.START_TABLES)
    apart = stages.start_tables(with_own_sides(shipped))
    assert [table.name for table in apart] == list(stages.START_TABLES)
    assert all(set(table.side_phases) == set(Side) for table in apart)
    own = replace(shipped, blending=replace(shipped.blending, duration_ticks=40))
    assert stages.start_tables(own) == (own,)


def test_a_start_outside_the_usual_bounds_widens_them(shipped: GaitTable) -> None:
    document = table_document(shipped)
    document["phases"]["early_stance"]["hip"]["stiffness_Nm_per_rad"] = 20.0 * 180.0 / math.pi
    found = parameters_of(_parse(document), thresholds=False, blending=False)[0]
    assert found.upper == pytest.approx(20.0)
    assert found.value(found.start_coordinate) == pytest.approx(20.0)


def test_a_tuned_table_does_not_inherit_waivers(shipped: GaitTable) -> None:
    assert shipped.waivers
    assert "waive" not in editable_document(shipped)


# ---------------------------------------------------------------------- cost

AT_GOAL = {part.name: part.goal for part in PARTS}


def test_at_all_goals_a_walk_costs_the_sum_of_the_weights() -> None:
    weights = sum(part.weight for part in PARTS)
    assert walk_cost(AT_GOAL, 1.0, False) == pytest.approx(weights)
    assert walk_cost({name: 2.0 * goal for name, goal in AT_GOAL.items()}, 1.0, False) == pytest.approx(
        4.0 * weights
    )


def test_a_goal_that_is_missed_costs_more_than_one_that_is_surpassed_saves() -> None:
    """By hand: 20 (5/4 - 0.9)^2 = 2.45 and 20 (9/8 - 0.9)^2 = 1.0125; other parts cost nothing on top."""
    missed = {**AT_GOAL, "hip_error_deg": 5.0, "knee_error_deg": 9.0, "saturated_pct": 40.0}
    assert excess_cost(missed) == pytest.approx(2.45 + 1.0125)
    assert excess_cost({name: 0.9 * goal for name, goal in AT_GOAL.items()}) == 0.0
    traded = {**AT_GOAL, "hip_error_deg": 3.0, "knee_error_deg": 9.0}
    kept, changed = (sum(part_costs(item).values()) + excess_cost(item) for item in (AT_GOAL, traded))
    assert changed > kept > sum(part_costs(AT_GOAL).values())


def test_missed_goals_count_in_the_nominal_walk_only() -> None:
    missed = {**AT_GOAL, "hip_error_deg": 5.0}
    nominal, other = Rating(4.0, missed, False, 1.0), Rating(6.0, missed, False, 1.0)
    assert weighted_cost([nominal, other]) == pytest.approx(0.75 * (4.0 + excess_cost(missed)) + 0.25 * 6.0)
    fallen = Rating(40.0, missed, True, 0.5)
    assert weighted_cost([fallen]) == 40.0


def test_a_part_that_is_not_defined_costs_its_weight() -> None:
    assert part_costs({**AT_GOAL, "stride_variation_pct": None}) == part_costs(AT_GOAL)


@given(lasted=st.floats(0.0, 1.0), later=st.floats(0.0, 1.0))
def test_a_fall_costs_more_than_any_walk_and_less_the_later_it_comes(lasted: float, later: float) -> None:
    early, late = sorted((lasted, later))
    worst = walk_cost({name: 1e3 for name in AT_GOAL}, 1.0, False)
    costs = [walk_cost({}, share, True) for share in (early, late)]
    assert worst == WORST
    assert WORST <= costs[1] <= costs[0] <= FALL


def test_standing_about_costs_as_much_as_the_worst_walk() -> None:
    assert walk_cost({**AT_GOAL, "knee_error_deg": None}, 1.0, False) == WORST


@pytest.mark.parametrize(
    ("before", "after", "word"),
    [(5.0, 4.0, "better"), (4.0, 5.0, "traded"), (4.0, 4.01, "same"), (None, 4.0, "not defined")],
)
def test_a_part_is_better_traded_or_the_same(before: float | None, after: float, word: str) -> None:
    assert verdict(before, after, 4.0) == word


def test_finalists_come_from_all_stretches_of_the_search_the_latest_first() -> None:
    """Of four the two cheapest have walked all cases; what costs as much as a fall is left out."""
    costs = [[9.0, 8.0, 1.0, 7.0], [6.0, 6.5, 9.0, 9.0], [5.0, 4.0, 9.0, 9.0], [FALL, FALL, 2 * FALL, FALL]]
    generations = [Generation([[float(i), float(j)] for j in range(4)], row) for i, row in enumerate(costs)]
    assert stages.leaders(generations, 2) == [(4.0, [2.0, 1.0]), (1.0, [0.0, 2.0])]
    assert stages.leaders(generations, 4) == [(4.0, [2.0, 1.0]), (6.0, [1.0, 0.0]), (1.0, [0.0, 2.0])]
    assert stages.leaders(generations[:1], 3) == [(1.0, [0.0, 2.0])]


def test_three_quarters_of_the_cost_of_a_table_are_its_nominal_walk() -> None:
    walks = [
        Rating(4.0, {}, False, 1.0),
        *(Rating(cost, {}, False, 1.0) for cost in (6.0, 10.0)),
    ]
    assert weighted_cost(walks) == pytest.approx(0.75 * 4.0 + 0.25 * 8.0)


# ---------------------------------------------------------------------- cases


def test_another_mass_is_unknown_to_the_device() -> None:
    nominal = load_experiment("treadmill").experiment
    stiffness = scaled_table(nominal, nominal.build_world()).phases
    for case in robust_cases(nominal):
        if not case.name.startswith("mass"):
            continue
        world = case.change(nominal)
        assert isinstance(world.patient, Patient) and isinstance(nominal.patient, Patient)
        assert abs(world.patient.mass / nominal.patient.mass - 1.0) == pytest.approx(0.1)
        assert world.control.patient == nominal.patient
        found = scaled_table(world, world.build_world()).phases
        for phase, values in stiffness.items():
            for joint, impedance in values.joints.items():
                assert found[phase].joints[joint].stiffness == pytest.approx(impedance.stiffness, rel=1e-9)


def test_the_robust_set_covers_what_it_promises() -> None:
    nominal = load_experiment("treadmill").experiment
    worlds = [case.change(nominal) for case in robust_cases(nominal)]
    ratios = {ratio for world in worlds for ratio in world.plant.friction_ratio.values()}
    assert {0.35, 1.0} <= ratios
    assert {23.0, 33.6} <= {world.plant.battery.voltage for world in worlds}
    assert any(world.sensors.angle_noise > 0.0 and not world.sensors.ideal for world in worlds)
    assert len({world.scenario.support.share for world in worlds}) == 3  # type: ignore[union-attr]
    assert len({world.scenario.belt_speed for world in worlds}) == 3  # type: ignore[union-attr]
    assert worlds[0] == nominal


def test_every_departure_passes_the_person_tuned_for() -> None:
    nominal = load_experiment("treadmill").experiment
    for item in departures(nominal):
        place = item.values.index(item.nominal)
        assert item.cases[place].change(nominal) == nominal
        assert list(item.values) == sorted(set(item.values))
        changed = [case.change(nominal) for case in item.cases]
        assert all(one != other for one, other in itertools.pairwise(changed))


def test_a_leg_on_a_bench_cannot_be_tuned(tmp_path: Path) -> None:
    bench = load_experiment("bench_leg").experiment
    with pytest.raises(ParameterError, match="expected a treadmill with a wearer"):
        tune(bench, tmp_path / "new", Settings())
    assert not (tmp_path / "new").exists()


# ---------------------------------------------------------------------- screening


def _numbers(count: int) -> list[Parameter]:
    return [
        Parameter(name=f"x{i}", path=("x", i), unit="", start=0.5, lower=0.0, upper=1.0, digits=6)
        for i in range(count)
    ]


def test_elementary_effects_of_a_plane_are_its_slopes() -> None:
    slopes = np.array([3.0, 0.0, -1.0, 0.02, 0.5])
    parameters = _numbers(len(slopes))
    points = screening.plan(parameters, 1, 3)
    costs = np.expm1(1.0 + 0.3 * points @ slopes)  # the screening takes log(1 + cost)
    assert costs.max() < WORST
    found = screening.effects(parameters, points, costs.tolist(), 1)
    width = 2.0 * screening.REACH
    np.testing.assert_allclose([item.mu_star for item in found], 0.3 * width * np.abs(slopes), atol=1e-9)
    np.testing.assert_allclose([item.sigma for item in found], 0.0, atol=1e-9)
    assert screening.keep([item.mu_star for item in found], 1) == {0, 2, 4}


def test_how_hard_a_fall_is_does_not_rank_the_numbers() -> None:
    parameters = _numbers(4)
    points = screening.plan(parameters, 1, 3)
    mild = np.where(points[:, 0] > 0.5, FALL, 1.0).tolist()
    hard = np.where(points[:, 0] > 0.5, 100.0 * FALL, 1.0).tolist()
    assert screening.effects(parameters, points, mild, 1) == screening.effects(parameters, points, hard, 1)


def test_a_screened_point_stays_near_the_start_and_in_the_cube() -> None:
    parameters = [
        Parameter(name=f"x{s}", path=("x",), unit="", start=s, lower=0.0, upper=1.0, digits=6)
        for s in (0.0, 0.4, 1.0)
    ]
    points = screening.plan(parameters, 3, 5)
    assert points.min() >= 0.0 and points.max() <= 1.0
    for column, parameter in zip(points.T, parameters, strict=True):
        assert np.abs(column - parameter.start).max() <= 2.0 * screening.REACH + 1e-12


@given(st.lists(st.floats(0.0, 10.0), min_size=3, max_size=12))
def test_what_is_kept_makes_up_its_share_and_is_the_largest(effects: list[float]) -> None:
    kept = screening.keep(effects, 3)
    rest = [effects[i] for i in range(len(effects)) if i not in kept]
    assert sum(effects[i] for i in kept) >= screening.KEPT_SHARE * sum(effects) * (1.0 - 1e-12)
    assert all(effects[i] >= value for i in kept for value in rest)
    assert len(kept) >= 3


# ---------------------------------------------------------------------- search


def _sphere(point: Sequence[float]) -> float:
    return float(sum((x - 0.7) ** 2 for x in point))


def _searched(search: Search, generations: int) -> list[Generation]:
    found = []
    for _ in range(generations):
        points = search.ask()
        found.append(Generation(points, [_sphere(point) for point in points]))
        search.tell(found[-1])
    return found


def test_the_search_finds_the_bottom_of_a_bowl() -> None:
    found = _searched(Search([0.2] * 6, 3), 60)
    assert min(found[-1].costs) < 1e-5 * _sphere([0.2] * 6)


def test_a_search_that_is_told_its_past_goes_on_as_if_nothing_had_been() -> None:
    whole = _searched(Search([0.3] * 8, 5), 12)
    kept = [Generation(**json.loads(json.dumps(item._asdict()))) for item in whole[:7]]
    again = Search([0.3] * 8, 5)
    np.random.seed(99)  # noqa: NPY002  # what others draw must not matter
    again.replay(kept)
    assert _searched(again, 5) == whole[7:]


def test_a_past_of_another_search_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"generation 0 .* begin anew with --force"):
        Search([0.3] * 8, 5).replay(_searched(Search([0.3] * 8, 6), 1))


# ---------------------------------------------------------------------- the whole, with a bowl for a walk


class Bowl:
    """Walks whose cost is a bowl over two numbers of the table; everything else does not matter."""

    def __init__(self) -> None:
        self.walks = 0

    def __call__(
        self,
        asks: Sequence[Ask],
        experiment: object,
        workers: object,
        *,
        reference_speed: float | None = None,
        progress: Callable[[int, int], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> list[Rating] | None:
        results = []
        for ask in asks:
            if should_stop is not None and should_stop():
                return None
            self.walks += 1
            swing = ask.table.phases["swing_flexion"].joints
            stiffness = math.radians(swing["knee"].stiffness)
            angle = math.degrees(swing["hip"].equilibrium_angle)
            hip = 2.0 + abs(angle - 45.0)
            knee = 4.0 + 20.0 * abs(math.log(stiffness / 3.0))
            values: dict[str, float | None] = {part.name: 0.0 for part in PARTS}
            values |= {"hip_error_deg": hip, "knee_error_deg": knee}
            results.append(Rating(walk_cost(values, 1.0, False), values, False, 1.0))
        return results


@pytest.fixture
def bowl(monkeypatch: pytest.MonkeyPatch) -> Bowl:
    walks = Bowl()
    monkeypatch.setattr(stages, "walk_all", walks)
    monkeypatch.setattr(stages, "rate_walks", lambda portion, on_compile: [])
    return walks


SHORT = Settings(generations=6, population=6, trajectories=2, seed=4)


def test_the_numbers_that_matter_are_found_and_brought_down(bowl: Bowl, tmp_path: Path) -> None:
    experiment = load_experiment("treadmill").experiment
    steps: list[Progress] = []
    longer = Settings(generations=25, population=8, trajectories=2)
    result = tune(experiment, tmp_path / "out", longer, progress=steps.append)
    largest = sorted(result.effects, key=lambda item: -item.mu_star)[:2]
    assert {item.name for item in largest} == {
        "swing_flexion.knee.stiffness_Nm_per_deg",
        "swing_flexion.hip.equilibrium_deg",
    }
    assert len(result.searched) == screening.FEWEST
    best = result.ranked[0].table["phases"]["swing_flexion"]
    assert best["hip"]["equilibrium_deg"] == pytest.approx(45.0, abs=1.0)
    assert best["knee"]["stiffness_Nm_per_deg"] == pytest.approx(3.0, abs=0.2)
    assert result.before is not None
    assert result.ranked[0].cost < result.before.cost
    costs = [step.best_cost for step in steps if step.stage == "search"]
    assert costs == sorted(costs, reverse=True)


@pytest.mark.parametrize("walks_before", [0, 2, 130, 250, 320])
def test_a_resumed_tuning_equals_an_undisturbed_one(bowl: Bowl, tmp_path: Path, walks_before: int) -> None:
    experiment = load_experiment("treadmill").experiment
    whole = tune(experiment, tmp_path / "whole", SHORT)
    bowl.walks = 0
    stopped = tune(experiment, tmp_path / "cut", SHORT, should_stop=lambda: bowl.walks >= walks_before)
    assert stopped.status is RunStatus.INTERRUPTED
    resumed = tune(experiment, tmp_path / "cut", SHORT, resume=True)
    assert resumed.status is RunStatus.COMPLETED
    assert resumed.searched == whole.searched
    assert resumed.effects == whole.effects
    assert [item.table for item in resumed.ranked] == [item.table for item in whole.ranked]
    kept = [json.loads((tmp_path / name / STATE_FILE).read_text()) for name in ("whole", "cut")]
    for document in kept:
        del document["elapsed_s"]
    assert kept[0] == kept[1]


def test_more_generations_go_on_from_a_finished_tuning(bowl: Bowl, tmp_path: Path) -> None:
    experiment = load_experiment("treadmill").experiment
    first = tune(experiment, tmp_path / "out", SHORT)
    more = Settings(generations=9, population=6, trajectories=2, seed=4)
    steps: list[Progress] = []
    second = tune(experiment, tmp_path / "out", more, resume=True, progress=steps.append)
    found_before = min(min(item.costs) for item in first.state.generations)
    assert next(step for step in steps if step.stage == "search").best_cost <= found_before
    assert second.state.generations[:6] == first.state.generations
    assert len(second.state.generations) == 9


def test_the_worse_half_of_a_population_does_not_walk_the_corners(bowl: Bowl, tmp_path: Path) -> None:
    experiment = load_experiment("treadmill").experiment
    settings = Settings(generations=1, population=7, screening=False)
    portions: list[list[Ask]] = []

    def noted(asks: Sequence[Ask], *rest: Any, **options: Any) -> list[Rating] | None:
        portions.append(list(asks))
        return bowl(asks, *rest, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "walk_all", noted)
        result = tune(experiment, tmp_path / "out", settings)
    nominal, corners = portions[1:3]
    assert [ask.case.name for ask in nominal] == [NOMINAL] * 7
    alone = bowl(nominal, None, None)
    assert alone is not None
    leaders = sorted(range(7), key=lambda place: nominal_cost(alone[place]))[:4]
    names = [case.name for case in search_cases(experiment)[1:]]
    assert [ask.case.name for ask in corners] == names * 4
    assert [ask.table for ask in corners[:: len(names)]] == [nominal[place].table for place in leaders]
    assert [ask.checked for ask in (*nominal, *corners)] == [False] * 7 + [True, False] * 4
    (generation,) = result.state.generations
    assert np.argsort(generation.costs).tolist()[:4] == leaders
    others = [generation.costs[place] for place in range(7) if place not in leaders]
    assert min(others) > max(generation.costs[place] for place in leaders)


def test_a_table_with_errors_is_never_a_finalist(bowl: Bowl, tmp_path: Path) -> None:
    def all_wrong(asks: Sequence[Ask], *rest: Any, **options: Any) -> list[Rating] | None:
        results = bowl(asks, *rest, **options)
        assert results is not None
        starts = stages.start_tables(load_experiment("treadmill").experiment.table)
        if {ask.table.name for ask in asks} == {item.name for item in starts}:
            return results
        wrong = Rating(1001.0, {}, False, 0.0, ("unstable",))
        return [wrong if ask.checked else item for ask, item in zip(asks, results, strict=True)]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "walk_all", all_wrong)
        settings = Settings(generations=2, population=4, screening=False)
        result = tune(load_experiment("treadmill").experiment, tmp_path / "out", settings)
    starts = [
        editable_document(item) for item in stages.start_tables(load_experiment("treadmill").experiment.table)
    ]
    assert all(item.table in starts for item in result.ranked)
    assert len(result.ranked) == len(starts)


# ---------------------------------------------------------------------- mistakes of a user


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(RunDirectoryError, match="exists; go on with --resume"):
        open_state(tmp_path, {}, resume=False, force=False)
    with pytest.raises(RunDirectoryError, match="is not a tuning"):
        open_state(tmp_path, {}, resume=False, force=True)
    with pytest.raises(RunDirectoryError, match="--resume goes on with a tuning that was begun"):
        open_state(tmp_path, {}, resume=True, force=False)
    assert (tmp_path / "note.txt").read_text() == "mine"


def test_another_tuning_cannot_be_gone_on_with(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    write_state(open_state(folder, {"seed": 1}, resume=False, force=False), folder)
    with pytest.raises(RunDirectoryError, match=r"state.json: seed: kept 1, asked for 2; .*--force"):
        open_state(folder, {"seed": 2}, resume=True, force=False)
    (folder / STATE_FILE).write_text('{"identity": {"seed": 1}}')
    with pytest.raises(RunDirectoryError, match="is not the state of a tuning"):
        open_state(folder, {"seed": 1}, resume=True, force=False)


def test_a_missing_optimiser_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import importlib.metadata

    def lost(name: str) -> str:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(tune_settings.metadata, "version", lost)
    experiment = load_experiment("treadmill").experiment
    with pytest.raises(MissingOptionalDependency, match=r"pip install 'twin-gait\[tune\]'"):
        tune(experiment, tmp_path / "out", Settings())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--reference", "winter"], "--reference 'winter': expected koopman@SPEED"),
        (["--reference", "koopman@9"], "cover 0.5 to 5 km/h, got 9"),
        (["--minutes", "0"], "minutes: expected a number above 0, got 0.0"),
        (["--seed", "-1"], "seed: expected a whole number of 0 or more, got -1"),
        (["--generations", "0"], "generations: expected 1 or more, got 0"),
        (["--workers", "0"], "--workers: expected 1 or more, got 0"),
        (["--resume", "--force"], "--resume: does not go with --force"),
        (["--workers", "1", "--scheduler", "tcp://x"], "does not go with --scheduler"),
        (["--patient", "nobody"], "no person 'nobody'"),
        (["bench_leg"], "expected a treadmill with a wearer"),
    ],
)
def test_a_mistake_is_told_in_one_line_and_makes_no_folder(
    arguments: list[str], message: str, tmp_path: Path
) -> None:
    parser = argparse.ArgumentParser()
    command.add_parser(parser.add_subparsers())
    out = tmp_path / "out"
    with pytest.raises(TwinGaitError) as raised:
        command.run(parser.parse_args(["tune", "--out", str(out), *arguments]))
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)
    assert not out.exists()


def test_the_search_walks_corners_of_the_robust_set() -> None:
    nominal = load_experiment("treadmill").experiment
    robust: Iterable[str] = [case.name for case in robust_cases(nominal)]
    assert {case.name for case in search_cases(nominal)} <= set(robust)
