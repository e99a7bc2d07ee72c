"""Columns of the log: each is declared once, with its unit and meaning, and found again by its name."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from itertools import product
from typing import Any

import pytest

from twin_gait import load_experiment, simulate
from twin_gait.gait.table import TICK
from twin_gait.leg_model import LegModel
from twin_gait.simulation.engine import log_layout
from twin_gait.simulation.log import (
    BRACED_WORK_SOURCES,
    WORK_SOURCES,
    LogLayout,
    LogRow,
    columns_of,
    meaning_of,
    state_columns,
    unit_of,
    work_sources,
)
from twin_gait.simulation.problem import build_problem
from twin_gait.simulation.record import ABSENT, numbers_in
from twin_gait.vocabulary import JointName, Side

BOTH = (JointName.HIP, JointName.KNEE)
LAYOUTS = [
    LogLayout(
        legs=dict.fromkeys(sides, joints),
        passive=tuple((side, joint) for side in sides for joint in passive if joint not in joints),
        feet=sides if feet else (),
        pelvis=pelvis,
        forward=forward,
        braced=braced,
    )
    for sides, joints, passive, feet, pelvis, forward, braced in product(
        [(Side.RIGHT,), tuple(Side)],
        [BOTH[:1], BOTH, tuple(JointName)],
        [(), tuple(JointName)],
        *[[False, True]] * 4,
    )
    if pelvis or not forward
]
# How the house writes a unit at the end of a name, said a second time.
SUFFIXES = {
    "rad": "rad",
    "rad/s": "rad_per_s",
    "N m": "Nm",
    "A": "A",
    "N m/rad": "Nm_per_rad",
    "N m s/rad": "Nms_per_rad",
    "N": "N",
    "m": "m",
    "m/s": "m_per_s",
    "V": "V",
    "W": "W",
    "J": "J",
}


def declared(row: Any) -> list[tuple[str, str, str]]:
    """Field, unit and meaning of every number of a row, in order."""
    found = []
    for item in fields(row):
        value = getattr(row, item.name)
        if "unit" in item.metadata:
            found.append((item.name, item.metadata["unit"], item.metadata["meaning"]))
        elif isinstance(value, list):
            for entry in value:
                found += declared(entry) if is_dataclass(entry) else [("phase", "name", "")]
        elif value is not ABSENT:
            found += declared(value)
    return found


def test_every_column_of_every_layout_has_a_unit_and_a_meaning_and_says_them_by_its_name() -> None:
    for layout in LAYOUTS:
        columns = declared(layout.row())
        assert len(layout.names) == len(set(layout.names)) == len(columns) == len(numbers_in(layout.row()))
        for name, (own, unit, meaning) in zip(layout.names, columns, strict=True):
            ending = f"{own}_{SUFFIXES[unit]}" if unit in SUFFIXES else own
            assert name == ending or name.endswith(f"_{ending}")
            assert unit_of(name) == unit
            assert meaning_of(name) == meaning and (meaning or own == "phase")
            assert layout.positions[name] == layout.names.index(name)


def test_a_class_of_rows_declares_a_column_once() -> None:
    rows = {LogRow}
    for layout in LAYOUTS:
        for item in fields(layout.row()):
            value = getattr(layout.row(), item.name)
            rows |= {type(entry) for entry in (value if isinstance(value, list) else [value])}
    rows = {row for row in rows if is_dataclass(row)}
    assert len(rows) == 12
    for row in rows:
        units = [unit for unit, _ in columns_of(row).values()]
        assert len(columns_of(row)) == len(units) and set(units) <= {*SUFFIXES, "1", "code"}
        meanings = [meaning for _, meaning in columns_of(row).values()]
        assert all(meanings)


def test_a_name_that_is_no_column_means_nothing() -> None:
    assert meaning_of("left_hip_colour") == ""
    assert unit_of("left_hip_friction_compensation_gain") == "1"
    assert unit_of("trip_cause") == "code" and unit_of("right_phase") == "name"
    assert unit_of("time_s") == "s"


def test_braces_are_a_source_of_work_where_there_are_some() -> None:
    for layout in LAYOUTS:
        sources = BRACED_WORK_SOURCES if layout.braced else WORK_SOURCES
        assert work_sources(layout.names) == sources
        assert {f"{name}_work_J" for name in sources} <= set(layout.names)
    assert len(BRACED_WORK_SOURCES) == len(WORK_SOURCES) + 1


HARNESS = "scenario.support.guide=harness"


@pytest.mark.parametrize("given", [("bench_leg",), ("treadmill",), ("treadmill", HARNESS)])
def test_a_run_has_the_columns_of_its_layout_and_the_time(given: tuple[str, ...]) -> None:
    experiment = load_experiment(given[0], ["duration_s=0.02", *given[1:]]).experiment
    layout = log_layout(build_problem(experiment))
    log = simulate(experiment).log
    assert set(log.columns) == {*layout.names, "time_s"}
    assert log["time_s"].tolist() == [tick * TICK for tick in range(20)]


def test_state_columns_are_the_coordinates_of_the_model_in_its_order() -> None:
    settings = ["patient=stroke_left", "interface=brace", HARNESS]
    problem = build_problem(load_experiment("treadmill", settings).experiment)
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
