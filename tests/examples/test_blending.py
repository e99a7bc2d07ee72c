"""Blending laws on simulated walks: energies balance, laws order as they must, kept results are current."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from blending import (
    BLENDS,
    LINEAR,
    MINIMUM_JERK,
    NONE,
    PANELS,
    Blend,
    comparisons,
    draw,
    measures,
    overshoot,
    robustness,
    select_switches,
    switch_effects,
    switch_rows,
    walk,
)
from numpy.testing import assert_allclose

from twin_gait import load_experiment, summarise_run
from twin_gait.core.blending import blend
from twin_gait.core.impedance import impedance_torque
from twin_gait.gait.table import TICK
from twin_gait.measures import switching
from twin_gait.measures.leg_record import leg_record
from twin_gait.measures.switching import joint_jerk, spring_energy, switching_energy
from twin_gait.report.canvas import save
from twin_gait.simulation.run import Run

RESULTS = Path(__file__).parents[2] / "examples" / "results" / "blending" / "results.json"
STEP, STRAIGHT, SMOOTH = CASES = ((NONE, 0), (LINEAR, 25), (MINIMUM_JERK, 25))
JOINTS = [(side, joint) for side in ("left", "right") for joint in ("hip", "knee")]


@pytest.fixture(scope="module")
def walks() -> dict[Blend, Run]:
    """Long enough for a stride or two that count; of a table with a blend that overshoots."""
    return {case: walk(case, 12.0, "treadmill_start_stop") for case in CASES}


@pytest.fixture(scope="module")
def table(walks: dict[Blend, Run]) -> pd.DataFrame:
    rows = [{"law": law, "duration_ms": ms, **measures(run)} for (law, ms), run in walks.items()]
    return pd.DataFrame(rows)


@pytest.fixture(scope="module")
def short() -> Run:
    return walk(SMOOTH, 5.0)


def row(table: pd.DataFrame, case: Blend) -> pd.Series:
    return table[(table["law"] == case[0]) & (table["duration_ms"] == case[1])].iloc[0]


# ---------------------------------------------------------------------- energy of a simulated walk


@pytest.mark.parametrize(("side", "joint"), JOINTS)
def test_switching_energy_balances_with_the_torque_that_was_logged(short: Run, side: str, joint: str) -> None:
    """What the spring holds in the end is what switching put in, less the work of the logged torque."""

    def column(name: str) -> np.ndarray:
        return short.log[f"{side}_{joint}_{name}"].to_numpy()

    angle, stiffness, rest = (
        column(name) for name in ("measured_angle_rad", "stiffness_Nm_per_rad", "equilibrium_rad")
    )
    damper = -column("damping_Nms_per_rad") * column("velocity_fast_rad_per_s")
    torque = column("impedance_torque_Nm") - damper
    steps = np.diff(angle)
    # Within a tick the spring yields: its torque falls by k dθ from the logged one.
    work = np.sum(torque[:-1] * steps - 0.5 * stiffness[:-1] * steps**2)
    energy = spring_energy(angle, stiffness, rest)
    injected = switching_energy(angle, stiffness, rest).sum()
    assert abs(injected) > 10.0
    assert_allclose(energy[-1] - energy[0], injected - work, atol=1e-9)


@pytest.mark.parametrize(("side", "joint"), JOINTS)
def test_all_energy_is_assigned_to_switches(short: Run, side: str, joint: str) -> None:
    effects = switch_effects(short)
    own = effects[(effects["side"] == side) & (effects["joint"] == joint)]
    columns = ("measured_angle_rad", "stiffness_Nm_per_rad", "equilibrium_rad")
    whole = switching_energy(*(short.log[f"{side}_{joint}_{name}"].to_numpy() for name in columns)).sum()
    assert len(own) == sum(item.side == side and item.tick > 0 for item in short.switches)
    assert_allclose(own["energy_J"].sum(), whole, atol=1e-9)


@pytest.mark.slow
def test_effects_in_the_summary_do_not_exceed_the_effect_of_a_switch(walks: dict[Blend, Run]) -> None:
    """By two ways: all switches of a leg here, those within the strides that count in the summary."""
    for run in walks.values():
        effects = switch_effects(run).groupby(["side", "joint"])[["torque_jump_Nm", "torque_change_Nm"]].max()
        for (side, joint), largest in effects.iterrows():
            kept = summarise_run(run)["sides"][side]["joints"][joint]
            for name, value in largest.items():
                assert 0.0 < kept[f"switch_{name}"] <= value + 1e-9


# ---------------------------------------------------------------------- laws


@pytest.mark.parametrize("law", [LINEAR, MINIMUM_JERK])
def test_blend_of_zero_duration_is_a_step_for_every_law(law: str) -> None:
    stepped, run = walk(STEP, 1.5), walk((law, 0), 1.5)
    assert len(run.switches) > 0
    pd.testing.assert_frame_equal(run.log, stepped.log, check_exact=True)


def test_blends_hold_each_law_at_each_duration_once_and_the_shipped_one() -> None:
    assert len(set(BLENDS)) == len(BLENDS) == 7
    assert {duration for law, duration in BLENDS if law == LINEAR} == {25, 60, 140}
    shipped = load_experiment("treadmill_guided").experiment.table.blending
    assert (shipped.law, shipped.duration_ticks) in BLENDS


@pytest.mark.slow
@pytest.mark.parametrize("joint", ["hip", "knee"])
def test_blending_reduces_the_jump_within_a_tick(table: pd.DataFrame, joint: str) -> None:
    stepped = row(table, STEP)[f"{joint}_torque_jump_Nm"]
    for case in (STRAIGHT, SMOOTH):
        assert row(table, case)[f"{joint}_torque_jump_Nm"] < 0.2 * stepped


@pytest.mark.parametrize("joint", ["hip", "knee"])
def test_linear_blend_has_less_jerk_than_minimum_jerk_and_a_step_the_most(
    table: pd.DataFrame, joint: str
) -> None:
    """Of parameters; a joint's jerk follows the slope of its torque, which the linear law keeps least."""
    linear, smooth, stepped = (
        row(table, case)[f"{joint}_jerk_rms_rad_per_s3"] for case in (STRAIGHT, SMOOTH, STEP)
    )
    assert linear < smooth < stepped


