"""Pages without a browser: what they hold, how the command line refuses, who may read them."""

import http.client
import json
import re
import shutil
import socket
import stat
import webbrowser
import zlib
from base64 import b64decode
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pandas as pd
import pytest
from errors import raises
from example_robots import JOINTS
from page_server import served
from scene_messages import unpacked

from twin_gait import load_experiment, simulate
from twin_gait.cli import main
from twin_gait.cli.view import announce
from twin_gait.exceptions import ViewerError
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.palette import (
    EVENT_COLOUR,
    EVENT_ON_DARK,
    EXTENSION_COLOUR,
    FLEXION_COLOUR,
    HELD_COLOUR,
    JOINT_COLOURS,
    LIMIT_COLOUR,
    PHASE_COLOURS,
    REFERENCE_COLOUR,
    SIDE_COLOURS,
    SIDE_COLOURS_ON_DARK,
    TORQUE_COLOURS,
    phase_colour,
)
from twin_gait.runs.record import read_stored_run, write_run
from twin_gait.runs.run_page import page_texts, render_run_page
from twin_gait.runs.stored_run import StoredRun
from twin_gait.viewer.animation import urdf_page
from twin_gait.viewer.commands import CommandBuffer
from twin_gait.viewer.environment import MATERIALS
from twin_gait.viewer.figure import ROOT
from twin_gait.viewer.motion import (
    extremes,
    frame_rate,
    leg_values,
    phase_changes,
    read_motion,
    simplify_curve,
)
from twin_gait.viewer.page import FLOOR, PAGE_FOLDER, PageTexts, encode_compressed, live_page, page_data
from twin_gait.viewer.picture import BROWSER_VARIABLE, find_browser, take_picture
from twin_gait.viewer.scene import View, build_scene
from twin_gait.vocabulary import FIRST_SWING, STAND, GaitPhase, Side


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory) -> Path:
    """A short run of the bench leg, as it lies on the disk."""
    folder = tmp_path_factory.mktemp("runs") / "bench"
    folder.mkdir()
    settings = ["duration_s=2.0", "engine=pinocchio"]
    write_run(simulate(load_experiment("bench_leg", settings).experiment), folder, pictures=False)
    return folder


def embedded(page: str) -> dict:
    found = re.search(r'id="page-data">([^<]*)</script>', page)
    assert found
    return json.loads(found[1])


def frames_of(entry: dict) -> dict:
    return json.loads(zlib.decompress(b64decode(entry["frames"])))


