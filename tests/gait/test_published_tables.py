"""Tests of the published machines: numbers against the sources, and switches on a measured stride."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from errors import raises
from scipy.interpolate import CubicSpline

from twin_gait import load_experiment
from twin_gait.configuration.gait_table_file import load_gait_table, packaged_gait_tables
from twin_gait.exceptions import TwinGaitError
from twin_gait.gait.documents import transition_table, truth_table
from twin_gait.gait.guards import AllOf, AnyOf, parse_guard
from twin_gait.gait.machine import GaitStateMachine, PhaseSwitch
from twin_gait.gait.table import TICK, BlendingLaw, GaitTable
from twin_gait.report.state_diagram import state_diagram_svg
from twin_gait.vocabulary import GaitPhase, Side

PUBLISHED = ("sup_2009", "osl_walking")

# Sup et al. (2009), IEEE/ASME Trans. Mechatronics 14, table III, rows for 2.2 km/h:
# knee k [Nm/deg], b [Nm s/deg], θ [deg], then the ankle's, phases 0 to 4.
SUP_TABLE_III = (
    (2.5, 0.05, 8.0, 3.0, 0.04, -1.0),
    (4.0, 0.06, 6.0, 5.0, 0.04, 0.0),
    (3.0, 0.02, 14.0, 4.0, 0.01, -16.0),
    (0.15, 0.02, 65.0, 0.4, 0.05, 0.0),
    (0.10, 0.03, 40.0, 0.7, 0.03, 0.0),
)

# neurobionics/opensourceleg, examples/fsm_walking_python_controller.py, early and late stance, early and
# late swing: knee k [Nm/rad], b [Nm s/rad], θ [deg], then the ankle's.
OSL_NUMBERS = (
    (99.372, 3.180, 5.0, 19.874, 0.0, -2.0),
    (99.372, 1.272, 8.0, 79.498, 0.063, -20.0),
    (39.749, 0.063, 60.0, 7.949, 0.0, 25.0),
    (15.899, 3.816, 5.0, 7.949, 0.0, 15.0),
)

# Winter (1991), slow cadence, mean of 19 subjects, every 2 % of the stride from heel contact: knee flexion
# and ankle dorsiflexion in [deg], vertical ground force in [N/kg].
KNEE = [
    *(
        3.74,
        5.96,
        8.33,
        10.88,
        13.39,
        15.31,
        16.2,
        16.2,
        15.75,
        15.07,
        14.16,
        13.1,
        12.04,
        11.1,
        10.28,
        9.54,
        8.93,
    ),
    *(
        8.47,
        8.23,
        8.21,
        8.36,
        8.71,
        9.33,
        10.25,
        11.53,
        13.21,
        15.47,
        18.54,
        22.74,
        28.32,
        35.05,
        42.28,
        49.12,
    ),
    *(
        54.89,
        59.14,
        61.71,
        62.55,
        61.77,
        59.52,
        55.96,
        51.26,
        45.57,
        39.1,
        31.99,
        24.44,
        16.91,
        10.13,
        4.98,
        2.11,
    ),
    *(1.73, 3.21),
]
ANKLE = [
    *(
        -0.57,
        -2.83,
        -5.27,
        -6.46,
        -5.91,
        -4.18,
        -2.19,
        -0.46,
        0.96,
        2.13,
        3.07,
        3.79,
        4.35,
        4.84,
        5.34,
        5.84,
        6.29,
    ),
    *(6.71, 7.16, 7.66, 8.11, 8.43, 8.56, 8.46, 8.03, 7.14, 5.55, 3.06, -0.34, -4.47, -8.91, -13.12, -16.27),
    *(
        -17.55,
        -16.64,
        -14.0,
        -10.48,
        -6.91,
        -3.81,
        -1.34,
        0.51,
        1.59,
        1.72,
        1.11,
        0.25,
        -0.34,
        -0.45,
        -0.19,
        0.14,
    ),
    *(0.04, -0.89),
]
FORCE = [
    *(
        0.58,
        2.6,
        4.69,
        6.62,
        8.01,
        9.03,
        9.67,
        9.81,
        9.61,
        9.23,
        8.87,
        8.64,
        8.52,
        8.5,
        8.53,
        8.62,
        8.71,
        8.8,
        8.92,
    ),
    *(9.1, 9.33, 9.59, 9.85, 10.01, 9.99, 9.63, 8.74, 7.14, 5.0, 2.97, 1.42, 0.56, 0.14, 0.03),
    *([0.0] * 17),
]
STRIDE = 1.38  # [s], of a cadence of 86.8 steps a minute; it only scales the velocities and the stays
PERCENT = np.linspace(0.0, 100.0, 51)


@pytest.mark.parametrize(("name", "numbers"), [("sup_2009", SUP_TABLE_III), ("osl_walking", OSL_NUMBERS)])
def test_impedances_equal_the_published_values(name: str, numbers: tuple[tuple[float, ...], ...]) -> None:
    table = load_gait_table(name)
    per_radian = 180.0 / math.pi if name == "sup_2009" else 1.0
    assert table.joints == ("knee", "ankle")
    for parameters, row in zip(table.phases.values(), numbers, strict=True):
        for joint, (k, b, angle) in zip(("knee", "ankle"), (row[:3], row[3:]), strict=True):
            found = parameters.joints[joint]
            assert found.stiffness == pytest.approx(k * per_radian, rel=1e-12)
            assert found.damping == pytest.approx(b * per_radian, rel=1e-12)
            assert found.equilibrium_angle == pytest.approx(math.radians(angle), rel=1e-12)


@pytest.mark.parametrize("name", PUBLISHED)
def test_features_missing_in_the_sources_are_off(name: str) -> None:
    table = load_gait_table(name)
    assert table.blending.law is BlendingLaw.NONE
    for parameters in table.phases.values():
        assert parameters.gravity_compensation == 0.0
        assert {joint.friction_compensation_gain for joint in parameters.joints.values()} == {0.0}


def test_phases_are_the_five_of_sup_and_the_four_of_the_open_source_leg() -> None:
    assert load_gait_table("sup_2009").phase_names == tuple(str(item) for item in GaitPhase)
    names = load_gait_table("osl_walking").phase_names
    assert names == ("early_stance", "late_stance", "early_swing", "late_swing")


# The four conditions of FSMController.m, written on the load cell's force in [N] (compression negative) with
# the 60 kg and 9.8 m/s² of its test bench, angles in degrees, and the least time in a state.
BODY_WEIGHT = 60.0 * 9.8


def matlab_leaves(state: int, force: float, knee: float, knee_velocity: float, ankle: float) -> bool:
    if state == 0:
        return force < -0.25 * BODY_WEIGHT and ankle > 6.0
    if state == 1:
        return force > -0.15 * BODY_WEIGHT
    if state == 2:
        return knee > 50.0 and knee_velocity < 3.0
    return force < -0.40 * BODY_WEIGHT or knee < 30.0


def test_open_source_leg_switches_where_its_matlab_source_does() -> None:
    """Random measurements, written in newtons for the source and in body weights for the table."""
    table = load_gait_table("osl_walking")
    rng = np.random.default_rng(3)
    left = 0
    for _ in range(3000):
        state = int(rng.integers(4))
        force = -BODY_WEIGHT * rng.uniform(0.0, 0.6)
        knee, ankle, velocity = rng.uniform(0, 70), rng.uniform(-10, 20), rng.uniform(-60, 60)
        machine = GaitStateMachine(table, Side.LEFT, initial_phase=table.phase_names[state])
        signals = measured((knee, ankle), (velocity, 0.0), -force / BODY_WEIGHT)
        assert machine.step(199, signals) is None  # the least time in a state is 0.2 s
        switch = machine.step(200, signals)
        assert (switch is not None) == matlab_leaves(state, force, knee, velocity, ankle)
        left += switch is not None
        if switch is not None:
            assert switch.target == table.phase_names[(state + 1) % 4]
    assert 500 < left < 2500


def periodic(values: list[float]) -> CubicSpline:
    return CubicSpline(PERCENT, [*values[:-1], values[0]], bc_type="periodic")


def measured(angles: Sequence[float], velocities: Sequence[float], load: float) -> dict[str, float]:
    """Signals of knee and ankle in degrees, and of the foot."""
    found = {"foot.load_bw": load}
    for joint, angle, velocity in zip(("knee", "ankle"), angles, velocities, strict=True):
        found |= {f"{joint}.angle_deg": angle, f"{joint}.velocity_deg_per_s": velocity}
    return found


@cache
def stride_signals() -> list[dict[str, float]]:
    """One stride of slow walking, tick by tick."""
    percent = np.arange(0.0, STRIDE, TICK) / STRIDE * 100.0
    curves = [periodic(KNEE), periodic(ANKLE)]
    angles = np.array([curve(percent) for curve in curves])
    velocities = np.array([curve(percent, 1) for curve in curves]) * 100.0 / STRIDE
    load = np.clip(periodic(FORCE)(percent), 0.0, None) / 9.81
    return [measured(angles[:, k], velocities[:, k], float(load[k])) for k in range(len(percent))]


def replay(table: GaitTable, strides: int = 4) -> list[PhaseSwitch]:
    """Run a machine over strides of slow walking, from heel contact on."""
    machine = GaitStateMachine(table, Side.LEFT)
    signals = stride_signals()
    switches = [machine.step(tick, signals[tick % len(signals)]) for tick in range(1, strides * len(signals))]
    return [item for item in switches if item is not None]


def instants(switches: list[PhaseSwitch]) -> dict[str, float]:
    """Instant of each cause in [%] of the stride, over the settled strides, which are all alike."""
    length = len(stride_signals())
    found: dict[str, set[int]] = {}
    for item in switches:
        if item.tick >= length:
            found.setdefault(item.cause, set()).add(item.tick % length)
    assert all(len(ticks) == 1 for ticks in found.values()), found
    return {cause: 100.0 * ticks.pop() / length for cause, ticks in found.items()}


def crossing(values: list[float], level: float, first: float, *, rising: bool) -> float:
    """Where a curve, drawn straight from point to point, first crosses a level after an instant, in [%]."""
    fine = np.arange(first, 100.0, 0.01)
    curve = np.interp(fine, PERCENT, values)
    beyond = curve > level if rising else curve < level
    return float(fine[np.flatnonzero(beyond)[0]])


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_measured_stride_passes_through_each_machine_once(name: str) -> None:
    table = load_gait_table(name)
    switches = replay(table)
    order = list(table.phase_names)
    for item in switches:
        assert item.target == order[(order.index(item.source) + 1) % len(order)]
    settled = [item for item in switches if item.tick >= len(stride_signals())]
    assert len(settled) == 3 * len(order)


def test_phases_of_sup_begin_where_the_stride_crosses_the_thresholds() -> None:
    found = instants(replay(load_gait_table("sup_2009")))
    expected = {
        "foot_flat": crossing(ANKLE, 1.0, 8.0, rising=True),
        "dorsiflexed": crossing(ANKLE, 8.0, 20.0, rising=True),
        "toe_off": crossing(FORCE, 0.05 * 9.81, 50.0, rising=False),
        "knee_extends": float(PERCENT[int(np.argmax(KNEE))]),
        "heel_strike": crossing(FORCE, 0.10 * 9.81, 0.0, rising=True),
    }
    assert found == pytest.approx(expected, abs=1.0)  # spline against straight lines, half a sample
    # The impedances were fitted to phases that begin at about these instants.
    assert 14.0 < found["foot_flat"] < 18.0
    assert 38.0 < found["dorsiflexed"] < 42.0


def test_phases_of_the_open_source_leg_begin_at_thresholds_or_after_the_minimum_duration() -> None:
    table = load_gait_table("osl_walking")
    found = instants(replay(table))
    stay = 100.0 * table.phases["early_swing"].minimum_ticks / len(stride_signals())
    unloaded = crossing(FORCE, 0.15 * 9.81, 50.0, rising=False)
    flexed = float(PERCENT[int(np.argmax(KNEE))])
    expected = {
        "dorsiflexed_under_load": crossing(ANKLE, 6.0, 20.0, rising=True),
        "unloaded": unloaded,
        "knee_flexed": max(flexed, unloaded + stay),
        "landing": max(crossing(KNEE, 30.0, 80.0, rising=False), max(flexed, unloaded + stay) + stay),
    }
    assert found == pytest.approx(expected, abs=1.0)
    assert found["knee_flexed"] > flexed + 2.0  # the minimum duration of 0.2 s decides at this cadence


def reading(cause: str, join: type[AllOf] | type[AnyOf], *guards: str) -> dict[str, float]:
    """Instants of the Open-Source Leg's machine with another condition, without minimum durations."""
    table = load_gait_table("osl_walking")
    parts = tuple(parse_guard(text) for text in guards)
    changed = tuple(
        dataclasses.replace(item, guard=join(guards=parts)) if item.cause == cause else item
        for item in table.transitions
    )
    free = {name: dataclasses.replace(item, minimum_ticks=0) for name, item in table.phases.items()}
    return instants(replay(dataclasses.replace(table, transitions=changed, phases=free)))


