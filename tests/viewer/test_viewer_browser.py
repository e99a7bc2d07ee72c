"""The page in a real browser: a walk of the treadmill, looked at in headless Chromium."""

import math
import re
import shutil
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from example_robots import JOINTS, robot_urdf
from matplotlib.image import imread as read_picture
from page_server import served

from twin_gait import load_experiment, simulate
from twin_gait.cli import main
from twin_gait.leg_model.urdf import build_model, find_urdf
from twin_gait.leg_model.urdf_document import mimic_joints
from twin_gait.palette import PHASE_COLOURS
from twin_gait.runs.record import read_stored_run, write_run
from twin_gait.runs.run_page import render_run_page
from twin_gait.runs.stored_run import StoredRun
from twin_gait.runs.summary import summarise_run
from twin_gait.viewer.animation import joint_entries, recorded_run, urdf_page
from twin_gait.viewer.commands import CommandBuffer
from twin_gait.viewer.figure import ArticulatedFigure
from twin_gait.viewer.page import recorded_page
from twin_gait.viewer.scene import build_scene
from twin_gait.vocabulary import GaitPhase, Side

pytestmark = [pytest.mark.slow, pytest.mark.browser]

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
if CHROMIUM is None:
    pytest.skip("no Chromium on this machine", allow_module_level=True)
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

FLAGS = ["--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader",
         "--enable-unsafe-swiftshader"]  # fmt: skip
# Message of Chromium about reading pixels for a screenshot.
OWN_WORDS = "GL Driver Message"
COLUMNS = {"": "angle_rad", "_torque": "motor_torque_Nm", "_impedance": "impedance_torque_Nm",
           "_friction_compensation": "friction_compensation_torque_Nm",
           "_gravity_compensation": "gravity_compensation_torque_Nm"}  # fmt: skip


@dataclass
class OpenPage:
    """Page in the browser with its console messages and network requests."""

    page: "playwright.Page"
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def __call__(self, script: str, argument: object = None):
        return self.page.evaluate(script, argument)


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> dict[str, Path]:
    """Two walks that differ in the support of the weight and in their length."""
    folders = {}
    for name, share, duration in (("more", 0.6, 2.0), ("less", 0.5, 1.2)):
        folder = tmp_path_factory.mktemp("runs") / name
        folder.mkdir()
        settings = [f"duration_s={duration}", "engine=pinocchio", f"scenario.support.share={share}"]
        write_run(simulate(load_experiment("treadmill_guided", settings).experiment), folder, pictures=False)
        folders[name] = folder
    return folders


MEASURES = (("", "left", "right", "healthy"), ("stride time [s]", "2.08", "2.09", "1.75"))


@pytest.fixture(scope="module")
def pages(runs: dict[str, Path], tmp_path_factory) -> dict[str, Path]:
    shown = {name: read_stored_run(folder) for name, folder in runs.items()}
    folder = tmp_path_factory.mktemp("pages")
    for name, chosen in (("one", [shown["more"]]), ("two", [shown["more"], shown["less"]])):
        (folder / f"{name}.html").write_text(render_run_page(chosen), encoding="utf-8")
    settings = ["duration_s=1.6", "faults=[encoder_freeze:left_knee@1.0s]"]
    tripped = simulate(load_experiment("treadmill_guided", settings).experiment)
    assert tripped.trip is not None
    card = {"title": "held", "events": tripped.events, "outcome": tripped.status, "walk": MEASURES}
    moments, model = [event.time for event in tripped.events], tripped.experiment.build_world().model
    held = recorded_run(tripped.log, model, about=card, frames_per_second=30.0, frame_times=moments)
    (folder / "held.html").write_text(recorded_page([held]), encoding="utf-8")
    return {path.stem: path for path in folder.iterdir()}


@pytest.fixture(scope="module")
def browser() -> Iterator["playwright.Browser"]:
    with playwright.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield running
        running.close()


def visitor(browser: "playwright.Browser") -> Iterator:
    """Gives a function that opens a page; at the end nothing may have gone wrong in any of them."""
    made: list[OpenPage] = []

    def visit(address: str, size: tuple[int, int] = (480, 360), **context: object) -> OpenPage:
        page = browser.new_page(viewport={"width": size[0], "height": size[1]}, **context)
        one = OpenPage(page)
        page.on(
            "console", lambda m: one.complaints.append(m.text) if m.type in ("error", "warning") else None
        )
        page.on("pageerror", lambda error: one.complaints.append(str(error)))
        page.on("request", lambda request: one.requests.append(request.url))
        page.goto(address)
        one("window.ready")
        made.append(one)
        return one

    yield visit
    for one in made:
        assert [words for words in one.complaints if OWN_WORDS not in words] == []
        one.page.close()


