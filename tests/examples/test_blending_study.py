"""Blending laws on simulated walks: energies balance, laws order as they must, the page is up to date."""

from __future__ import annotations

import importlib.util
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from twin_gait import load_experiment, simulate
from twin_gait.core.blending import blend
from twin_gait.core.impedance import impedance_torque
from twin_gait.exceptions import ParameterError
from twin_gait.gait.table import TICK, Blending, BlendingLaw
from twin_gait.measures.leg_record import leg_record
from twin_gait.measures.switching import joint_jerk, spring_energy, switching_energy
from twin_gait.report.blending import PANELS, draw_blending
from twin_gait.report.canvas import save
from twin_gait.simulation.run import Run
from twin_gait.studies.blending import (
    CASES,
    BlendingComparison,
    compare_blending,
    comparison_text,
    switch_effects,
    switches_text,
    with_blending,
)

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "blending.md"
STEP, LINEAR, SMOOTH = (
    Blending(law=BlendingLaw.NONE, duration_ticks=0),
    Blending(law=BlendingLaw.LINEAR, duration_ticks=25),
    Blending(law=BlendingLaw.MINIMUM_JERK, duration_ticks=25),
)
JOINTS = [(side, joint) for side in ("left", "right") for joint in ("hip", "knee")]


def walk_of(duration: float):
    return load_experiment("treadmill", [f"duration_s={duration}"]).experiment


@pytest.fixture(scope="module")
def comparison() -> BlendingComparison:
    """Long enough for a stride or two that count."""
    return compare_blending(walk_of(9.0), (STEP, LINEAR, SMOOTH))


@pytest.fixture(scope="module")
def walk() -> Run:
    return simulate(walk_of(5.0))


@pytest.fixture(scope="module")
def two_walks() -> list[Run]:
    """The walk with a linear and with a minimum-jerk blend of the same length."""
    return [simulate(with_blending(walk_of(12.0), blending)) for blending in (LINEAR, SMOOTH)]


def row(comparison: BlendingComparison, blending: Blending) -> pd.Series:
    table = comparison.table
    same = (table["law"] == str(blending.law)) & (table["duration_ms"] == blending.duration_ticks)
    return table[same].iloc[0]


# ---------------------------------------------------------------------- energy of a simulated walk


@pytest.mark.parametrize(("side", "joint"), JOINTS)
def test_switching_energy_balances_with_the_torque_that_was_logged(walk: Run, side: str, joint: str) -> None:
    """What the spring holds in the end is what switching put in, less the work of the logged torque."""

    def column(name: str) -> np.ndarray:
        return walk.log[f"{side}_{joint}_{name}"].to_numpy()

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
def test_every_joule_belongs_to_a_switch(walk: Run, side: str, joint: str) -> None:
    effects = switch_effects(walk)
    own = effects[(effects["side"] == side) & (effects["joint"] == joint)]
    columns = ("measured_angle_rad", "stiffness_Nm_per_rad", "equilibrium_rad")
    whole = switching_energy(*(walk.log[f"{side}_{joint}_{name}"].to_numpy() for name in columns)).sum()
    assert len(own) == sum(item.side == side and item.tick > 0 for item in walk.switches)
    assert_allclose(own["energy_J"].sum(), whole, atol=1e-9)


# ---------------------------------------------------------------------- laws


@pytest.mark.parametrize("law", [BlendingLaw.LINEAR, BlendingLaw.MINIMUM_JERK])
def test_blend_of_no_length_is_a_step_whatever_its_law(law: BlendingLaw) -> None:
    experiment = walk_of(1.5)
    stepped = simulate(with_blending(experiment, STEP))
    run = simulate(with_blending(experiment, Blending(law=law, duration_ticks=0)))
    assert len(run.switches) > 0
    pd.testing.assert_frame_equal(run.log, stepped.log, check_exact=True)


def test_only_the_blending_of_an_experiment_changes() -> None:
    experiment = walk_of(2.0)
    changed = with_blending(experiment, STEP)
    assert changed != experiment
    assert replace(changed, table=replace(changed.table, blending=experiment.table.blending)) == experiment


def test_cases_hold_each_law_at_each_duration_once() -> None:
    assert len(set(CASES)) == len(CASES) == 7
    assert {case.duration_ticks for case in CASES if case.law is BlendingLaw.LINEAR} == {25, 60, 120}
    assert walk_of(1.0).table.blending in CASES


@pytest.mark.parametrize("joint", ["hip", "knee"])
def test_blending_tames_the_jump_within_a_tick(comparison: BlendingComparison, joint: str) -> None:
    stepped = row(comparison, STEP)[f"{joint}_torque_jump_Nm"]
    for blending in (LINEAR, SMOOTH):
        assert row(comparison, blending)[f"{joint}_torque_jump_Nm"] < 0.2 * stepped


@pytest.mark.parametrize("joint", ["hip", "knee"])
def test_linear_blend_has_less_jerk_than_minimum_jerk_and_a_step_the_most(
    comparison: BlendingComparison, joint: str
) -> None:
    """Of parameters; a joint's jerk follows the slope of its torque, which the linear law keeps least."""
    linear, smooth, stepped = (
        row(comparison, blending)[f"{joint}_jerk_rms_rad_per_s3"] for blending in (LINEAR, SMOOTH, STEP)
    )
    assert linear < smooth < stepped


@pytest.mark.parametrize("cut_off", [10.0, 20.0, 50.0, 1000.0])
def test_order_of_the_laws_does_not_hang_on_the_filter(two_walks: list[Run], cut_off: float) -> None:
    for side, joint in JOINTS:
        mean_squares = []
        for run in two_walks:
            strides = leg_record(run.log, side, run.table.phase_names, TICK).strides()
            velocity = run.log[f"{side}_{joint}_velocity_rad_per_s"].to_numpy()
            jerk = joint_jerk(velocity, TICK, cut_off=cut_off)[strides[0, 0] : strides[-1, 1]]
            mean_squares.append(np.mean(jerk**2))
        assert mean_squares[0] < mean_squares[1]