@pytest.mark.parametrize("cut_off", [10.0, 20.0, 50.0, 1000.0])
def test_order_of_the_laws_does_not_depend_on_the_filter(
    walks: dict[Blend, Run], cut_off: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(switching, "JERK_CUT_OFF", cut_off)
    for side, joint in JOINTS:
        mean_squares = []
        for run in (walks[STRAIGHT], walks[SMOOTH]):
            strides = leg_record(run.log, side, run.table.phase_names, TICK).strides()
            velocity = run.log[f"{side}_{joint}_velocity_rad_per_s"].to_numpy()
            jerk = joint_jerk(velocity, TICK)[strides[0, 0] : strides[-1, 1]]
            mean_squares.append(np.mean(jerk**2))
        assert mean_squares[0] < mean_squares[1]


@pytest.mark.parametrize("angle", [-0.1, 0.152, 0.9])
def test_softening_knee_with_moving_equilibrium_overshoots_by_a_known_torque(angle: float) -> None:
    """Halfway through a linear blend the torque is Δk Δθ0 / 4 below the mean of its ends, at any angle."""
    phases = load_experiment("treadmill_guided").experiment.table.phases
    old, new = (phases[name].joints["knee"] for name in ("middle_stance", "late_stance"))
    start, middle, end = (
        impedance_torque(
            angle,
            0.0,
            blend(old.stiffness, new.stiffness, share),
            0.0,
            blend(old.equilibrium_angle, new.equilibrium_angle, share),
        )
        for share in (0.0, 0.5, 1.0)
    )
    assert_allclose(middle - 0.5 * (start + end), overshoot()["torque_Nm"])


def test_selected_switch_is_the_one_in_which_a_blend_overshoots(walks: dict[Blend, Run]) -> None:
    """Late stance hands a stiff knee over to a soft one far away: k falls while θ0 moves."""
    effects = {case: switch_effects(run) for case, run in walks.items()}
    strongest, overshooting = select_switches(effects)
    assert overshooting.endswith("knee, late stance to swing flexion")
    assert strongest != overshooting
    means = [effects[case].groupby("kind")["torque_change_Nm"].mean() for case in (SMOOTH, STEP)]
    assert means[0][overshooting] > 1.3 * means[1][overshooting]


# ---------------------------------------------------------------------- picture, map, results


def test_picture_has_a_panel_for_each_measure_and_each_selected_switch(
    walks: dict[Blend, Run], table: pd.DataFrame, tmp_path: Path
) -> None:
    figure = draw(table, walks, {case: switch_effects(run) for case, run in walks.items()})
    assert len(figure.axes) == 2 + len(PANELS)
    assert len(figure.axes[0].lines) == 3
    found = {tuple(line.get_ydata()) for line in figure.axes[2].lines}
    for case in (STRAIGHT, SMOOTH):
        assert tuple(row(table, item)["hip_torque_jump_Nm"] for item in (STEP, case)) in found
    assert save(figure, tmp_path / "blending.png").read_bytes().startswith(b"\x89PNG")


def test_walk_too_short_for_a_stride_has_no_numbers() -> None:
    run = walk(SMOOTH, 0.002)
    assert np.isnan(measures(run)["hip_jerk_rms_rad_per_s3"])
    effects = switch_effects(run)
    assert effects.empty and select_switches({STEP: effects, SMOOTH: effects}) == []
    assert switch_rows(effects) == []


def test_bench_leg_is_compared_by_strides_in_the_air() -> None:
    found = measures(walk(SMOOTH, 8.0, "bench_leg"))
    assert found["outcome"] == "walked" and np.isnan(found["knee_rmse_deg"])
    assert found["knee_jerk_rms_rad_per_s3"] > 0.0


def test_outcomes_are_counted_by_blending_law() -> None:
    points = [{"duration_s": 0.2, "patient.mass_kg": mass} for mass in (60.0, 90.0)]
    found = robustness((STEP, SMOOTH), points, workers=1)
    assert list(found["law"]) == ["none", "minimum jerk"] and list(found["ms"]) == [0, 25]
    assert (found.drop(columns=["law", "ms"]).sum(axis=1) == 2).all()


@pytest.mark.slow
def test_stored_results_match_the_default_walk() -> None:
    """The shipped blending, within what another machine's last bits may do."""
    kept = json.loads(RESULTS.read_text())
    shipped = load_experiment("treadmill_guided").experiment.table.blending
    case = (str(shipped.law), shipped.duration_ticks)
    expected = kept["measures"]["_".join(map(str, case))]
    for name, value in measures(walk(case, 20.0)).items():
        assert value == (pytest.approx(expected[name], rel=0.02, abs=2e-3) if name != "outcome" else "walked")
    table = pd.DataFrame(kept["measures"].values())
    assert comparisons(table) == pytest.approx(kept["comparisons"])