@pytest.fixture
def opened(browser: "playwright.Browser") -> Iterator:
    yield from visitor(browser)


@pytest.fixture(scope="module")
def walk(browser: "playwright.Browser", pages: dict[str, Path]) -> Iterator[OpenPage]:
    """The page of one run, which several tests share: each goes first where it wants to be."""
    visiting = visitor(browser)
    yield next(visiting)(f"{pages['one'].as_uri()}#t=0")
    assert next(visiting, None) is None


@pytest.fixture(scope="module")
def log(runs: dict[str, Path]) -> pd.DataFrame:
    return read_stored_run(runs["more"]).run.log


def numbers_in(one: OpenPage) -> dict[tuple[str, str], float]:
    """Return the texts of the card by row of the table and side."""
    rows = one("""[...document.querySelectorAll(".read tbody tr")].map((row) =>
        [...row.children].map((cell) => cell.innerText.trim()))""")
    read, joint = {}, ""
    for name, *cells in rows:
        if name == "Phase":
            continue
        if name.endswith("angle"):
            joint = name.split()[0].lower()
        for side, text in zip(("left", "right"), cells, strict=True):
            number = (
                text.replace("\N{MINUS SIGN}", "-").removesuffix("N·m").removesuffix("°").removesuffix("N")
            )
            read[name if name == "Normal force" else f"{joint}: {name}", side] = float(number)
    return read


def wait_until(one: OpenPage, condition: str) -> None:
    """Wait for a condition; the policy of the page forbids playwright's own way."""
    for _ in range(200):
        if one(condition):
            return
        one.page.wait_for_timeout(50)
    pytest.fail(f"not true within 10 s: {condition}")


def clock_of(one: OpenPage) -> float:
    return float(one('document.querySelector(".clock").textContent').split(" s")[0])


# ---------------------------------------------------------------------------------- scene and numbers


@pytest.mark.slow
def test_joint_positions_in_the_page_equal_pinocchio(walk: OpenPage, runs, log: pd.DataFrame) -> None:
    model = read_stored_run(runs["more"]).run.experiment.build_world().model
    paths = {
        name: path
        for name, path in ArticulatedFigure(CommandBuffer(), model.model).paths.items()
        if name != "universe"
    }
    one = walk
    seen = one(
        """(paths) => player.times.map((time) => {
          player.seek(time, false);
          const parts = (path) => path.split("/").filter((part) => part);
          const find = (path) => twinGait.stage.viewer.scene_tree.find(parts(path)).object;
          twinGait.stage.viewer.scene.updateMatrixWorld(true);
          const base = find("/meshcat").matrixWorld.clone().invert();
          const clock = parseFloat(document.querySelector(".clock").textContent);
          return [clock, paths.map((path) => base.clone().multiply(find(path).matrixWorld).toArray())];
        })""",
        list(paths.values()),
    )
    assert len(seen) >= 60
    data = model.model.createData()
    worst = 0.0
    for clock, matrices in seen:
        row = log.iloc[round(1000.0 * clock)]
        q = np.zeros(model.nv)
        for side, leg in model.legs.items():
            for joint, _ in leg.items():
                q[model.index(side, joint)] = row[f"{side}_{joint}_angle_rad"]
        q[model.pelvis_index], q[model.forward_index] = row["pelvis_height_m"], row["pelvis_forward_m"]
        pin.forwardKinematics(model.model, data, q)
        for name, matrix in zip(paths, matrices, strict=True):
            expected = data.oMi[model.model.getJointId(name)].homogeneous
            worst = max(worst, float(np.abs(np.array(matrix).reshape(4, 4).T - expected).max()))
    assert worst < 1e-4


@pytest.mark.slow
def test_every_number_on_the_card_equals_the_log(walk: OpenPage, log: pd.DataFrame) -> None:
    one = walk
    labels = ("angle", "motor torque", "impedance", "friction compensation", "gravity compensation")
    for requested in (0.0, 0.373, 0.7, 1.111, 1.64, 1.999):
        one("(time) => player.seek(time)", requested)
        row, read = log.iloc[round(1000.0 * clock_of(one))], numbers_in(one)
        assert len(read) == 2 * (2 * len(labels) + 1)
        for side in ("left", "right"):
            for joint in ("hip", "knee"):
                for label, (suffix, column) in zip(labels, COLUMNS.items(), strict=True):
                    value = row[f"{side}_{joint}_{column}"]
                    shown = read[
                        f"{joint}: {joint.capitalize()} angle" if not suffix else f"{joint}: {label}", side
                    ]
                    expected = math.degrees(value) if not suffix else value
                    # Half a unit of the digit shown, and what the page rounds away before.
                    assert abs(shown - expected) <= 0.05 + 1e-4, (requested, side, joint, label)
            assert abs(read["Normal force", side] - row[f"{side}_foot_normal_force_N"]) <= 0.51
            pill = one('[...document.querySelectorAll(".read .pill")].map((p) => p.textContent)')
            phase = GaitPhase(row[f"{side}_phase"])
            assert pill[side == "right"].endswith(phase.replace("_", " ").capitalize())