def curve_of(frames: dict, key: str, leg: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Ticks and values of a curve, as the script of the page unfolds them."""
    series = frames["legs"][leg]["series"][key]
    return np.cumsum(series["steps"]), np.array(series["values"], dtype=float)


def entries(phases: list[str]) -> list[dict]:
    view = View(target=(0.0, 0.0, 0.0), width=1.0, height=1.0)
    return page_data(PageTexts(title=""), mode="live", view=view, phases=phases)["phases"]


# ---------------------------------------------------------------------------------- what a page holds


def test_a_page_has_a_frame_at_every_transition_and_its_numbers_are_the_logs(run_folder: Path) -> None:
    shown = read_stored_run(run_folder)
    (entry,) = embedded(render_run_page([shown], frame_times=[1.2345]))["runs"]
    frames = frames_of(entry)
    transitions, log = pd.read_csv(run_folder / "transitions.csv"), shown.run.log
    assert len(transitions) >= 3
    assert set(transitions["tick"]) <= set(frames["times"])
    assert 1235 in frames["times"]  # the first row that is not before the requested time
    assert frames["times"][0] == 0 and frames["times"][-1] == len(log) - 1
    for key, column in (("hip", "angle_rad"), ("hip_torque", "motor_torque_Nm"),
                        ("hip_impedance", "impedance_torque_Nm"),
                        ("hip_friction_compensation", "friction_compensation_torque_Nm"),
                        ("hip_gravity_compensation", "gravity_compensation_torque_Nm")):  # fmt: skip
        ticks, seen = curve_of(frames, key)
        assert set(frames["times"]) <= set(ticks.tolist())
        values = log[f"right_hip_{column}"].to_numpy()[ticks]
        expected = np.degrees(values) if key == "hip" else values
        np.testing.assert_allclose(seen, expected, rtol=0.0, atol=5.1e-5)


@pytest.mark.parametrize("frames_per_second", [30.0, 10.0, 1.0])
def test_curves_have_the_peaks_of_the_log_however_few_frames_there_are(
    run_folder: Path, frames_per_second: float
) -> None:
    run = read_stored_run(run_folder).run
    log, model = run.log, run.experiment.build_world().model
    curves = read_motion(log, model, frames_per_second=frames_per_second).legs[Side.RIGHT].curves
    values = leg_values(log, Side.RIGHT)
    assert set(curves) <= set(values) and len(curves) >= 8
    clock = log["time_s"].to_numpy()
    for key, curve in curves.items():
        drawn, truth = np.interp(clock, *curve), values[key]
        # Within 0.2 % of its range everywhere, so every peak above a fifth of it within 1 %.
        assert np.abs(drawn - truth).max() <= 0.002 * np.ptp(truth) + 1e-9, key
        assert len(curve.times) < len(clock) / 2


def test_a_curve_ends_where_the_log_has_no_number() -> None:
    values = np.array([0.0, 1.0, 2.0, np.nan, np.nan, 5.0, 5.0, 9.0, 5.0])
    curve = simplify_curve(np.arange(9.0), values, np.array([0, 8]))
    assert curve.times.tolist() == [0, 2, 3, 4, 5, 6, 7, 8]
    np.testing.assert_array_equal(np.isnan(curve.values), [False, False, True, True, *4 * [False]])


def test_extremes_of_a_span_come_in_their_order() -> None:
    rows, found = extremes(np.array([[0.0], [7.0], [-2.0], [1.0], [1.0], [3.0], [3.5]]))
    assert rows.ravel().tolist() == [1, 2, 5, 6]
    assert found.ravel().tolist() == [7.0, -2.0, 3.0, 3.5]


@pytest.fixture(scope="module")
def tripped(tmp_path_factory) -> Path:
    """A walk whose left knee encoder freezes."""
    folder = tmp_path_factory.mktemp("runs") / "tripped"
    folder.mkdir()
    settings = ["duration_s=3", "faults=[encoder_freeze:left_knee@1.0s]"]
    write_run(simulate(load_experiment("treadmill_guided", settings).experiment), folder, pictures=False)
    return folder


def test_a_hold_replaces_the_phases_and_the_page_shows_the_events_of_the_run(tripped: Path) -> None:
    stored, summary, _ = read_stored_run(tripped)
    trip = stored.trip
    assert trip is not None and 1.0 <= trip.time < 3.0
    (entry,) = embedded(render_run_page([read_stored_run(tripped)]))["runs"]
    assert [(one["kind"], one["time"]) for one in entry["events"]] == [("fault", 1.0), ("trip", trip.time)]
    assert entry["events"][1]["text"] == "trip: encoder frozen, left knee"
    assert entry["outcome"] == stored.verdict.outcome == "held"
    assert [one["label"] for one in entry["phases"]][-1] == "Hold"
    frames = frames_of(entry)
    assert {1000, trip.tick} <= set(frames["times"])
    for leg in frames["legs"]:
        assert leg["phases"]["codes"][-1] == len(entry["phases"]) - 1
        assert leg["phases"]["starts"][-1] == trip.tick / 1000  # the page writes milliseconds
    # A run without a trip has neither.
    harmless = replace(stored.experiment, faults=())
    before = replace(stored, experiment=harmless, log=stored.log.iloc[:900], trip=None)
    (calm,) = embedded(render_run_page([StoredRun(before, summary)]))["runs"]
    assert calm["events"] == [] and "Hold" not in [one["label"] for one in calm["phases"]]


def test_page_shows_the_note_on_the_belt_and_the_measures_of_the_walk(run_folder: Path) -> None:
    stored = read_stored_run(run_folder).run
    power = {"belt_W": 9.0, "motors_W": 1.0, "voluntary_W": 0.0, "guide_W": 0.0, "guide_force_N": 21.6}
    leg = {"walk": {"trough": 0.5}, "strides_counted": 3, "errors": {}, "stride_time_mean_s": None}
    summary = {
        "sides": {"left": leg, "right": leg},
        "walk_reference": {"trough": 0.8},
        "power": {**power, "belt_driven": True},
    }
    (entry,) = embedded(render_run_page([StoredRun(stored, summary)]))["runs"]
    assert entry["notes"][0].startswith("The belt drives this walk")
    assert entry["walk"] == [
        ["", "left", "right", "healthy"],
        ["load trough [carried weight]", "0.500", "0.500", "0.800"],
    ]
    summary["power"]["belt_driven"] = False
    assert page_texts(StoredRun(stored, summary)).get("notes") == []


def test_parts_that_a_run_does_not_use_are_left_out(bench: LegModel) -> None:
    log = pd.DataFrame({"time_s": [0.0, 0.001], "safety_state": 0.0})
    log["right_phase"] = pd.Categorical(["early_stance"] * 2)
    for joint in ("hip", "knee"):
        log[f"right_{joint}_angle_rad"] = 0.1
        for part in ("motor", "impedance", "target"):
            log[f"right_{joint}_{part}_torque_Nm"] = 0.0 if joint == "hip" or part != "target" else 2.0
    leg = read_motion(log, bench).legs[Side.RIGHT]
    assert "hip_target" not in leg.curves  # zero all the time
    np.testing.assert_array_equal(leg.curves["knee_target"].values, 2.0)
    np.testing.assert_array_equal(leg.curves["hip_impedance"].values, 0.0)


def test_frames_of_a_long_run_are_fewer_a_second() -> None:
    assert frame_rate(20.0) == 30.0
    assert frame_rate(3600.0) * 3600.0 == pytest.approx(3000.0)


def test_changes_of_phase_are_found_on_both_legs() -> None:
    log = pd.DataFrame({"time_s": [5.0, 5.001, 5.002, 5.003], "left_phase": list("aabb"),
                        "right_phase": list("abbb"), "safety_state": 0.0})  # fmt: skip
    np.testing.assert_allclose(phase_changes(log), [0.001, 0.002], atol=1e-12)
    assert phase_changes(log.drop(columns=["left_phase", "right_phase"])).size == 0


def test_two_runs_get_their_frames_at_the_same_moments(run_folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    settings = ["duration_s=1.5", "engine=pinocchio", "table.phases.late_stance.hip.equilibrium_deg=-9"]
    write_run(simulate(load_experiment("bench_leg", settings).experiment), other, pictures=False)
    first, second = embedded(render_run_page([read_stored_run(run_folder), read_stored_run(other)]))["runs"]
    long, short = frames_of(first)["times"], frames_of(second)["times"]
    assert set(short) - set(long) <= {1499}  # the last row of the shorter run
    assert [time for time in long if time < 1499] == [time for time in short if time < 1499]


def test_phases_are_also_distinguished_by_letters() -> None:
    assert [one["short"] for one in entries([str(p) for p in GaitPhase])] == ["ES", "MS", "LS", "SF", "SE"]
    # Where two phases would share their letters all get numbers.
    assert [one["short"] for one in entries(["stance", "swing", "early_swing"])] == ["1", "2", "3"]


def contrast(first: str, second: str) -> float:
    """Contrast ratio of WCAG 2.2, written from its definition."""

    def luminance(colour: str) -> float:
        linear = []
        for start in (1, 3, 5):
            value = int(colour[start : start + 2], 16) / 255
            linear.append(value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4)
        return float(np.dot([0.2126, 0.7152, 0.0722], linear))

    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


def test_letters_can_be_read_on_every_phase() -> None:
    for one in entries([str(phase) for phase in GaitPhase]):
        assert contrast(one["colour"], one["ink"]) > 4.0, one["label"]
        assert contrast(one["colour"], one["ink"]) >= contrast(one["colour"], "#ffffff")


def light_of(colour: str) -> np.ndarray:
    """Linear shares of red, green and blue light."""
    return np.array([(int(colour[i : i + 2], 16) / 255) ** 2.2 for i in (1, 3, 5)])


def lab(colour: str) -> np.ndarray:
    """CIELAB of a colour."""
    return lab_of_light(light_of(colour))


def as_seen_without(cone: str, colour: str) -> np.ndarray:
    """CIELAB of a colour as seen without one kind of cone (Viénot, Brettel and Mollon 1999)."""
    linear = light_of(colour)
    to_lms = np.array(
        [[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]]
    )
    drop = {"red": [[0, 2.02344, -2.52581], [0, 1, 0], [0, 0, 1]],
            "green": [[1, 0, 0], [0.494207, 0, 1.24827], [0, 0, 1]]}[cone]  # fmt: skip
    return lab_of_light(np.clip(np.linalg.inv(to_lms) @ np.array(drop) @ to_lms @ linear, 0.0, 1.0))


def lab_of_light(seen: np.ndarray) -> np.ndarray:
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ seen
    f = np.cbrt(xyz / np.array([0.9505, 1.0, 1.089]))
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("cone", ["red", "green"])
def test_phase_colours_differ_for_colour_blind_people(cone: str) -> None:
    seen = {phase: as_seen_without(cone, phase_colour(str(phase))) for phase in PHASE_COLOURS}
    for first, second in combinations(PHASE_COLOURS, 2):
        # A difference of 2.3 is just noticeable; side by side in a band it takes several times that.
        assert np.linalg.norm(seen[first] - seen[second]) > 9.0, (first, second)


MEANINGS = {
    "phase": {str(phase): phase_colour(str(phase)) for phase in (*GaitPhase, STAND, FIRST_SWING)},
    "further phase": {str(k): phase_colour("of a user", k) for k in range(5)},
    "side": {str(side): colour for side, colour in SIDE_COLOURS.items()},
    "joint": {str(joint): colour for joint, colour in JOINT_COLOURS.items()},
    "arrow": {"flexion": FLEXION_COLOUR, "extension": EXTENSION_COLOUR},
    "torque": dict(TORQUE_COLOURS),
    "line": {"reference": REFERENCE_COLOUR, "limit": LIMIT_COLOUR},
    "event": {"hold": EVENT_COLOUR, "held": HELD_COLOUR},
}
ON_DARK = MEANINGS | {
    "side": {str(side): colour for side, colour in SIDE_COLOURS_ON_DARK.items()},
    "event": {"hold": EVENT_ON_DARK},
}


@pytest.mark.parametrize("meanings", [MEANINGS, ON_DARK], ids=["light", "dark"])
def test_no_two_meanings_share_a_colour(meanings: dict[str, dict[str, str]]) -> None:
    named = {(group, name): colour for group, one in meanings.items() for name, colour in one.items()}
    assert len(named) >= 25
    for (first, first_colour), (second, second_colour) in combinations(named.items(), 2):
        apart = np.linalg.norm(lab(first_colour) - lab(second_colour))
        # 2.3 is just noticeable; side by side six times that is another colour to anybody.
        assert apart > 14.0, (first, second)


@pytest.mark.parametrize("cone", ["red", "green"])
@pytest.mark.parametrize("meanings", [MEANINGS, ON_DARK], ids=["light", "dark"])
def test_adjacent_colours_differ_for_colour_blind_people(cone: str, meanings: dict) -> None:
    for group in ("side", "joint", "arrow", "torque"):
        for first, second in combinations(meanings[group].values(), 2):
            apart = np.linalg.norm(as_seen_without(cone, first) - as_seen_without(cone, second))
            assert apart > 9.0, (group, first, second)


def test_the_page_has_the_colours_of_the_palette_and_legs_the_colours_of_sides(run_folder: Path) -> None:
    page = render_run_page([read_stored_run(run_folder)])
    (entry,) = embedded(page)["runs"]
    (leg,) = entry["legs"]
    assert (leg["colour"], leg["dark"]) == (SIDE_COLOURS[Side.RIGHT], SIDE_COLOURS_ON_DARK[Side.RIGHT])
    assert [arc["colour"] for arc in entry["arcs"]] == [FLEXION_COLOUR, EXTENSION_COLOUR]
    # The page's own furniture borrows none of them.
    style = page[page.index("<style>") : page.index("</style>")].lower()
    assert EVENT_COLOUR.lower() in style and EVENT_ON_DARK.lower() in style
    for group in ("phase", "side", "torque", "arrow"):
        for colour in (*MEANINGS[group].values(), *ON_DARK[group].values()):
            assert colour.lower() not in style


def test_the_floor_darkened_by_a_dark_page_is_in_the_scene(worn_twin: LegModel) -> None:
    recorder = CommandBuffer()
    build_scene(recorder, worn_twin)
    assert any(c["type"] == "set_object" and c["path"] == FLOOR for c in recorder.commands())


def test_harness_and_trunk_have_contrast_in_the_dark_theme() -> None:
    script = (PAGE_FOLDER / "stage.js").read_text(encoding="utf-8")
    found = re.search(r"DARK_THEME = \{ top: \[([^]]*)\]", script)
    assert found
    night = "#" + "".join(f"{round(255 * float(share)):02x}" for share in found[1].split(","))
    for material, least in (("vest", 3.0), ("cloth", 4.5), ("rope", 2.5)):
        shown = "#" + "".join(f"{round(255 * share):02x}" for share in MATERIALS[material].colour)
        assert contrast(shown, night) > least


def test_page_contains_every_script_and_no_other_file() -> None:
    page = (PAGE_FOLDER / "page.html").read_text(encoding="utf-8")
    assert {path.name for path in PAGE_FOLDER.glob("*.js")} == set(re.findall(r'include "(\w+\.js)"', page))
    for path in PAGE_FOLDER.glob("*.js"):
        script = path.read_text(encoding="utf-8")
        assert not re.search(r"</script|<!--|\{[{%#]", script, re.IGNORECASE), (
            path
        )  # it cannot end its element


def test_a_live_page_takes_a_panel_after_its_own_script(monkeypatch, tmp_path) -> None:
    folder = shutil.copytree(PAGE_FOLDER, tmp_path / "page")
    parts = {"css": "#knobs { top: 0 }", "html": '<div id="knobs"></div>', "js": "'the panel'"}
    for kind, text in parts.items():
        (folder / f"panel.{kind}").write_text(text)
    monkeypatch.setattr("twin_gait.viewer.page.PAGE_FOLDER", folder)
    page = live_page()
    assert page.index("#knobs {") < page.index("</style>")
    assert '<div id="knobs"></div>' in page
    assert page.index("window.twinGait =") < page.index("'the panel'")


def test_packing_is_lossless() -> None:
    content = bytes(range(256)) * 9
    assert zlib.decompress(b64decode(encode_compressed(content))) == content


# ---------------------------------------------------------------------------------- command line


def fails_in_one_line(capsys, *arguments: str) -> str:
    capsys.readouterr()
    try:
        status = main(["view", *arguments])
    except SystemExit as leave:
        status = leave.code
    captured = capsys.readouterr()
    assert status == 2
    assert captured.out == "" and captured.err.count("\n") == 1 and "Traceback" not in captured.err
    return captured.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["RUN", "RUN", "RUN"], "one or two run directories"),
        (["RUN", "nowhere"], "nowhere"),
        (["RUN", "--at", "9", "--png", "NEW"], "0 to 2.000"),
        (["RUN", "--at", "-1", "--png", "NEW"], "--at"),
        (["RUN", "--at", "nan", "--png", "NEW"], "--at"),
        (["RUN", "--at", "soon"], "soon"),
        (["RUN", "--out", "OLD"], "--force"),
        (["RUN", "--out", "FOLDER"], "directory"),
        (["RUN", "--png", "FOLDER/nowhere/a.png"], "no directory"),
        (["twin.urdf", "--png", "NEW", "--at", "1"], "without --at"),
        (["twin.urdf", "--out", "OLD"], "--force"),
        (["twin.urdf", "--up", "w"], "--up"),
        (["RUN", "--up", "y"], "applies to a URDF"),
        (["twin.urdf", "RUN"], "URDF"),
        (["RUN", "--port", "-1"], "65535"),
    ],
)
def test_wrong_values_give_one_line_and_no_file(
    arguments: list[str], words: str, run_folder: Path, tmp_path: Path, capsys
) -> None:
    old = tmp_path / "old.html"
    old.write_text("old")
    names = {"RUN": str(run_folder), "NEW": str(tmp_path / "new"), "OLD": str(old)}
    filled = [names.get(word, word.replace("FOLDER", str(tmp_path))) for word in arguments]
    assert words in fails_in_one_line(capsys, *filled)
    assert [path.name for path in tmp_path.iterdir()] == ["old.html"] and old.read_text() == "old"


def test_a_page_of_two_runs_is_written_and_replaced_only_with_force(
    run_folder: Path, tmp_path: Path, capsys
) -> None:
    out = tmp_path / "both.html"
    both = ["view", str(run_folder), str(run_folder), "--out", str(out)]
    assert main(both) == 0
    first = out.read_bytes()
    assert len(embedded(first.decode())["runs"]) == 2
    assert "exists" in fails_in_one_line(capsys, *both[1:])
    assert main([*both, "--force"]) == 0
    assert out.read_bytes() == first


def test_a_urdf_has_a_slider_for_each_joint_with_its_axis_and_its_range(tmp_path: Path) -> None:
    urdf = tmp_path / "slides.urdf"
    urdf.write_text(JOINTS)
    (entry,) = embedded(urdf_page(urdf))["runs"]
    joints = {joint["name"]: joint for joint in entry["joints"]}
    assert list(joints) == ["turns", "slides", "spins"]
    np.testing.assert_allclose(joints["turns"]["axis"], [0.0, 0.6, 0.8], atol=1e-12)
    np.testing.assert_allclose(joints["slides"]["axis"], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(joints["spins"]["axis"], [0.0, 0.0, -1.0], atol=1e-12)
    assert [joint["slides"] for joint in joints.values()] == [False, True, False]
    assert (joints["turns"]["lower"], joints["turns"]["upper"], joints["turns"]["free"]) == (0.5, 1.5, False)
    assert (joints["slides"]["lower"], joints["slides"]["upper"]) == (-0.1, 0.3)
    assert joints["spins"]["free"] and joints["spins"]["upper"] == pytest.approx(np.pi)
    np.testing.assert_allclose(joints["slides"]["position"], [0.2, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_vertical_axis_of_a_urdf_can_be_set(axis: str, tmp_path: Path, capsys) -> None:
    urdf, out = tmp_path / "post.urdf", tmp_path / "post.html"
    box = '<visual><geometry><box size="1.1 1.6 0.2"/></geometry></visual>'
    urdf.write_text(f'<robot name="post"><link name="a">{box}</link></robot>')
    assert main(["view", str(urdf), "--up", axis, "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    (entry,) = embedded(out.read_text())["runs"]
    commands = unpacked(zlib.decompress(b64decode(entry["scene"])))
    (base,) = (
        item["matrix"] for item in commands if item["type"] == "set_transform" and item["path"] == ROOT
    )
    turn = np.reshape(base, (4, 4)).T[:3, :3]
    np.testing.assert_allclose(np.linalg.det(turn), 1.0)
    np.testing.assert_allclose(turn @ np.eye(3)["xyz".index(axis)], [0.0, 0.0, 1.0], atol=1e-9)


def test_without_a_browser_a_picture_is_refused_with_a_suggestion(
    run_folder: Path, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv(BROWSER_VARIABLE, raising=False)
    monkeypatch.setattr("twin_gait.viewer.picture.BROWSERS", ("chromium",))
    picture = tmp_path / "a.png"
    message = fails_in_one_line(capsys, str(run_folder), "--png", str(picture))
    assert "Chromium" in message and BROWSER_VARIABLE in message
    monkeypatch.setenv(BROWSER_VARIABLE, "no-such-browser")
    assert "no-such-browser" in fails_in_one_line(capsys, str(run_folder), "--png", str(picture))
    assert list(tmp_path.iterdir()) == []


def stand_in(folder: Path, script: str) -> str:
    """A program that takes the place of Chromium."""
    path = folder / "browser"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("exit 0", ("browser", "page")),
        ("echo 'x \"twin_gait: WebGL is missing' >&2", ("WebGL",)),
        ("echo '\"twin_gait: ready' >&2", ("1600x1000",)),
        ("sleep 30", ("0.5 s",)),
    ],
)
def test_a_browser_without_output_keeps_the_old_picture(
    script: str, words: tuple[object, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(BROWSER_VARIABLE, stand_in(tmp_path, script))
    old = tmp_path / "old.png"
    old.write_bytes(b"old")
    monkeypatch.setattr("twin_gait.viewer.picture.BROWSER_TIMEOUT", 0.5 if "sleep" in script else 20.0)
    with raises(ViewerError, *words) as caught:
        take_picture("<html></html>", old)
    assert "\n" not in str(caught.value)
    assert old.read_bytes() == b"old"
    assert find_browser() == str(tmp_path / "browser")


# ---------------------------------------------------------------------------------- page on this machine


def answer(url: str, host: str | None = None, path: str = "/") -> tuple[int, bytes]:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=5)
    try:
        connection.request("GET", f"{path}?{parts.query}", headers={} if host is None else {"Host": host})
        reply = connection.getresponse()
        return reply.status, reply.read()
    finally:
        connection.close()


def test_a_page_is_served_to_this_machine_only_and_until_the_command_ends() -> None:
    with served("<p>é</p>") as server:
        parts = urlsplit(server.url)
        assert parts.hostname == "127.0.0.1"
        assert answer(server.url) == (200, "<p>é</p>".encode())
        assert answer(server.url, host=f"elsewhere.example:{parts.port}")[0] == 403
        assert answer(server.url, path="/etc/passwd")[0] == 404
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", parts.port), timeout=1)


def test_a_page_requires_the_address_with_its_token() -> None:
    with served("<p>a wearer's walk</p>") as server, served("b") as other:
        bare, foreign = server.url.partition("?")[0], urlsplit(other.url).query
        for url in (bare, f"{bare}?{foreign}", server.url[:-1], f"{server.url}0"):
            status, content = answer(url)
            assert status == 403 and b"walk" not in content, url
        assert answer(server.url)[0] == 200


@pytest.mark.parametrize("screen", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_the_token_is_in_no_command_line(
    screen: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What a browser is started with can be read by every user of the machine."""
    opened: list[str] = []
    monkeypatch.setenv(screen, ":0")
    monkeypatch.setattr(webbrowser, "open", opened.append)
    url = "http://127.0.0.1:7000/?token=0123456789abcdef#t=1&theme=dark"
    announce(url)
    assert url in capsys.readouterr().out
    (given,) = opened
    assert "0123456789abcdef" not in given
    page = Path(urlsplit(given).path)
    assert page.parent.stat().st_mode & 0o077 == 0
    assert url.replace("&", "&amp;") in page.read_text()


def test_an_occupied_port_selects_the_next_one() -> None:
    with served("a") as first:
        taken = urlsplit(first.url).port
        assert taken is not None
        with served("b", taken) as second:
            port = urlsplit(second.url).port
            assert port is not None and taken < port < taken + 100
            assert answer(first.url)[1] == b"a" and answer(second.url)[1] == b"b"