def test_knee_that_softens_while_its_equilibrium_leaves_overshoots_by_a_known_torque(walk: Run) -> None:
    """Halfway through a linear blend the torque is Δk Δθ0 / 4 below the mean of its ends, at any angle."""
    old, new = (walk.table.phases[name].joints["knee"] for name in ("late_stance", "swing_flexion"))
    stiffness = [blend(old.stiffness, new.stiffness, share) for share in (0.0, 0.5, 1.0)]
    rest = [blend(old.equilibrium_angle, new.equilibrium_angle, share) for share in (0.0, 0.5, 1.0)]
    for angle in (-0.1, 0.152, 0.9):
        start, middle, end = (
            impedance_torque(angle, 0.0, k, 0.0, zero) for k, zero in zip(stiffness, rest, strict=True)
        )
        closed_form = -(stiffness[2] - stiffness[0]) * (rest[2] - rest[0]) / 4.0
        assert_allclose(middle - 0.5 * (start + end), closed_form)
        assert f"these are {closed_form:.0f} N m" in PAGE.read_text()


def test_telling_switch_is_the_one_in_which_a_blend_overshoots(comparison: BlendingComparison) -> None:
    """Late stance hands a stiff knee over to a soft one far away: k falls while θ0 moves."""
    strongest, overshooting = comparison.telling_switches()
    assert overshooting.endswith("knee, late stance to swing flexion")
    assert strongest != overshooting
    of_kind = comparison.switches[comparison.switches["kind"] == overshooting]
    means = of_kind.groupby("law")["torque_change_Nm"].mean()
    assert means["minimum_jerk"] > 1.3 * means["none"]


# ---------------------------------------------------------------------- text and picture


def test_texts_have_a_line_for_every_case_and_every_kind_of_switch(comparison: BlendingComparison) -> None:
    lines = comparison_text(comparison.table).splitlines()
    assert len(lines) == 2 + 3
    assert lines[4].startswith("| minimum jerk | 25 | walked | ")
    assert len({line.count("|") for line in lines}) == 1
    kinds = comparison.switches[["from", "to", "joint"]].drop_duplicates()
    assert len(switches_text(comparison.switches).splitlines()) == 2 + len(kinds)


def test_picture_has_a_panel_for_each_measure_and_each_telling_switch(
    comparison: BlendingComparison, tmp_path: Path
) -> None:
    figure = draw_blending(comparison.table, comparison.traces, comparison.telling_switches())
    assert len(figure.axes) == 2 + len(PANELS)
    assert len(figure.axes[0].lines) == 3
    jump = figure.axes[2]
    found = {tuple(line.get_ydata()) for line in jump.lines}
    for law in (LINEAR, SMOOTH):
        ends = tuple(row(comparison, case)["hip_torque_jump_Nm"] for case in (STEP, law))
        assert ends in found
    assert save(figure, tmp_path / "blending.png").read_bytes().startswith(b"\x89PNG")


def test_walk_too_short_for_a_stride_is_compared_without_numbers(tmp_path: Path) -> None:
    found = compare_blending(walk_of(0.002), (STEP, SMOOTH))
    assert found.table["hip_jerk_rms_rad_per_s3"].isna().all()
    assert found.telling_switches() == [] and found.switches.empty
    assert "nan" in comparison_text(found.table)
    save(draw_blending(found.table, found.traces, found.telling_switches()), tmp_path / "blending.png")


def test_bench_leg_is_compared_by_strides_in_the_air() -> None:
    found = compare_blending(load_experiment("bench_leg", ["duration_s=8"]).experiment, (STEP, SMOOTH))
    assert list(found.table["outcome"]) == ["walked", "walked"]
    assert found.table["knee_rmse_deg"].isna().all()
    assert (found.table["knee_jerk_rms_rad_per_s3"] > 0.0).all()


def test_comparison_of_nothing_is_refused() -> None:
    with pytest.raises(ParameterError, match="at least one way to blend"):
        compare_blending(walk_of(1.0), ())


def test_progress_counts_the_cases() -> None:
    calls: list[tuple[int, int]] = []
    compare_blending(walk_of(0.5), (STEP, LINEAR), progress=lambda done, total: calls.append((done, total)))
    assert calls == [(1, 2), (2, 2)]


def test_example_compares_what_it_is_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = ROOT / "examples" / "compare_blending.py"
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(tmp_path, duration=8.0, cases=(STEP, SMOOTH))
    out = capsys.readouterr().out
    assert "| none | 0 | walked |" in out and "| late stance to swing flexion | knee |" in out
    assert (tmp_path / "blending.png").read_bytes().startswith(b"\x89PNG")


# ---------------------------------------------------------------------- the page


def numbers(line: str) -> list[float]:
    return [float(value) for value in re.findall(r"[+-]?\d+(?:\.\d+)?", line)]


def test_page_shows_the_default_walk_as_it_is() -> None:
    """The line of the shipped blending, within rounding and what another machine's last bits may do."""
    experiment = walk_of(20.0)
    shipped = experiment.table.blending
    expected = comparison_text(compare_blending(experiment, (shipped,)).table).splitlines()[-1]
    start = expected.split(" walks ")[0]
    (line,) = [item for item in PAGE.read_text().splitlines() if item.startswith(start)]
    # One unit of the last digit shown, and 2 %.
    assert_allclose(numbers(line), numbers(expected), rtol=0.02, atol=0.1)