def test_stepping_lands_on_the_transitions_of_the_run(walk: OpenPage, runs) -> None:
    table = pd.read_csv(runs["more"] / "transitions.csv")
    expected = sorted(set(table["time_s"]))
    assert len(expected) >= 8
    one = walk
    one("player.seek(0)")

    def visited(key: str) -> list[float]:
        found = [clock_of(one)]
        while len(found) < 100:
            one.page.keyboard.press(key)
            if clock_of(one) == found[-1]:
                break
            found.append(clock_of(one))
        return found[1:]

    one.page.keyboard.press(".")
    first = table.loc[table["time_s"] == expected[0]].iloc[0]
    # A screen reader gets the leg and the phase that it entered.
    assert f"{first['side']} leg: {first['to'].replace('_', ' ')}" in one(
        'document.getElementById("spoken").textContent'
    )
    assert [clock_of(one), *visited(".")] == expected
    assert visited(",") == expected[-2::-1]
    one.page.click("#next")
    assert clock_of(one) == expected[1]


def test_a_motor_changes_its_colour_with_the_phase(walk: OpenPage, runs) -> None:
    table = pd.read_csv(runs["more"] / "transitions.csv")
    switch = table[table["side"] == "right"].iloc[1]
    experiment = read_stored_run(runs["more"]).run.experiment
    scene = build_scene(CommandBuffer(), experiment.build_world().model, patient=experiment.patient)
    colour = """(path) => twinGait.stage.viewer.scene_tree.find(
        path.split("/").filter((part) => part)).object.material.color.toArray()"""
    cover = f"{scene.caps[Side.RIGHT][0]}/<object>"
    walk("(time) => player.seek(time)", float(switch["time_s"]))
    seen = [walk(colour, cover)]
    walk.page.keyboard.press("ArrowLeft")
    seen.append(walk(colour, cover))
    for shown, phase in zip(seen, (switch["to"], switch["from"]), strict=True):
        code = PHASE_COLOURS[GaitPhase(phase)]
        expected = [int(code[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
        np.testing.assert_allclose(shown, expected, atol=1e-4)


def test_the_walk_in_numbers_opens_on_demand(opened, pages) -> None:
    one = opened(pages["held"].as_uri(), size=(1200, 700))
    read = '[...document.querySelectorAll(".walk tr")].map((row) => row.innerText.split("\\t"))'
    assert one('document.querySelector(".walk table").checkVisibility()') is False
    one.page.click(".walk summary")
    assert one('document.querySelector(".walk table").checkVisibility()') is True
    assert one(read) == [list(row) for row in MEASURES]
    plain = opened(pages["one"].as_uri())
    assert plain('document.querySelectorAll(".walk").length') == 0


@pytest.mark.slow
@pytest.mark.parametrize("shade", ["light", "dark"])
def test_a_trip_is_a_red_hold_on_card_curves_and_timeline_from_its_moment_on(opened, pages, shade) -> None:
    one = opened(f"{pages['held'].as_uri()}#t=0.5&theme={shade}", size=(1200, 700))
    alarm, pills = (
        'document.querySelector(".alarm").innerText',
        '[...document.querySelectorAll(".read .pill")].map((pill) => pill.textContent)',
    )
    assert one(alarm) == "" and not any("Hold" in text for text in one(pills))
    one.page.keyboard.press("End")
    assert [line.split(" (")[0] for line in one(alarm).split("\n")] == [
        "Fault: encoder freeze, left knee", "HOLD: encoder frozen, left knee"]  # fmt: skip
    assert all(text.endswith("Hold") for text in one(pills))
    # Back by the transitions: to the trip, which is announced to a screen reader, and to the fault.
    one.page.keyboard.press(",")
    trip = clock_of(one)
    assert 1.0 < trip < 1.2 and "trip: encoder frozen, left knee" in one(
        'document.getElementById("spoken").textContent'
    )
    # Both drawings have the colour of an alarm at that moment; before the fault neither has.
    red = one("""(time) => {
        const ink = document.createElement("canvas").getContext("2d");
        ink.fillStyle = theme.inks.alarm;
        ink.fillRect(0, 0, 1, 1);
        const wanted = ink.getImageData(0, 0, 1, 1).data;
        const count = (canvas, x) => {
            const scale = canvas.width / canvas.clientWidth;
            const at = Math.round(scale * x) - 2;
            const { data } = canvas.getContext("2d").getImageData(at, 0, 5, canvas.height);
            let found = 0;
            for (let i = 0; i < data.length; i += 4) {
                if ([0, 1, 2].every((k) => Math.abs(data[i + k] - wanted[k]) < 12)) found += 1;
            }
            return found / scale;
        };
        const curves = document.getElementById("curves"), band = document.querySelector("#bands canvas");
        const [from, to] = plots.shown(), wide = curves.clientWidth - MARGIN.left - MARGIN.right;
        return [count(curves, MARGIN.left + (wide * (time - from)) / (to - from)),
                count(band, (band.clientWidth * time) / player.end)]; }""", trip)  # fmt: skip
    # The band is 14 px high; where the mark falls between two columns its edge is blended with the phases.
    assert red[0] > 100 and red[1] > 0.75 * 14, red


# ---------------------------------------------------------------------------------- keys and pointer


def test_keys_play_step_and_change_the_page(walk: OpenPage) -> None:
    one = walk
    one("player.seek(0.2)")
    keys, now = one.page.keyboard, lambda: one("player.time")
    frames = one("player.times")
    at = frames.index(0.2)
    keys.press("ArrowRight")
    assert now() == frames[at + 1] and one("location.hash") == f"#t={frames[at + 1]:.3f}"
    keys.press("ArrowLeft")
    keys.press("ArrowLeft")
    assert now() == frames[at - 1]
    keys.press("End")
    assert now() == frames[-1]
    keys.press("Home")
    keys.press("Shift+ArrowRight")
    assert now() == 0.5
    keys.press("+")
    assert one('document.getElementById("speed").value') == "2"
    keys.press("-")
    keys.press("-")
    assert one('document.getElementById("speed").value') == "0.5"
    keys.press("a")
    assert one("plots.shown()") == [0, frames[-1]]
    dark = one("theme.dark")
    keys.press("t")
    assert one("theme.dark") is not dark
    keys.press("?")
    assert one('document.getElementById("help").open') is True
    keys.press("End")  # the page behind the help does not listen
    assert now() == 0.5
    keys.press("Escape")
    # The focus comes back some time after the dialog has closed; till then its button has the keys.
    wait_until(one, '!document.getElementById("help").open && document.activeElement === document.body')
    keys.press("Space")
    assert one("player.playing") is True
    wait_until(one, "player.time > 0.5")
    keys.press("Space")
    assert one("player.playing") is False
    assert now() in frames  # at rest it shows a row of the log


def test_every_control_can_be_reached_and_has_a_name(opened, pages) -> None:
    one = opened(f"{pages['one'].as_uri()}#t=0")
    reached = set()
    for _ in range(30):
        one.page.keyboard.press("Tab")
        reached.add(one("document.activeElement.id"))
    assert {"previous", "play", "next", "time", "speed", "view", "theme", "help-open", "curve-set", "whole",
            "zoom-in", "zoom-out"} <= reached  # fmt: skip
    nameless = one("""[...document.querySelectorAll("button, select, input, canvas[role=img]")].filter((e) =>
        e.getClientRects().length && !e.ariaLabel && !e.textContent.trim() && !e.labels?.length
    ).map((e) => e.id)""")
    assert nameless == []
    assert "left" in one('document.getElementById("time").getAttribute("aria-valuetext")')


def test_the_address_chooses_moment_speed_and_shade(opened, pages) -> None:
    one = opened(f"{pages['one'].as_uri()}#t=1.234&speed=0.25&theme=dark")
    assert abs(one("player.time") - 1.234) < 1 / 60 + 1e-3
    assert one('document.getElementById("speed").value') == "0.25"
    assert one("theme.dark") is True
    one("location.hash = '#t=0.5'")
    wait_until(one, "player.time === 0.5")
    odd = opened(f"{pages['one'].as_uri()}#t=many&speed=-1&theme=pink")
    assert odd('document.getElementById("speed").value') == "1"


@pytest.mark.slow
def test_curves_zoom_pan_seek_and_reset(opened, pages) -> None:
    one = opened(f"{pages['one'].as_uri()}#t=1.2", size=(1200, 700))
    box = one.page.locator("#curves").bounding_box()
    assert box is not None
    whole = one("plots.shown()")
    left, right = box["x"] + 40, box["x"] + box["width"] - 8  # the axes begin and end there
    middle = box["y"] + 0.5 * box["height"]
    quarter = left + 0.25 * (right - left)
    under = one("([x, y]) => plots.time_at({clientX: x, clientY: y})", [quarter, middle])
    assert under == pytest.approx(whole[0] + 0.25 * (whole[1] - whole[0]), abs=1e-6)
    one.page.mouse.move(quarter, middle)
    one.page.mouse.wheel(0, -240)
    near = one("plots.shown()")
    assert near[1] - near[0] < 0.6 * (whole[1] - whole[0])
    after = one("([x, y]) => plots.time_at({clientX: x, clientY: y})", [quarter, middle])
    one.page.mouse.dblclick(quarter, middle)
    assert one("plots.shown()") == whole
    assert near[0] <= after <= near[1]
    one.page.mouse.move(left + 0.5 * (right - left), middle)
    one.page.mouse.down()
    one.page.mouse.move(left + 0.75 * (right - left), middle, steps=4)
    one.page.mouse.up()
    span = one("plots.shown()")
    length = whole[1] - whole[0]
    np.testing.assert_allclose(span, [whole[0] + 0.5 * length, whole[0] + 0.75 * length], atol=0.02)
    one.page.mouse.dblclick(quarter, middle)
    one.page.mouse.click(quarter, middle)
    assert one("player.time") == pytest.approx(under, abs=1 / 60 + 2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("span", [2.0, 0.7, 0.05])
def test_drawn_curves_have_the_peaks_of_the_log_at_every_zoom(
    walk: OpenPage, log: pd.DataFrame, span: float
) -> None:
    width = 300  # pixels, as the curves have beside the scene
    for begin in np.arange(0.0, 2.0 - span + 1e-9, span):
        lines = walk(
            """([from, to, width]) => plots.panels.flatMap((panel) => panel.lines).map((line) => {
              const points = [], note = (x, y) => points.push([x, y]), nothing = () => {};
              const paper = { moveTo: note, lineTo: note, beginPath: nothing, stroke: nothing,
                              setLineDash: nothing };
              const x = (time) => (width * (time - from)) / (to - from);
              plots.line(paper, line, [], x, (value) => value, from, to);
              return [`${line.leg.side}_${line.key}`, points]; })""",
            [float(begin), float(begin + span), width],
        )
        rows = log.iloc[round(1000 * begin) : round(1000 * (begin + span)) + 1]
        assert len(lines) == 8
        for name, points in lines:
            side, joint, *torque = name.split("_")
            column = f"{side}_{joint}_{'motor_torque_Nm' if torque else 'angle_rad'}"
            truth = rows[column].to_numpy() * (1.0 if torque else 180.0 / math.pi)
            whole = log[column].to_numpy() * (1.0 if torque else 180.0 / math.pi)
            x, y = np.array(points).T
            assert len(points) <= 2 * width * 4 + 4  # no more than show
            drawn = np.interp(np.linspace(0.0, width, len(truth)), x, y)
            for peak in (np.max, np.min):
                assert abs(peak(drawn) - peak(truth)) <= 0.01 * np.abs(whole).max(), (name, begin)


# ---------------------------------------------------------------------------------- network, shapes, shades


@pytest.mark.slow
def test_the_page_sends_no_network_requests(opened, pages) -> None:
    one = opened(f"{pages['one'].as_uri()}#t=0")
    assert [url.split("#")[0] for url in one.requests] == [pages["one"].as_uri()]
    # Its own policy forbids it too.
    assert one("fetch('https://elsewhere.example/').then(() => 'went', () => 'refused')") == "refused"
    one.complaints.clear()  # the browser reports the refusal


@pytest.mark.parametrize("name", ["one", "two"])
def test_a_phone_shows_everything_without_scrolling_sideways(opened, pages, name: str) -> None:
    one = opened(f"{pages[name].as_uri()}#t=1", size=(400, 800))
    check_width(one, 400)
    one.page.set_viewport_size({"width": 320, "height": 700})
    check_width(one, 320)


def check_width(one: OpenPage, width: int) -> None:
    assert one("document.documentElement.scrollWidth") <= width
    outside = one("""[
        ...document.querySelectorAll("button, select, .card, .pane, #curves, .pill"),
    ].filter((e) => {
        const box = e.getBoundingClientRect();
        return box.width && (box.left < -0.5 || box.right > innerWidth + 0.5);
    }).map((e) => e.id || e.className)""")
    assert outside == []
    small = one("""[...document.querySelectorAll(".read td, .read th, .legend")].map((e) =>
        parseFloat(getComputedStyle(e).fontSize)).filter((size) => size < 11)""")
    assert small == []
    one("scrollTo(0, document.documentElement.scrollHeight)")
    # The bar lies over the page, and the end of the page can be seen above it.
    assert one("""document.getElementById("plots").getBoundingClientRect().bottom <=
        document.getElementById("bar").getBoundingClientRect().top""")


def test_light_and_dark_follow_the_system_and_the_switch(opened, pages) -> None:
    brightness = """() => {
        const set = twinGait.stage.viewer.scene_tree.find(["Background"]).object.top_color;
        return set.reduce((sum, value) => sum + value, 0) / set.length; }"""
    one = opened(f"{pages['one'].as_uri()}#t=0", color_scheme="dark")
    assert one("theme.dark") is True and one(brightness) < 80
    one.page.click("#theme")
    assert one("theme.dark") is False and one(brightness) > 200
    for shade in ("light", "dark"):
        one("(dark) => theme.set(dark)", shade == "dark")
        ink, ground = one("""["--ink", "--ground"].map((name) =>
            getComputedStyle(document.documentElement).getPropertyValue(name).trim())""")
        levels = [sum(int(colour[i : i + 2], 16) for i in (1, 3, 5)) / 3 for colour in (ink, ground)]
        assert abs(levels[0] - levels[1]) > 150


def test_printed_page_has_the_picture_the_numbers_and_the_whole_curves(opened, pages, tmp_path: Path) -> None:
    one = opened(f"{pages['one'].as_uri()}#t=1", size=(900, 600), color_scheme="dark")
    one.page.pdf(path=str(tmp_path / "page.pdf"), format="A4")
    content = (tmp_path / "page.pdf").read_bytes()
    assert content.count(b"/Type /Page\n") == 1
    assert b"/Width 900\n/Height 860" in content  # the still picture
    assert "The scene at 1.000 s" in one('document.getElementById("printed").textContent')
    # Afterwards the page is as it was.
    assert one("theme.dark") is True and one('document.body.classList.contains("printing")') is False


@pytest.mark.parametrize("name", ["one", "two"])
def test_on_paper_every_table_is_within_its_column(opened, pages, name: str) -> None:
    one = opened(f"{pages[name].as_uri()}#t=0", size=(794, 1123))
    one("player.print(true)")
    for time in (0.1, 0.5, 0.9, 1.3):  # other phases, whose names are longer or shorter
        one("(time) => player.seek(time)", time)
        boxes = one("""[...document.querySelectorAll(".head")].map((head) =>
            [head.querySelector(".read"), head, document.body].map((box) =>
                box.getBoundingClientRect().right))""")
        assert boxes and all(table <= column <= paper for table, column, paper in boxes), time
        assert one("""[...document.querySelectorAll(".head, .read td")].every((box) =>
            box.scrollWidth <= box.clientWidth)""")
        pictures = one("""[...document.querySelectorAll(".picture")].map((box) =>
            box.getBoundingClientRect().left)""")
        assert name == "two" or pictures[0] > boxes[0][1]


# ---------------------------------------------------------------------------------- two runs, picture


def test_two_runs_share_a_clock_and_their_difference_equals_the_logs(opened, pages, runs) -> None:
    logs = [read_stored_run(runs[name]).run.log for name in ("more", "less")]
    one = opened(f"{pages['two'].as_uri()}#t=0.9", size=(1000, 700))
    one("player.seek(1.1)")
    clocks = one('[...document.querySelectorAll(".clock")].map((clock) => parseFloat(clock.textContent))')
    assert len(clocks) == 2 and clocks[0] == clocks[1] == pytest.approx(1.1, abs=0.02)
    knees = one("""[...document.querySelectorAll(".head")].map((head) =>
        [...head.querySelectorAll("tbody tr")].find((row) => row.firstChild.textContent === "Knee angle")
    ).map((row) => row.children[1].textContent)""")
    row = round(1000.0 * clocks[0])
    for text, log in zip(knees, logs, strict=True):
        shown = float(text.replace("\N{MINUS SIGN}", "-").rstrip("°"))
        assert abs(shown - math.degrees(log["left_knee_angle_rad"].iloc[row])) <= 0.05 + 1e-4
    panel = one("""(() => {
        const panel = plots.panels.find((p) => p.below && p.label.includes("knee flexion"));
        const line = panel.lines.find((l) => l.leg.side === "left");
        return { label: panel.label, ...line.series, frames: player.runs.map((run) => run.times) }; })()""")
    rows = np.round(1000.0 * np.array(panel["times"])).astype(int)
    shown = np.array(panel["values"], dtype=float)
    assert rows[0] == 0 and rows[-1] == 1199  # as long as both last
    knees = [np.degrees(log["left_knee_angle_rad"].to_numpy()) for log in logs]
    first, second = (knee[rows] for knee in knees)
    frames = [np.round(1000.0 * np.array(times)).astype(int) for times in panel["frames"]]
    both = np.isin(rows, np.intersect1d(*frames))  # there both are as logged
    np.testing.assert_allclose(shown[both], (second - first)[both], atol=1.1e-4)
    np.testing.assert_allclose(shown, second - first, atol=0.002 * sum(np.ptp(knee) for knee in knees))
    assert np.abs(second - first).max() > 0.1  # the runs do differ
    assert panel["label"].startswith("B − A")
    assert one("document.querySelectorAll('#bands canvas').length") == 4
    one.page.keyboard.press("End")
    assert one("player.stages.length") == 2
    assert one('[...document.querySelectorAll(".clock")].map((c) => parseFloat(c.textContent))') == [
        1.999,
        1.199,
    ]


def test_a_picture_of_a_moment_is_drawn_from_the_command_line(runs, tmp_path: Path, capsys) -> None:
    picture = tmp_path / "moment.png"
    command = [
        "view",
        str(runs["more"]),
        "--png",
        str(picture),
        "--at",
        "1.234",
    ]
    assert main(command) == 0
    assert capsys.readouterr().out.strip() == str(picture)
    content = picture.read_bytes()
    assert struct.unpack(">II", content[16:24]) == (1600, 1000)
    pixels = read_picture(picture)[:, :, :3]
    assert pixels.std() > 0.02 and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 500
    assert [path.name for path in tmp_path.iterdir()] == ["moment.png"]


# ---------------------------------------------------------------------------------- any URDF


def urdf_named(name: str, folder: Path) -> Path:
    if name == "slides.urdf":
        (folder / name).write_text(JOINTS)
        return folder / name
    return find_urdf(name) if name == "twin.urdf" else robot_urdf(name)


@pytest.mark.parametrize(
    ("name", "up"),
    [
        ("twin.urdf", "z"),
        ("slides.urdf", "y"),
        ("panda_description/urdf/panda.urdf", "z"),  # of whose fingers one follows the other
    ],
)
def test_joint_sliders_give_the_positions_of_pinocchio(opened, tmp_path: Path, name: str, up: str) -> None:
    urdf = urdf_named(name, tmp_path)
    model = build_model(urdf)
    figure = ArticulatedFigure(CommandBuffer(), model, up_axis=up)
    page = tmp_path / "page.html"
    page.write_text(urdf_page(urdf, up_axis=up), encoding="utf-8")
    one = opened(page.as_uri(), size=(1000, 640))
    names = one('[...document.querySelectorAll(".joint .name")].map((name) => name.textContent)')
    assert names == list(model.names)[1:]
    pose_script = """(paths) => {
        const find = (path) => twinGait.stage.viewer.scene_tree.find(path.split("/").filter((p) => p)).object;
        twinGait.stage.viewer.scene.updateMatrixWorld(true);
        const base = find("/meshcat").matrixWorld.clone().invert();
        return paths.map((path) => base.clone().multiply(find(path).matrixWorld).toArray());
    }"""
    paths = [figure.paths[name] for name in names]
    data = model.createData()
    mimics = mimic_joints(urdf)
    entries = list(joint_entries(figure, mimics))
    scale = [1e3 if joint["slides"] else math.degrees(1.0) for joint in entries]

    def check(q: np.ndarray) -> None:
        pin.forwardKinematics(model, data, q)
        for path, matrix in zip(names, one(pose_script, paths), strict=True):
            expected = figure.base @ data.oMi[model.getJointId(path)].homogeneous
            np.testing.assert_allclose(np.reshape(matrix, (4, 4)).T, expected, atol=1e-5)

    nearest = np.clip(np.zeros(model.nq), model.lowerPositionLimit, model.upperPositionLimit)
    check(nearest)
    # As a hand does it: the slider, then its event.
    chosen = np.array([0.25 * entry["lower"] + 0.75 * entry["upper"] for entry in entries])
    for name, mimic in mimics.items():  # its slider is disabled, and it follows the other joint
        chosen[names.index(name)] = mimic.multiplier * chosen[names.index(mimic.joint)] + mimic.offset
    texts = one(
        """(values) => [...document.querySelectorAll(".joint input")].map((slider, index) => {
            if (!slider.disabled) {
                slider.value = values[index];
                slider.dispatchEvent(new Event("input"));
            }
            return slider;
        }).map((slider) => slider.closest("label").querySelector("output").textContent)""",
        (chosen * scale).tolist(),
    )
    check(chosen)
    written = [float(re.sub(r"[^-\d.]", "", text.replace("\N{MINUS SIGN}", "-"))) for text in texts]
    np.testing.assert_allclose(written, chosen * scale, atol=0.0501)
    one.page.keyboard.press("z")
    check(nearest)
    assert one.requests == [page.as_uri()]


def test_the_picture_of_a_urdf_is_drawn_and_serving_it_needs_the_token(
    opened, tmp_path: Path, capsys
) -> None:
    out = tmp_path / "twin.png"
    assert main(["view", "twin.urdf", "--png", str(out)]) == 0
    pixels = read_picture(out)
    # What is darker than any background is the figure: it fills the picture and stands in its middle.
    rows = np.flatnonzero((pixels[:, 500:1100, :3].max(axis=2) < 0.4).any(axis=1))
    assert rows.min() < 250 and rows.max() > 833
    with served(urdf_page("twin.urdf")) as server:
        one = opened(server.url)
        assert one('document.querySelectorAll(".joint").length') == 6
        assert one.requests == [server.url]


def test_two_walks_are_compared_by_per_cent_of_the_stride_without_drift(opened, tmp_path: Path) -> None:
    walk = simulate(load_experiment("treadmill_guided", ["duration_s=9"]).experiment)
    slower = walk.log.iloc[np.round(np.arange(len(walk.log)) / 1.015).astype(int)].copy()
    slower["time_s"] = walk.log["time_s"].to_numpy()  # the same walk with strides 1.5 % longer
    summary = summarise_run(walk)
    runs = [StoredRun(run, summary) for run in (walk, replace(walk, log=slower))]
    (tmp_path / "pair.html").write_text(render_run_page(runs), encoding="utf-8")
    one = opened(f"{(tmp_path / 'pair.html').as_uri()}#t=6", size=(1000, 700))
    largest = """() => Object.fromEntries(plots.panels.filter((panel) => panel.below).flatMap((panel) =>
        panel.lines.map((line) => [`${line.leg.side}_${line.key}`, line.series.values.reduce(
            (most, value, i) => (line.series.times[i] > 5 ? Math.max(most, Math.abs(value)) : most), 0)])))"""
    assert one("player.by_stride") is True and one('document.getElementById("by-stride").hidden') is False
    by_stride = one(largest)
    clocks = one('[...document.querySelectorAll(".clock")].map((clock) => clock.textContent)')
    strides = [text.split("; ")[1] for text in clocks]
    assert strides[0].startswith("left stride ")
    stride, percent = zip(*(map(int, re.findall(r"\d+", text)) for text in strides), strict=True)
    assert stride[0] == stride[1] and abs(percent[0] - percent[1]) <= 2  # a frame is 1.6 % of a stride
    times = [float(text.split(" s")[0]) for text in clocks]
    assert times[1] == pytest.approx(1.015 * times[0], abs=0.04)
    one.page.keyboard.press("s")
    assert one("player.by_stride") is False
    by_time = one(largest)
    for name in ("left_hip", "left_knee", "right_hip", "right_knee"):
        assert by_stride[name] < 0.7 and by_time[name] > 5 * by_stride[name], name


@pytest.mark.parametrize("width", [1180, 1024])
def test_two_runs_on_a_tablet_have_their_numbers_below_their_scenes(opened, pages, width: int) -> None:
    one = opened(f"{pages['two'].as_uri()}#t=1", size=(width, 780))
    assert one("""[...document.querySelectorAll(".stage")].every((stage) => {
        const pane = stage.querySelector(".pane").getBoundingClientRect();
        const head = stage.querySelector(".head").getBoundingClientRect();
        return pane.height > 100 && pane.bottom <= head.top + 0.5; })""")


def test_without_webgl_numbers_curves_and_timeline_work(browser, pages, log: pd.DataFrame) -> None:
    page = browser.new_page(viewport={"width": 1180, "height": 780})
    page.add_init_script("""{
        const inner = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
            return kind.includes("webgl") ? null : inner.call(this, kind, ...more);
        }; }""")
    one = OpenPage(page)
    page.on("pageerror", lambda error: one.complaints.append(str(error)))
    page.goto(f"{pages['one'].as_uri()}#t=0")
    one("window.ready")
    assert "no WebGL" in one('document.querySelector(".pane").innerText')
    assert one('document.getElementById("message").hidden') is True
    one("player.seek(1.2)")
    row, read = log.iloc[round(1000.0 * clock_of(one))], numbers_in(one)
    assert read["knee: Knee angle", "left"] == pytest.approx(
        math.degrees(row["left_knee_angle_rad"]), abs=0.051
    )
    inked = """(id) => { const canvas = document.querySelector(id);
        const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        return data.reduce((sum, value, k) => sum + (k % 4 === 3 && value > 0 ? 1 : 0), 0); }"""
    assert one(inked, "#curves") > 5000 and one(inked, "#bands canvas") > 5000
    page.keyboard.press(".")
    assert one("player.time") > 1.2
    page.keyboard.press("t")
    page.set_viewport_size({"width": 500, "height": 700})
    one("player.print(true)")
    assert one.complaints == []
    page.close()
