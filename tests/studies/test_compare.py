"""Tests of the comparison of controllers: numbers, texts, folder, and known effects in the simulation."""

from __future__ import annotations

import argparse
import json
import math
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest
from errors import raises

from twin_gait import load_experiment, simulate, summarise_run
from twin_gait.cli import studies as command
from twin_gait.cli.terminal import DONE
from twin_gait.control.controllers.assistance import AssistanceParameters
from twin_gait.control.safety import TripCause
from twin_gait.core.wearer_torques import passive_hip_torque, passive_knee_torque
from twin_gait.exceptions import ParameterError, RunDirectoryError, TwinGaitError
from twin_gait.experiment.experiment import Experiment
from twin_gait.studies.compare.comparison import (
    CONTROLLERS,
    TWINCARE_SHARE,
    Comparison,
    Interval,
    compare,
    draw_sample,
    find_controllers,
    interval_of,
)
from twin_gait.studies.compare.measures import run_measures
from twin_gait.studies.compare.writing import (
    PAGE_FILE,
    RUNS_FILE,
    SUMMARY_FILE,
    MeasureFormat,
    format_interval,
    shown_measures,
    write_comparison,
)
from twin_gait.vocabulary import JointName, Side

SEEDS = 3
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


# Without any effort neither a spring that gives way nor a predetermined path walks on in the soft harness.
GUIDED = "scenario.support.guide=vertical"


def walk(patient: str, duration: float, *settings: str) -> Experiment:
    return load_experiment(
        "treadmill_guided", [f"patient={patient}", f"duration_s={duration}", *settings]
    ).experiment


def with_effort(experiment: Experiment, effort: float) -> Experiment:
    patient = experiment.patient
    conditions = {
        # Without effort a strength would do nothing, which warns.
        side: replace(item, effort=effort, strength=item.strength if effort else 1.0)
        for side, item in patient.conditions.items()
    }
    return replace(experiment, patient=replace(patient, conditions=conditions))


@pytest.fixture(scope="module")
def stroke() -> Comparison:
    """A left hemiparesis with a controller that walks, one that tracks a path and one that cannot walk."""
    names = ["table", "position", "transparent"]
    return compare(walk("stroke_left", 20.0), find_controllers(names), seeds=SEEDS)


# ---------------------------------------------------------------- controllers and days


def test_every_controller_changes_the_control_alone():
    base = walk("stroke_left", 1.0)
    assert not CONTROLLERS["policy"].can_drive(base)  # without control.policy
    for controller in (item for item in CONTROLLERS.values() if item.can_drive(base)):
        changed = controller.apply_to(base)
        assert replace(changed, control=base.control) == base
    assert CONTROLLERS["table"].apply_to(base).control.mode == "impedance"
    assert CONTROLLERS["assist_as_needed"].apply_to(base).control.assistance.adaptive
    shares = CONTROLLERS["twincare"].apply_to(base).control.assistance.share
    assert set(shares.values()) == {TWINCARE_SHARE}


def test_shares_of_the_experiment_are_kept_where_assistance_is_partial():
    base = walk("stroke_left", 1.0)
    own = AssistanceParameters(share={JointName.HIP: 0.6, JointName.KNEE: 0.9})
    base = replace(base, control=replace(base.control, assistance=own))
    assert CONTROLLERS["twincare"].apply_to(base).control.assistance.share == own.share
    assert CONTROLLERS["table"].apply_to(base).control.assistance.is_full


@pytest.mark.parametrize(
    ("names", "message"),
    [([], ("none",)), (["magic"], ("magic",)), (["table", "table"], ("table, table",))],
)
def test_controllers_that_do_not_exist_are_refused(names, message):
    with raises(ParameterError, *message):
        find_controllers(names)


def test_first_day_is_the_nominal_one_and_others_stay_within_their_spread():
    base = walk("stroke_left", 1.0)
    assert draw_sample(base, 0) is base
    days = [draw_sample(base, seed) for seed in range(1, 30)]
    assert len({day.patient.mass for day in days}) == len(days)
    assert all(abs(day.patient.mass / 70.0 - 1.0) <= 0.03 for day in days)
    assert all(abs(day.scenario.belt_speed / base.scenario.belt_speed - 1.0) <= 0.03 for day in days)
    sound = (Side.RIGHT, JointName.HIP)
    assert max(day.patient.conditions[sound].effort for day in days) == 1.0
    assert draw_sample(base, 7) == draw_sample(base, 7)