def test_other_readings_of_the_open_source_leg_switch_elsewhere() -> None:
    """C++: late stance ends at 25 %, landing needs load and knee; Python: the knee's 3 are rad/s."""
    matlab = reading("unloaded", AllOf, "foot.load_bw < 0.15")
    early = reading("unloaded", AllOf, "foot.load_bw < 0.25")
    both = reading("landing", AllOf, "foot.load_bw > 0.40", "knee.angle_deg < 30")
    fast = f"knee.velocity_deg_per_s < {math.degrees(3.0)}"
    python = reading("knee_flexed", AllOf, "knee.angle_deg > 50", fast)
    assert early["unloaded"] < matlab["unloaded"] - 1.0
    assert matlab["landing"] > 80.0
    assert both["landing"] == pytest.approx(crossing(FORCE, 0.40 * 9.81, 0.0, rising=True), abs=1.0)
    assert python["knee_flexed"] < matlab["knee_flexed"] - 2.0


@pytest.mark.parametrize("name", PUBLISHED)
def test_missing_ankle_drive_is_reported_in_one_line(name: str) -> None:
    with raises(TwinGaitError, "plant.actuators.ankle", name) as caught:
        load_experiment("treadmill_guided", [f"table={name}"])
    assert len(str(caught.value).splitlines()) == 1


