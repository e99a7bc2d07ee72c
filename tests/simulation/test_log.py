"""Columns of the log: each is declared once, with its unit and meaning, and found again by its name."""

from __future__ import annotations

from dataclasses import replace

import pytest

from twin_gait import load_experiment, presets, simulate
from twin_gait.gait.table import TICK
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.simulation.log import (
    GROUPS,
    WORK_SOURCES,
    LogArrays,
    log_layout,
    meaning_of,
    state_columns,
    unit_of,
    work_sources,
)
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.vocabulary import JointName, Side

HARNESS = "scenario.support.guide=harness"
BRACED = ["patient=stroke_left", "interface=brace", HARNESS]
LAYOUTS = [
    log_layout(build_setup(load_experiment(preset, given).experiment))
    for preset, given in (*((name, []) for name in presets()), ("treadmill_guided", BRACED))
]
# Unit suffixes of names, written independently of the package.
SUFFIXES = {
    "rad": "rad",
    "rad/s": "rad_per_s",
    "N·m": "Nm",
    "A": "A",
    "N·m/rad": "Nm_per_rad",
    "N·m·s/rad": "Nms_per_rad",
    "N": "N",
    "m": "m",
    "m/s": "m_per_s",
    "V": "V",
    "W": "W",
    "J": "J",
}


def test_every_column_of_every_layout_has_a_unit_and_a_meaning_that_match_its_name() -> None:
    for layout in LAYOUTS:
        declared = [
            (thing, own, meaning)
            for thing, _, kind in layout.groups
            for own, (_, meaning) in kind.columns.items()
        ]
        assert len(layout.names) == len(set(layout.names)) == len(declared)
        for name, (thing, own, meaning) in zip(layout.names, declared, strict=True):
            assert name == f"{thing}{own}" and thing in ("", f"{thing.removesuffix('_')}_")
            assert meaning_of(name) == meaning and (meaning or own == "phase")


def test_a_column_is_declared_with_one_unit_and_one_meaning() -> None:
    known: dict[str, str] = {}
    assert len(GROUPS) == 24
    for kind in GROUPS.values():
        for name, (_, meaning) in kind.columns.items():
            assert known.setdefault(name, meaning) == meaning
            unit = unit_of(f"left_{name}" if name == "phase" else name)
            assert name.endswith(f"_{SUFFIXES[unit]}") if unit in SUFFIXES else unit in ("1", "code", "name")
    assert [name for name in known if unit_of(name) == "1" and name != "phase"] == [
        "friction_compensation_gain",
        "cop_ratio",
    ]


def test_an_unknown_column_has_no_meaning() -> None:
    assert meaning_of("left_hip_colour") == ""
    assert unit_of("left_hip_friction_compensation_gain") == "1"
    assert unit_of("trip_cause") == "code" and unit_of("right_phase") == "name"
    assert unit_of("time_s") == "s"


def test_braces_and_muscles_are_sources_of_work_if_present() -> None:
    for layout in LAYOUTS:
        parts = {"brace": "pelvis_brace_force_N", "own_gait": "left_own_phase"}
        more = [source for source, column in parts.items() if column in layout.names]
        sources = (*WORK_SOURCES, *more)
        assert work_sources(layout.names) == sources
        assert {f"{name}_work_J" for name in sources} <= set(layout.names)


@pytest.mark.parametrize("given", [("bench_leg",), ("treadmill_guided",), ("treadmill_guided", HARNESS)])
def test_a_run_has_the_columns_of_its_layout_and_the_time(given: tuple[str, ...]) -> None:
    experiment = load_experiment(given[0], ["duration_s=0.02", *given[1:]]).experiment
    layout = log_layout(build_setup(experiment))
    log = simulate(experiment).log
    assert set(log.columns) == {*layout.names, "time_s"}
    assert log["time_s"].tolist() == [tick * TICK for tick in range(20)]


def test_state_columns_are_the_coordinates_of_the_model_in_its_order() -> None:
    problem = build_setup(load_experiment("treadmill_guided", BRACED).experiment)
    model: LegModel = problem.world.model
    for wearer in (False, True):
        positions, velocities = state_columns(model, wearer=wearer)
        assert len({*positions, *velocities}) == 2 * model.nv
        assert {*positions, *velocities} <= set(log_layout(problem).names)
        knee = model.index(Side.LEFT, JointName.KNEE)
        own = "wearer_" if wearer else ""
        assert positions[knee] == f"left_knee_{own}angle_rad"
        assert velocities[knee] == f"left_knee_{own}velocity_rad_per_s"
        assert model.pelvis_index is not None and model.forward_index is not None
        assert positions[model.pelvis_index] == f"{own}pelvis_height_m"
        assert positions[model.forward_index] == f"{own}pelvis_forward_m"


def test_the_table_is_made_of_the_columns_when_it_is_read() -> None:
    run = simulate(load_experiment("treadmill_guided", ["duration_s=0.05"]).experiment)
    assert isinstance(run.columns, LogArrays)
    columns = {name: run.columns[name] for name in ("time_s", "left_phase", "right_knee_angle_rad")}
    assert "pelvis_forward_m" in run.columns and "left_elbow_angle_rad" not in run.columns
    log = run.log
    assert log is run.log and run.columns is log and len(log) == 50
    assert log["time_s"].tolist() == columns["time_s"].tolist()
    assert log["right_knee_angle_rad"].tolist() == columns["right_knee_angle_rad"].tolist()
    assert log["left_phase"].cat.codes.tolist() == columns["left_phase"].tolist()
    shorter = replace(run, log=log.iloc[:20])
    assert shorter.duration == pytest.approx(0.02) and len(shorter.columns) == 20