def test_interval_of_three_by_hand():
    """Mean 2, standard deviation 1, Student's quantile 4.303 for two degrees of freedom (any table)."""
    found = interval_of(pd.Series([1.0, 2.0, 3.0, math.nan]))
    assert found.mean == 2.0
    assert found.half_width == pytest.approx(4.303 / math.sqrt(3.0), rel=1e-4)
    assert math.isnan(interval_of(pd.Series([1.0])).half_width)
    assert math.isnan(interval_of(pd.Series([math.nan])).mean)


@pytest.mark.parametrize(
    ("preset", "settings", "seeds", "message"),
    [
        ("bench_leg", [], 1, ("bench_leg", "--patient")),
        ("treadmill_guided", ["patient=null"], 1, ("treadmill_guided", "--patient")),
        ("treadmill_guided", [], 0, ("seeds", "1", "0")),
    ],
)
def test_incomparable_runs_are_refused(preset, settings, seeds, message):
    with raises(ParameterError, *message):
        compare(load_experiment(preset, settings).experiment, find_controllers(["table"]), seeds=seeds)


def test_stop_leaves_nothing():
    assert compare(walk("stroke_left", 1.0), find_controllers(["table"]), should_stop=lambda: True) is None


# ---------------------------------------------------------------- numbers


def test_effort_is_the_wearers_torque_without_the_passive_part(stroke):
    """Recomputed for single ticks: the log less passive moment and catch, law by law."""
    log = stroke.runs["table"].log
    for tick in (150, 4321, 15_000):
        row = log.iloc[tick]
        hip, knee, ankle = (row[f"left_{joint}_angle_rad"] for joint in ("hip", "knee", "ankle"))
        rest = row["left_hip_external_torque_Nm"] - passive_hip_torque(hip, knee)
        assert row["left_hip_voluntary_torque_Nm"] == pytest.approx(rest, abs=1e-9)
        speed = row["left_knee_velocity_rad_per_s"]
        catch = -3.0 * math.copysign(max(0.0, abs(speed) - math.radians(60.0)), speed)
        rest = row["left_knee_external_torque_Nm"] - passive_knee_torque(hip, knee, ankle) - catch
        assert row["left_knee_voluntary_torque_Nm"] == pytest.approx(rest, abs=1e-9)


def test_wearer_without_effort_has_no_voluntary_power_but_passive_losses():
    run = simulate(walk("complete_sci", 12.0))
    numbers, summary = run_measures(run), summarise_run(run)
    assert numbers["voluntary_power_W"] == 0.0 == summary["power"]["voluntary_W"]
    assert numbers["effort_rms_Nm"] == 0.0 == numbers["disturbance_power_W"]
    assert numbers["passive_power_W"] == pytest.approx(summary["power"]["passive_W"], rel=1e-12)
    assert numbers["passive_power_W"] < -0.5


def test_numbers_agree_with_the_log_by_another_way(stroke):
    """Power from the energy that left the battery, currents over the counted strides, symmetry by hand."""
    run = stroke.runs["table"]
    numbers = run_measures(run)
    energy = float(run.log["battery_power_W"].sum()) * 1e-3
    assert numbers["battery_power_W"] == pytest.approx(energy / run.duration)
    assert numbers["battery_life_h"] == pytest.approx(92.2 / numbers["battery_power_W"])
    assert numbers["energy_per_metre_J"] == pytest.approx(energy / (1.5 / 3.6 * run.duration))
    left, right = numbers["left_step_time_s"], numbers["right_step_time_s"]
    assert numbers["step_time_symmetry"] == pytest.approx((left - right) / (0.5 * (left + right)))
    assert left + right == pytest.approx(numbers["stride_time_s"], rel=0.01)
    hottest = max(
        numbers[f"{side}_{joint}_current_rms_A"] / {"hip": 43.0 / 10.9, "knee": 43.0 / 7.05}[joint]
        for side in Side
        for joint in ("hip", "knee")
    )
    assert numbers["current_rms_share"] == pytest.approx(hottest)
    works = {
        source: sum(numbers[f"{side}_{joint}_{source}_work_J"] for side in Side for joint in ("hip", "knee"))
        for source in ("wearer", "device")
    }
    assert numbers["wearer_work_share"] == pytest.approx(works["wearer"] / sum(works.values()))


def test_full_assistance_equals_the_setting(stroke):
    assert run_measures(stroke.runs["table"])["assistance_level"] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.slow
@pytest.mark.compile
def test_partial_assistance_equals_the_setting():
    partly = run_measures(simulate(CONTROLLERS["twincare"].apply_to(walk("stroke_left", 20.0))))
    assert partly["assistance_level"] == pytest.approx(TWINCARE_SHARE, rel=1e-9)