DOCS = Path(__file__).parents[2] / "docs" / "images"


@pytest.mark.parametrize("name", PUBLISHED)
def test_page_of_the_published_machines_matches_the_tables(name: str) -> None:
    """If this fails, write the tables into the page again: twin-gait diagram NAME --format truth."""
    table = load_gait_table(name)
    page = (DOCS.parent / "background" / "published_machines.md").read_text("utf-8").splitlines()
    for text in (transition_table(table), truth_table(table)):
        lines = [line for line in text.splitlines() if line.startswith(("| ", "- "))]
        assert [line for line in lines if line not in page] == []


def drawn_texts(svg: str) -> list[str]:
    return [
        "".join(item.itertext()) for item in ElementTree.fromstring(svg).iter() if item.tag.endswith("text")
    ]


@pytest.mark.parametrize("path", sorted(DOCS.glob("*.svg")), ids=lambda path: path.stem)
def test_drawings_in_the_documentation_match_the_shipped_tables(path: Path) -> None:
    """If this fails, draw it again: twin-gait diagram NAME --format svg > docs/images/NAME.svg."""
    if path.stem not in packaged_gait_tables():
        pytest.skip("not the drawing of a gait table")
    expected = state_diagram_svg(load_gait_table(path.stem))
    assert drawn_texts(path.read_text("utf-8")) == drawn_texts(expected)


@pytest.mark.parametrize("name", ["sup_2009", "osl_walking"])
def test_the_page_shows_the_output_of_the_check(name, capsys):
    from twin_gait.cli import main

    assert main(["check", name]) == 0
    page = (Path(__file__).parents[2] / "docs" / "background" / "published_machines.md").read_text(
        encoding="utf-8"
    )
    assert capsys.readouterr().out.rstrip() in page