def test_fall_has_only_its_time_and_no_gait_measures(stroke):
    numbers = run_measures(stroke.runs["transparent"])
    assert set(numbers) == {"walked", "walked_s"}
    assert numbers["walked"] == 0.0 and 0.5 < numbers["walked_s"] < 5.0
    assert stroke.walked("transparent") == 0 and stroke.walked("table") == SEEDS


# ---------------------------------------------------------------- effects


def test_position_tracking_does_more_on_the_hip_than_the_table_and_costs_more(stroke):
    """For an active wearer, means over days with their intervals apart."""
    for number in ("hip_interaction_rms_Nm", "interaction_rms_Nm", "opposing_rms_Nm", "battery_power_W"):
        table, position = (stroke.interval(name, number) for name in ("table", "position"))
        if number == "opposing_rms_Nm":  # effort varies from day to day more than the controllers differ
            assert position.mean > table.mean
        else:
            assert position.mean - position.half_width > table.mean + table.half_width, number


def test_hemiparesis_is_asymmetric_and_a_healthy_walk_is_not(stroke):
    """The weak left hip moves less than the right one; sound legs move more alike."""
    lame = stroke.interval("table", "hip_range_symmetry")
    sound = compare(walk("healthy", 20.0), find_controllers(["table"]), seeds=SEEDS).interval(
        "table", "hip_range_symmetry"
    )
    assert lame.mean + lame.half_width < -(abs(sound.mean) + sound.half_width)


@pytest.mark.slow
@pytest.mark.compile
def test_more_effort_less_assistance_under_assist_as_needed():
    found = [
        compare(
            with_effort(walk("healthy", 40.0, GUIDED), effort),
            find_controllers(["assist_as_needed"]),
            seeds=SEEDS,
        )
        for effort in (0.0, 1.0)
    ]
    for joint in ("hip", "knee"):
        none, full = (item.interval("assist_as_needed", f"{joint}_assistance_level") for item in found)
        assert [item.table[f"{joint}_assistance_level"].count() for item in found] == [SEEDS, SEEDS]
        assert full.mean + full.half_width < none.mean - none.half_width
    work = [item.interval("assist_as_needed", "wearer_work_share") for item in found]
    assert work[0].mean == pytest.approx(0.0, abs=1e-9) and work[1].mean - work[1].half_width > 0.2


@pytest.mark.parametrize(
    ("settings", "walks"),
    [
        pytest.param((), False, marks=pytest.mark.slow, id="default"),
        pytest.param(("patient=healthy",), True, id="with effort"),
        pytest.param((GUIDED,), True, marks=pytest.mark.slow, id="guided"),
        pytest.param(
            ("plant.ankle={stiffness_Nm_per_rad: 200, rest_deg: 0}",),
            True,
            marks=pytest.mark.slow,
            id="stiff orthosis",
        ),
    ],
)
def test_predetermined_path_is_walked_as_documented(settings, walks):
    run = simulate(
        load_experiment("treadmill_guided", ["control.mode=position", "duration_s=20", *settings]).experiment
    )
    if walks:
        assert run.trip is None and run_measures(run)["walked"] == 1.0
    else:
        assert (run.trip.cause, run.trip.joint) == (TripCause.TORQUE, JointName.HIP)
        assert 1.5 < run.trip.time < 2.0


@pytest.mark.slow
@pytest.mark.compile
def test_effort_has_little_influence_on_position_tracking():
    """Day by day: the path is predetermined, and a wearer who works disturbs it by some of the effort."""
    found = [
        compare(
            with_effort(walk("healthy", 20.0, GUIDED), effort), find_controllers(["position"]), seeds=SEEDS
        )
        for effort in (0.0, 0.5, 1.0)
    ]
    none, *others = (item.table["interaction_rms_Nm"] for item in found)
    half, whole = (interval_of(other / none - 1.0) for other in others)
    assert 0.0 < half.mean - half.half_width and half.mean + half.half_width < 0.05
    assert half.mean + half.half_width < whole.mean - whole.half_width
    assert whole.mean + whole.half_width < 0.12
    assert [item.interval("position", "assistance_level").mean for item in found] == [1.0, 1.0, 1.0]


# ---------------------------------------------------------------- words and folder


@pytest.mark.parametrize(
    ("interval", "factor", "digits", "text"),
    [
        (Interval(0.1234, math.nan), 100.0, 1, "12.3"),
        (Interval(-0.02, 0.0061), 100.0, 1, "−2.0 ± 0.6"),
        (Interval(-0.0001, math.nan), 1.0, 1, "0.0"),
        (Interval(math.nan, math.nan), 1.0, 1, "–"),
        (Interval(math.inf, math.nan), 1.0, 1, "∞"),
    ],
)
def test_numbers_in_words(interval, factor, digits, text):
    assert format_interval(interval, MeasureFormat("", digits, "", factor)) == text


class _Cells(HTMLParser):
    """Cells of the table row by row, and where the page would fetch something."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.sources: list[str] = []
        self._inside = False

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self._inside = True
            self.rows[-1].append("")
        self.sources += [value for name, value in attrs if name in ("src", "srcset", "href")]

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self._inside = False

    def handle_data(self, data):
        if self._inside:
            self.rows[-1][-1] += data


def test_folder_contains_a_self_contained_page(stroke, tmp_path):
    out = tmp_path / "folder"
    write_comparison(stroke, "stroke_left", out)
    page = _Cells()
    page.feed((out / PAGE_FILE).read_text(encoding="utf-8"))
    assert page.sources and all(source.startswith("data:image/png;base64,") for source in page.sources)
    wide = [row for row in page.rows if len(row) == 4]
    assert wide[0][1:] == [item.title for item in stroke.controllers]
    assert wide[1] == ["walked [of 3]", "3", "3", "0"]
    assert [row[0] for row in wide[2:]] == [
        shown.label for rows in shown_measures(stroke.experiment.joints).values() for shown in rows.values()
    ]
    assert all(row[3] == "–" for row in wide[3:])  # who fell has no gait
    table = pd.read_csv(out / RUNS_FILE)
    assert len(table) == 3 * SEEDS
    document = json.loads((out / SUMMARY_FILE).read_text())
    shown = document["controllers"]["position"]["numbers"]["interaction_rms_Nm"]
    rows = table[table["controller"] == "position"]
    assert shown == pytest.approx(rows["interaction_rms_Nm"].mean(), rel=1e-12)
    assert document["controllers"]["transparent"]["numbers"]["interaction_rms_Nm"] is None
    shown_rows = [list(row.values()) for row in document["table"]]
    assert shown_rows == wide[1:]  # the table of the page


def test_folder_of_something_else_is_not_replaced(stroke, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep")
    with raises(RunDirectoryError, "mine", "--out"):
        write_comparison(stroke, "x", tmp_path / "mine", force=True)
    assert (tmp_path / "mine" / "notes.txt").read_text() == "keep"


def run_command(*words: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_parser(parser.add_subparsers())
    arguments = parser.parse_args(["compare", *words])
    status: int = arguments.run(arguments)
    return status


def test_command_writes_and_prints(tmp_path, capsys):
    out = tmp_path / "out"
    words = ("--patient", "stroke_left", "--controllers", "transparent, gravity", "--duration", "3")
    assert run_command(*words, "--out", str(out)) == DONE
    assert {path.name for path in out.iterdir()} == {PAGE_FILE, RUNS_FILE, SUMMARY_FILE, "compare.png"}
    printed = capsys.readouterr().out
    assert (
        printed.split()[:5] == ["transparent", "gravity", "walked", "[of", "1]"]
        and str(out / PAGE_FILE) in printed
    )
    with raises(RunDirectoryError, out, "--out", "--force"):
        run_command(*words, "--out", str(out))
    assert run_command(*words, "--out", str(out), "--force") == DONE


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("--controllers", "table,magic"),
            ("table", "position", "table, magic"),
        ),
        (("--patient", "nobody"), ("patient", "nobody", "healthy")),
        (("--seeds", "0"), ("seeds", "1", "0")),
        (("--duration", "-1"), ("duration_s", "0.001", "3600", "-1")),
    ],
)
def test_mistake_on_the_command_line_makes_no_folder(words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with raises(TwinGaitError, *message) as caught:
        run_command(*words)
    assert "\n" not in str(caught.value) and not list(Path().iterdir())


def test_names_in_the_help_are_the_controllers():
    assert re.split(", ", command.NAMES) == list(CONTROLLERS)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium to print with")
def test_report_prints_on_one_page_and_is_readable_on_dark_background(stroke, tmp_path):
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    write_comparison(stroke, "stroke_left", tmp_path / "folder")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        try:
            page = browser.new_page(color_scheme="dark")
            page.goto((tmp_path / "folder" / PAGE_FILE).as_uri())
            ground, ink = (
                page.evaluate(f"getComputedStyle(document.body).{name}")
                for name in ("backgroundColor", "color")
            )
            document = page.pdf(prefer_css_page_size=True)
        finally:
            browser.close()
    assert re.findall(rb"/Count (\d+)", document) == [b"1"]
    darkness, lightness = (sum(map(int, re.findall(r"\d+", colour)[:3])) for colour in (ground, ink))
    assert darkness < 120 and lightness > 500
