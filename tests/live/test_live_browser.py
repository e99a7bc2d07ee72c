"""Tests of the live page in headless Chromium: settings of the panel are in the log, errors are refused."""

import contextlib
import math
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import yaml

from twin_gait import load_experiment
from twin_gait.experiment.events import Stop
from twin_gait.gait.table import TICK
from twin_gait.runs.record import EXPERIMENT_FILE, LOG_FILE, read_stored_run
from twin_gait.simulation.log import state_columns
from twin_gait.simulation.stepping import FADE_TICKS
from twin_gait.viewer.commands import CommandBuffer
from twin_gait.viewer.figure import ArticulatedFigure
from twin_gait.viewer.motion import EXTREMES_TICKS
from twin_gait.vocabulary import Side

pytestmark = [pytest.mark.slow, pytest.mark.browser]

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
if CHROMIUM is None:
    pytest.skip("no Chromium on this machine", allow_module_level=True)
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

FLAGS = ["--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader",
         "--enable-unsafe-swiftshader"]  # fmt: skip
OWN_WORDS = "GL Driver Message"  # message of Chromium about its own screenshots
PATIENCE = 60.0  # [s]; machines that test are slow and busy
SMALL = {"width": 480, "height": 420}  # without a graphics card a large picture takes a second to draw
DEGREE = np.pi / 180.0
QUANTITIES = {
    "stiffness": ("stiffness_Nm_per_rad", 1.0 / DEGREE),
    "damping": ("damping_Nms_per_rad", 1.0),
    "equilibrium": ("equilibrium_rad", DEGREE),
    "gain": ("friction_compensation_gain", 1.0),
    "torque": ("target_torque_Nm", 1.0),
}


def until(true: Callable[[], Any], awaited: str, patience: float = PATIENCE) -> Any:
    end = time.monotonic() + patience
    while not (found := true()):
        assert time.monotonic() < end, f"waited {patience:g} s in vain: {awaited}"
        time.sleep(0.05)
    return found


class Walk:
    """Running process of ``twin-gait live``."""

    def __init__(self, folder: Path, *words: str, name: str = "run") -> None:
        self.folder = folder / name
        command = [sys.executable, "-m", "twin_gait", "live", *words, "--no-browser", "--no-pictures",
                   "--port", "0", "--user", "tester", "--out", str(self.folder)]  # fmt: skip
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"TWIN_GAIT_SESSIONS": str(folder / "sessions")},
        )
        try:
            self.url = self._address()
        except BaseException:
            self.process.kill()
            self.end()
            raise
        self.home = self.url.partition("?")[0]
        self.port = urlsplit(self.url).port

    def _address(self) -> str:
        lines: list[str] = []
        reader = threading.Thread(target=lambda: lines.append(self.process.stdout.readline()), daemon=True)
        reader.start()
        reader.join(180.0)
        assert lines and "http" in lines[0], f"no address within 180 s: {lines}"
        return re.search(r"http://\S+", lines[0])[0]

    def end(self, number: int = signal.SIGINT) -> int:
        self.process.send_signal(number)
        status = self.process.wait(180.0)
        self.process.stdout.close()
        return status

    def close(self) -> None:
        if self.process.poll() is None:
            self.end(signal.SIGTERM)


class Page:
    """Page of a walk with its console messages and network requests."""

    def __init__(self, browser: Any, walk: Walk, *, draws: bool = True, forecasts: bool = False) -> None:
        self.forecasts = forecasts  # for a forecast before a change
        self.page = browser.new_page(viewport=SMALL)
        self.page.set_default_timeout(1000.0 * PATIENCE)
        self.walk = walk
        self.complaints: list[str] = []
        self.foreign: list[str] = []
        self.page.on("console", self._note)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", self._on_request)
        self.open()
        if not draws:  # several pages without a graphics card would take the machine from the walk
            self.page.evaluate("twinGait.stage.viewer.renderer.render = () => {}; null")

    def _note(self, message: Any) -> None:
        if message.type in ("error", "warning") and OWN_WORDS not in message.text:
            self.complaints.append(message.text)

    def _on_request(self, request: Any) -> None:
        if not request.url.startswith((self.walk.home, "data:", "blob:")):
            self.foreign.append(request.url)

    def open(self) -> None:
        self.page.goto(self.walk.url)
        self.page.wait_for_selector(".control >> nth=0", state="attached")
        self.page.locator("#panel-forecast-first input").set_checked(self.forecasts)
        until(lambda: self.clock() > 0.0, "the first frame")

    def tab(self, name: str) -> None:
        self.page.click(f"#tab-{name}")

    def row(self, control: str) -> Any:
        return self.page.locator(f'[data-control="{control}"]')

    def type(self, control: str, value: float | str) -> None:
        box = self.row(control).locator("input[type=number]")
        box.fill(str(value))
        box.press("Enter")

    def value(self, control: str) -> float:
        return float(self.row(control).locator("input[type=number]").input_value())

    def settle(self) -> None:
        """Wait until every request has a response."""
        until(lambda: self.page.locator(".pending").count() == 0, "the answers")

    def forecast(self) -> str:
        """Wait for the forecast of the list of changes, and return its text on the page."""
        apply = self.page.locator("[data-forecast=apply]")
        until(lambda: apply.count() and apply.is_enabled(), "the forecast")
        return str(self.page.locator("#panel-forecast").inner_text())

    def refusal(self, control: str) -> str:
        self.settle()
        return self.row(control).locator(".rejection").inner_text()

    def controls(self) -> dict[str, dict[str, Any]]:
        listed = self.page.evaluate("livePanel.board.state.controls")
        return {item["name"]: item for item in listed}

    def status(self) -> str:
        return self.page.locator("#panel-state").get_attribute("data-state") or ""

    def clock(self) -> float:
        text = self.page.locator("#panel-clock").inner_text()
        return float(text.split()[0]) if text else 0.0

    def wait(self, seconds: float) -> None:
        """Let simulated time pass."""
        start = self.clock()
        until(lambda: self.clock() >= start + seconds, f"{seconds:g} s of walking")

    def log(self) -> list[str]:
        self.tab("log")
        return self.page.locator("#panel-log .what").all_inner_texts()

    def say(self, text: str) -> None:
        """Send a message that the panel itself never sends."""
        self.page.evaluate("text => livePanel.link.socket.send(text)", text)

    def close(self) -> None:
        assert self.complaints == []
        assert self.foreign == []
        self.page.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield running
        running.close()


@pytest.fixture(scope="module")
def treadmill(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Walk]:
    walk = Walk(tmp_path_factory.mktemp("treadmill_guided"), "treadmill_guided")
    yield walk
    walk.close()


@pytest.fixture
def page(browser: Any, treadmill: Walk) -> Iterator[Page]:
    opened = Page(browser, treadmill)
    yield opened
    opened.close()


# ---------------------------------------------------------------------- table and monitor


def other_value(control: dict[str, Any]) -> float:
    """Return a value slightly different from the present one, in range and on the grid of the control."""
    step = control["step"]
    steps = round(0.02 * control["value"] / step) or 1
    if control["value"] + steps * step > control["largest"]:
        steps = -steps
    return round(round(control["value"] / step + steps) * step, 6)


def set_all(page: Page, controls: list[dict[str, Any]]) -> dict[str, float]:
    wanted = {}
    # Damping first: where it is given as a ratio it follows the stiffness until it is set.
    for control in sorted(controls, key=lambda item: not item["name"].endswith("damping")):
        wanted[control["name"]] = other_value(control)
        page.type(control["name"], wanted[control["name"]])
    page.settle()
    for name in wanted:
        assert page.row(name).locator(".rejection").inner_text() == "", name
    return wanted


def drive(page: Page, mode: str) -> None:
    page.tab("monitor")
    page.row("mode").locator("select").select_option(mode)
    page.settle()
    assert page.row("mode").locator(".rejection").inner_text() == ""


@pytest.fixture(scope="module")
def bench_session(
    browser: Any, tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, float], dict[str, float], pd.DataFrame, pd.DataFrame, list[dict[str, str]]]:
    """Return the values typed into every control of table and monitor, and the logs of the two walks."""
    walk = Walk(tmp_path_factory.mktemp("bench"), "bench_leg")
    page = Page(browser, walk)
    try:
        # While the monitor drives the leg the table is not in force, and is looked at once at the end.
        drive(page, "impedance_control")
        controls = list(page.controls().values())
        page.tab("table")
        table: dict[str, float] = {}
        for phase in page.page.evaluate("livePanel.board.state.phases"):
            page.page.click(f'.chip[data-phase="{phase}"]')
            table |= set_all(page, [item for item in controls if item["phase"] == phase])
        page.tab("monitor")
        monitor: dict[str, float] = {}
        for joint in ("hip", "knee"):
            page.page.click(f'.chip[data-joint="right {joint}"]')
            own = [item for item in controls if item["group"] == "monitor" and item["joint"] == joint]
            monitor |= set_all(page, own)
        page.wait(0.5)
        for mode in ("torque_control", "friction_control", "walk"):
            drive(page, mode)
            page.wait(0.5)
        before = page.clock()
        page.page.click("[data-action=restart]")  # a leg without a spring may have fallen on its stop
        until(lambda: page.clock() < before, "a new walk")  # the old one's clock is past 6 s too
        until(lambda: page.status() == "walking" and page.clock() > 6.0, "a stride and a half")
        page.close()
        assert walk.end() == 0
    finally:
        walk.close()
    changes = read_changes(walk)
    again = read_stored_run(walk.folder.with_name("run-2"))
    return table, monitor, read_stored_run(walk.folder).run.log, again.run.log, changes


def read_changes(walk: Walk) -> list[dict[str, Any]]:
    """Return the events of the walk: time and, for changes, keys and values."""
    return yaml.safe_load((walk.folder / EXPERIMENT_FILE).read_text(encoding="utf-8"))["events"]


def logged(log: pd.DataFrame, tick: int, name: str) -> tuple[float, float]:
    """Return the logged value of a control at a tick, and the factor from its unit to SI."""
    joint, quantity = name.split(".")[-2:]
    column, scale = QUANTITIES[quantity]
    return float(log[f"right_{joint}_{column}"].iloc[tick]), scale


def test_every_control_of_the_table_is_in_the_log_of_its_phase(bench_session) -> None:
    table, _, _, log, _ = bench_session
    assert len(table) == 40  # five phases, two joints, k, b, θ0 and G
    phases = log["right_phase"].astype(str).to_numpy()
    changes = np.flatnonzero(phases[1:] != phases[:-1])  # last ticks of spells, when every blend is over
    for name, value in table.items():
        ends = [tick for tick in changes if phases[tick] == name.partition(".")[0]]
        assert ends, f"{name}: the phase was not walked through"
        found, scale = logged(log, ends[-1], name)
        assert found == pytest.approx(value * scale, rel=1e-9, abs=1e-12), name


def begin_of(changes: list[dict[str, Any]], mode: str) -> int:
    """Return the tick in which a mode was set."""
    times = (item["time_s"] for item in changes if item.get("set", {}).get("monitor.control") == mode)
    return round(1e3 * next(times))


def in_force(changes: list[dict[str, Any]], mode: str) -> int:
    """Return a tick at which a mode has faded in and no blend of a phase is active."""
    return begin_of(changes, mode) + FADE_TICKS + 100


def test_every_control_of_the_monitor_is_in_the_log(bench_session) -> None:
    _, monitor, log, _, changes = bench_session
    assert len(monitor) == 10
    before_torque = begin_of(changes, "torque_control") - 1
    moments = {
        "stiffness": before_torque,
        "damping": before_torque,
        "equilibrium": before_torque,
        "gain": in_force(changes, "friction_control"),
        "torque": in_force(changes, "torque_control"),
    }
    for name, value in monitor.items():
        found, scale = logged(log, moments[name.rpartition(".")[2]], name)
        assert found == pytest.approx(value * scale, rel=1e-9, abs=1e-12), name


def test_friction_and_torque_control_have_neither_spring_nor_damper(bench_session) -> None:
    _, _, log, _, changes = bench_session
    for mode in ("torque_control", "friction_control"):
        row = log.iloc[in_force(changes, mode)]
        for joint in ("hip", "knee"):
            assert row[f"right_{joint}_stiffness_Nm_per_rad"] == 0.0
            assert row[f"right_{joint}_damping_Nms_per_rad"] == 0.0


# Keys in SI of the quantities of a control, and the SI value of one unit of the control.
KEYS = {
    "stiffness": ("stiffness_Nm_per_rad", math.degrees(1.0)),
    "damping": ("damping_Nms_per_rad", 1.0),
    "equilibrium": ("equilibrium_rad", math.radians(1.0)),
    "gain": ("friction_compensation_gain", 1.0),
}


def test_every_change_is_an_event_of_the_run_folder(bench_session) -> None:
    table, monitor, log, _, changes = bench_session
    given: dict[str, float] = {}
    for item in changes:
        given |= item.get("set", {})
        assert item["by"] == "tester" and 0.0 <= item["time_s"] <= 1e-3 * len(log)
    for name, value in table.items():
        phase, joint, quantity = name.split(".")
        key, scale = KEYS[quantity]
        assert given[f"table.phases.{phase}.{joint}.{key}"] == pytest.approx(value * scale)
    assert len([key for key in given if key.startswith("monitor.") and key != "monitor.control"]) == len(
        monitor
    )
    times = [item["time_s"] for item in changes]
    assert times == sorted(times)


@pytest.mark.parametrize("width", [1180, 1024])
def test_numbers_stay_in_their_card_on_a_tablet(browser: Any, treadmill: Walk, width: int) -> None:
    page = Page(browser, treadmill)
    page.page.set_viewport_size({"width": width, "height": 780})
    page.page.wait_for_selector(".read tbody tr")
    outside = page.page.evaluate(
        """(keys) => {
            const values = { phase: 4, ...Object.fromEntries(keys.map((key) => [key, -188.8])) };
            const legs = twinGait.page().legs, none = { times: [], values: [] };
            const curves = legs.map((leg) => Object.fromEntries(leg.shows.map((key) => [key, none])));
            twinGait.show({ time: 1e6, legs: legs.map(() => values), curves, events: [] });
            const room = document.querySelector(".head").getBoundingClientRect();
            const parts = document.querySelectorAll(".read td, .read th, .read .pill, .read span");
            return [...parts].filter((one) => {
                const box = one.getBoundingClientRect();
                return box.width && (box.right > room.right + 0.5 || box.left < room.left - 0.5);
            }).map((one) => one.textContent); }""",
        ["hip", "hip_torque", "knee", "knee_torque", "force"],
    )
    assert outside == []
    page.close()


def test_a_sitting_wearer_is_not_shown_as_walking_and_the_curves_end_above_the_legend(
    browser: Any, tmp_path: Path
) -> None:
    walk = Walk(tmp_path, "stand_to_sit")
    page = Page(browser, walk)
    try:
        page.page.set_viewport_size({"width": 1100, "height": 700})
        page.page.wait_for_selector(".read tbody tr")
        until(lambda: page.page.locator("#panel-state").inner_text() == "Running", "the state")
        ends = """() => {
            const end = (name) => document.getElementById(name).getBoundingClientRect();
            document.getElementById("plots").scrollTop = 1e6;
            return [end("curves").bottom, end("plots").bottom, end("bar").top]; }"""
        until(lambda: page.page.locator("#legend .chip").count() == 17, "the legend")
        until(lambda: (np.diff(page.page.evaluate(ends)) >= 0.0).all(), "curves above the legend", 10.0)
    finally:
        page.close()
        walk.close()


def test_the_scene_of_a_phone_stays_before_the_panel_that_scrolls(page: Page) -> None:
    top = """() => { scrollTo(0, 250);
        return [scrollY, document.elementFromPoint(innerWidth / 2, 100).closest(".pane") !== null]; }"""
    assert page.page.evaluate(top) == [250, True]


# ---------------------------------------------------------------------- wrong values


def test_value_out_of_range_is_refused_next_to_its_control_and_reset(page: Page) -> None:
    page.tab("table")
    before = page.value("early_stance.hip.equilibrium")
    page.type("early_stance.hip.equilibrium", 400)
    assert re.search(r"expected .* to .* °, got 400", page.refusal("early_stance.hip.equilibrium"))
    assert page.value("early_stance.hip.equilibrium") == before
    assert "pending" not in (page.row("early_stance.hip.equilibrium").get_attribute("class") or "")


def test_unsafe_value_is_refused_with_the_reason_of_the_check(page: Page) -> None:
    page.tab("table")
    page.page.click('.chip[data-phase="swing_flexion"]')
    before = page.value("swing_flexion.knee.gain")
    page.type("swing_flexion.knee.gain", 1.0)  # full compensation lets the loop grow
    reason = page.refusal("swing_flexion.knee.gain")
    assert reason.startswith("unstable (swing_flexion)")
    assert page.value("swing_flexion.knee.gain") == before
    assert any(reason in line for line in page.log())


def test_a_page_that_outlives_its_session_shows_the_log_of_the_next(page: Page) -> None:
    texts = '[...document.querySelectorAll("#panel-log .what")].map((one) => one.textContent)'
    session = page.page.evaluate("livePanel.log.session")
    assert re.fullmatch("[0-9a-f]{16}", session)
    receive = "(batch) => livePanel.link.socket.onmessage({data: JSON.stringify(batch)})"
    phases = page.page.evaluate("[...livePanel.board.colours.values()]")
    greeting = {"kind": "page", "session": session, "phases": phases}

    def event(serial: int, text: str) -> dict[str, Any]:
        return {"kind": "event", "serial": serial, "response": "note", "text": text, "tick": 1, "id": ""}

    page.page.evaluate(receive, [greeting, event(90001, "of the first"), event(90001, "of the first")])
    assert page.page.evaluate(texts).count("of the first") == 1
    # As after a restart of the program: its serial numbers begin at 1 again.
    page.page.evaluate(
        receive, [{**greeting, "session": "another"}, event(1, "begins"), event(90001, "goes on")]
    )
    assert page.page.evaluate(texts) == ["goes on", "begins"]


@pytest.mark.slow
def test_a_change_waits_for_its_forecast_and_apply_and_discard_leaves_the_walk_alone(
    browser: Any, tmp_path: Path
) -> None:
    walk = Walk(tmp_path, "treadmill_guided")
    name = "swing_flexion.knee.equilibrium"
    try:
        page = Page(browser, walk, forecasts=True)
        page.wait(3.0)
        page.tab("table")
        page.page.click('.chip[data-phase="swing_flexion"]')
        before, offer = page.value(name), page.page.locator("#panel-forecast")
        page.type(name, 60.0)
        assert re.search(r"(falls|trips) after", page.forecast().lower())
        assert "bad" in offer.get_attribute("class") and offer.is_visible()
        assert page.value(name) == 60.0 and page.controls()[name]["value"] == pytest.approx(before)
        page.page.click("[data-forecast=discard]")
        assert not offer.is_visible() and page.value(name) == before
        page.row("swing_flexion.knee.gain").locator("input[type=number]").fill("0.41")
        page.row("swing_flexion.knee.gain").locator("input[type=number]").press("Enter")
        assert "walks on" in page.forecast().lower()
        assert "bad" not in (offer.get_attribute("class") or "")
        page.page.click("[data-forecast=apply]")
        until(lambda: page.controls()["swing_flexion.knee.gain"]["changed"], "the change")
        page.type(name, 1e3)
        assert "expected" in page.refusal(name) and page.value(name) == before
        page.close()
        assert walk.end() == 0
    finally:
        walk.close()
    (change,) = read_changes(walk)
    assert list(change["set"]) == ["table.phases.swing_flexion.knee.friction_compensation_gain"]


@pytest.mark.slow
def test_malformed_unknown_and_oversized_messages_are_refused_and_the_walk_goes_on(page: Page) -> None:
    begun = page.clock()
    wrong = {
        "[": "expected JSON",
        '{"kind": "set", "id": "x1", "user": "", "control": "warp", "value": 1}': "no 'warp'",
        '{"kind": "do", "id": "x2", "user": "", "action": "explode"}': "explode: is not available",
        '{"kind": "set", "id": "x3", "control": "belt_speed", "value": "fast"}': "belt_speed: expected",
        '{"kind": "set", "id": "x4", "user": "", "control": "belt_speed", "value": NaN}': "value: expected",
        f'{{"kind": "set", "id": "x5", "user": "{"u" * 5000}"}}': "at most 4096",
        "{" * 3000: "expected JSON",
    }
    page.tab("log")
    for text, reason in wrong.items():
        page.say(text)
        until(lambda reason=reason: any(reason in line for line in page.log()), reason)
    page.say("x" * 70_000)  # longer than what is read at all: the socket is closed, and opened again
    until(lambda: page.page.evaluate("livePanel.link.socket.readyState") != 1, "the socket to be closed")
    until(lambda: page.page.evaluate("livePanel.link.socket.readyState") == 1, "the page to come back")
    until(lambda: page.clock() > begun + 1.0, "the walk to go on")
    assert page.status() == "walking"


def test_page_of_another_origin_gets_nothing(browser: Any, treadmill: Walk, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("<title>evil</title>")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = subprocess.Popen(
        [sys.executable, "-m", "http.server", str(port), "--bind", "127.0.0.1", "-d", str(tmp_path)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    foreign = browser.new_page()
    try:
        until(lambda: answers(port), "the other site")
        foreign.goto(f"http://127.0.0.1:{port}/")
        outcome = foreign.evaluate(
            """port => new Promise((done) => {
                const socket = new WebSocket(`ws://127.0.0.1:${port}/panel`);
                socket.onopen = () => done("open");
                socket.onerror = () => done("refused");
            })""",
            treadmill.port,
        )
        assert outcome == "refused"
        answer = foreign.evaluate(
            """port => fetch(`http://127.0.0.1:${port}/stop`, {method: "POST", mode: "no-cors"})
                .then((answer) => answer.type)""",
            treadmill.port,
        )
        assert answer == "opaque"  # it may send the request; below the walk is checked to continue
    finally:
        foreign.close()
        server.terminate()
        server.wait()
    own = Page(browser, treadmill)
    assert own.status() == "walking"
    own.close()


# ---------------------------------------------------------------------- the walk


def test_five_pages_and_a_reload_show_the_same(browser: Any, treadmill: Walk) -> None:
    pages = [Page(browser, treadmill, draws=False) for _ in range(5)]
    before = pages[0].value("support_share")
    pages[0].type("support_share", 0.62)
    for one in pages:
        until(lambda one=one: one.value("support_share") == 0.62, "the change on every page")
    pages[1].open()
    assert pages[1].value("support_share") == 0.62
    assert any("support_share" in line for line in pages[1].log())
    pages[2].row("support_share").locator(".back").click()
    for one in pages:
        until(lambda one=one: one.value("support_share") == before, "the way back on every page")
    for one in pages:
        one.close()


def test_pause_and_walk_stop_and_start_the_time(page: Page) -> None:
    page.page.click("[data-action=pause]")
    until(lambda: page.status() == "paused", "the pause")
    held = page.clock()
    time.sleep(0.5)
    assert page.clock() == held
    page.page.click("[data-action=walk]")
    until(lambda: page.status() == "walking" and page.clock() > held + 0.2, "the walk")


def test_steps_by_hand_wait_for_the_button(page: Page) -> None:
    page.tab("walk")
    page.row("manual").locator("input").check()
    page.settle()
    until(lambda: page.status() == "waiting", "a leg that waits")
    page.page.click("[data-action=step]")
    until(lambda: page.status() == "walking", "the step")
    page.row("manual").locator("input").uncheck()
    page.settle()
    assert page.row("manual").locator(".rejection").inner_text() == ""


MEAN_OVER = 8.0  # [s]
OBSERVE = """(paths) => {
    const parts = (path) => path.split("/").filter((part) => part);
    const find = (path) => twinGait.stage.viewer.scene_tree.find(parts(path)).object;
    twinGait.stage.viewer.scene.updateMatrixWorld(true);
    const base = find("/meshcat").matrixWorld.clone().invert();
    const rows = [...document.querySelectorAll(".read tbody tr")];
    return {
      time: parseFloat(document.querySelector(".clock").textContent),
      matrices: paths.map((path) => base.clone().multiply(find(path).matrixWorld).toArray()),
      angles: rows.filter((row) => / angle$/.test(row.cells[0].textContent))
        .map((row) => [row.cells[1].textContent, row.cells[2].textContent]),
    };
}"""


@pytest.fixture(scope="module")
def joint_paths() -> dict[str, str]:
    model = load_experiment("treadmill_guided").experiment.build_world().model
    paths = ArticulatedFigure(CommandBuffer(), model.model).paths
    return {name: path for name, path in paths.items() if name != "universe"}


@pytest.fixture(scope="module")
def session(browser: Any, treadmill: Walk, joint_paths: dict[str, str]) -> dict[str, Any]:
    """Return a complete walk with every action of the panel, and the values shown on its page."""
    page = Page(browser, treadmill)
    page.page.wait_for_selector(".read tbody tr")  # the card is made with the first samples
    seen = []
    while len(seen) < 12:
        seen.append(page.page.evaluate(OBSERVE, list(joint_paths.values())))
        page.wait(0.1)
    until(lambda: page.clock() > MEAN_OVER + 1.0, "some strides before the change", 60.0)
    page.tab("walk")
    page.type("belt_speed", 1.4)
    page.type("support_share", 0.64)
    page.settle()
    changed = page.clock()
    assert page.refusal("belt_speed") == page.refusal("support_share") == ""
    page.tab("table")
    page.page.click('.chip[data-phase="swing_extension"]')
    page.type("swing_extension.knee.equilibrium", page.value("swing_extension.knee.equilibrium") + 0.5)
    page.settle()
    page.page.click("#panel-body [data-action=save]")
    until(lambda: page.page.locator(".action .done").count() > 0, "the name of the saved table")
    until(lambda: page.clock() > changed + MEAN_OVER + 1.0, "some strides after the change", 60.0)
    # The page does nothing for a while, as one that is slow; afterwards it has what it missed.
    page.page.evaluate("() => { const end = performance.now() + 2000; while (performance.now() < end); }")
    stalled = page.clock()
    until(lambda: page.clock() > stalled + 2.0, "the page to go on")
    curves = page.page.evaluate("twinGait.plots.runs[0].legs.map((leg) => [leg.side, leg.series])")
    page.page.click("#revert-all")
    until(lambda: page.page.locator("[data-difference]").count() == 0, "the way back")
    page.tab("disturb")
    page.page.select_option('[data-control="joint"] select', "right_hip")
    page.type("torque", 8)
    page.type("duration", 0.3)
    page.page.click("#panel-body [data-action=push]")
    page.settle()
    page.wait(1.0)
    page.page.select_option('[data-control="kind"] select', "encoder_freeze")
    page.page.select_option('[data-control="place"] select', "left_knee")
    page.page.click("#panel-body [data-action=fault]")
    page.settle()
    page.wait(0.2)
    page.page.focus("#tab-disturb")
    page.page.keyboard.press("Escape")
    until(lambda: page.status() == "held", "the hold")
    page.wait(0.3)
    shown = ("#panel-state", ".alarm", "#panel-log")
    hold = [page.page.locator(name).text_content() for name in shown]
    hold += [page.page.locator(".read .pill").all_text_contents()]
    page.page.click("[data-action=restart]")
    until(lambda: page.status() == "walking" and page.clock() > 0.2, "a new walk", 120.0)
    events = page.log()
    page.page.click("#stop")
    until(lambda: page.status() == "held", "the second hold")
    page.close()
    status = treadmill.end()
    second = treadmill.folder.with_name("run-2")
    first = read_stored_run(treadmill.folder)
    changes = read_changes(treadmill)
    return {"seen": seen, "status": status, "log": first.run.log, "changes": changes, "events": events,
            "again": read_stored_run(second).run, "summary": first.summary, "curves": curves,
            "hold": hold}  # fmt: skip


def test_joint_positions_on_the_page_equal_pinocchio(session, joint_paths: dict[str, str]) -> None:
    model = load_experiment("treadmill_guided").experiment.build_world().model
    data = model.model.createData()
    worst = 0.0
    for one in session["seen"]:
        row = session["log"].iloc[round(1000.0 * one["time"])]
        assert row["time_s"] == pytest.approx(one["time"], abs=1e-9)
        pin.forwardKinematics(model.model, data, posture(model, row))
        for name, matrix in zip(joint_paths, one["matrices"], strict=True):
            expected = data.oMi[model.model.getJointId(name)].homogeneous
            worst = max(worst, float(np.abs(np.array(matrix).reshape(4, 4).T - expected).max()))
    assert worst < 1e-4


@pytest.mark.slow
def test_numbers_on_the_page_equal_the_log(session) -> None:
    for one in session["seen"]:
        row = session["log"].iloc[round(1000.0 * one["time"])]
        assert len(one["angles"]) == 2
        for joint, shown in zip(("hip", "knee"), one["angles"], strict=True):
            for side, text in zip(("left", "right"), shown, strict=True):
                degrees = np.degrees(row[f"{side}_{joint}_angle_rad"])
                assert float(text.replace("\u2212", "-").rstrip("°")) == pytest.approx(degrees, abs=0.051)


def test_curves_of_a_page_that_was_slow_have_the_peaks_of_the_log(session) -> None:
    columns = {"knee": "knee_angle_rad", "hip_torque": "hip_motor_torque_Nm",
               "knee_impedance": "knee_impedance_torque_Nm", "force": "foot_normal_force_N"}  # fmt: skip
    assert [side for side, _ in session["curves"]] == ["left", "right"]
    for side, series in session["curves"]:
        for key, column in columns.items():
            times, values = (np.array(series[key][name], dtype=float) for name in ("times", "values"))
            ticks = np.round(1000.0 * times).astype(int)
            assert times[-1] - times[0] > 6.0 and np.isfinite(values).all()
            assert np.diff(ticks).max() < 2 * EXTREMES_TICKS  # nothing is missing
            truth = session["log"][f"{side}_{column}"].to_numpy() * (180 / np.pi if key == "knee" else 1.0)
            np.testing.assert_allclose(values, truth[ticks], atol=1e-6 * np.abs(truth).max())
            span = truth[ticks[0] : ticks[-1] + 1]
            for peak in (np.max, np.min):
                assert peak(values) == pytest.approx(peak(span), rel=1e-6)


def test_hold_shows_its_cause_and_joint(session) -> None:
    safety = session["summary"]["safety"]
    assert safety["tripped"]
    # The monitor trips on the fault, or the operator comes first, who is cause and place.
    because = ", ".join(dict.fromkeys([safety["cause"].replace("_", " "), safety["location"]]))
    state, card, log, pills = session["hold"]
    assert state == f"HOLD: {because}"
    assert (
        f"HOLD: {because} ({safety['time_s']:.3f} s)" in card and "Fault: encoder freeze, left knee" in card
    )
    assert f"trip: {because}" in log
    assert len(pills) == 2 and all(text.endswith("Hold") for text in pills)


def change(session: dict[str, Any], subject: str, number: int = 0) -> int:
    """Return the first tick with a change of a key or another event; ``number`` selects one of several."""
    found = [one for one in session["changes"] if subject in one or subject in one.get("set", {})]
    return round(1e3 * found[number]["time_s"])


def test_support_is_read_back_from_the_force_of_the_ropes(session) -> None:
    force = session["log"]["support_force_N"].to_numpy()
    began, end = change(session, "scenario.support.share"), change(session, "scenario.support.share", -1)
    # The ropes are dampers too: what counts is the mean over some strides of two seconds each.
    ticks = round(1000 * MEAN_OVER)
    before, after = force[began - ticks : began].mean(), force[end - ticks : end].mean()
    assert after / before == pytest.approx(0.64 / 0.60, rel=0.01)


def test_belt_speed_is_read_back_from_a_foot_that_stands_on_it(session) -> None:
    model = load_experiment("treadmill_guided").experiment.build_world().model
    log, key = session["log"], "scenario.belt_speed_m_per_s"
    began, end = change(session, key), change(session, key, -1)
    speeds = []
    for first, last in ((200, min(began, 6000)), (began + 400, end)):
        inside = log.iloc[first:last]
        standing = inside[
            (inside["left_phase"].astype(str) == "middle_stance") & (inside["left_foot_normal_force_N"] > 50)
        ]
        indices = standing.index.to_numpy()
        runs = [run for run in np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1) if len(run) > 60]
        assert runs, "the left leg did not stand"
        for run in runs[:1]:
            heel = [foot(model, log.iloc[tick]) for tick in (run[10], run[-10])]
            speeds.append((heel[0] - heel[1]) / ((run[-10] - run[10]) * TICK) * 3.6)
    assert speeds[0] == pytest.approx(1.5, abs=0.03)
    assert speeds[1] == pytest.approx(1.4, abs=0.03)


def foot(model: Any, row: pd.Series) -> float:
    """Return the forward position of the left sole in [m]."""
    frames = model.legs[Side.LEFT].contact_frames
    return float(np.mean([model.frame_position(posture(model, row), frame)[0] for frame in frames]))


def posture(model: Any, row: pd.Series) -> np.ndarray:
    """Return the coordinates of the model in a row of the log."""
    positions, _ = state_columns(model)
    return row[positions].to_numpy(dtype=float)


def test_push_is_read_back_from_the_torque_of_the_wearer(session) -> None:
    torque = session["log"]["right_hip_external_torque_Nm"].to_numpy()
    began = change(session, "push")
    pushed = np.flatnonzero(torque)
    assert (pushed[0], pushed[-1]) == (began, began + 299)
    assert (torque[pushed] == 8.0).all()


def test_fault_is_read_back_from_the_encoder(session) -> None:
    measured = session["log"]["left_knee_measured_angle_rad"].to_numpy()
    began = change(session, "fault")
    assert np.ptp(measured[began + 1 : began + 150]) == 0.0
    assert np.ptp(measured[began - 150 : began]) > 0.0


@pytest.mark.slow
def test_stop_holds_the_legs_from_its_tick_on(session) -> None:
    # The key; on a slow machine the monitor trips on the fault before it, and a Stop in a hold is no event.
    state, safety = session["log"]["safety_state"].to_numpy(), session["summary"]["safety"]
    began = round(1e3 * safety["time_s"])
    assert (state[:began] == 0).all() and (state[began + 1 :] == 1).all()
    stops = [round(1e3 * one["time_s"]) for one in session["changes"] if "stop" in one]
    assert stops == ([began] if safety["cause"] == "operator" else [])
    # The button, in a walk without a fault.
    state, last = session["again"].log["safety_state"].to_numpy(), session["again"].experiment.events[-1]
    assert isinstance(last, Stop) and 0 < last.tick < len(state)
    assert (state[: last.tick] == 0).all() and (state[last.tick + 1 :] == 1).all()


def test_saved_table_runs_in_simulate_with_the_values_of_the_panel(session, treadmill: Walk) -> None:
    (path,) = treadmill.folder.parent.glob("run-table-*.yaml")
    saved = load_experiment("treadmill_guided", [f"table={path}"]).experiment.table
    begun = load_experiment("treadmill_guided").experiment.table
    changed = saved.phases["swing_extension"].joints["knee"]
    preset = begun.phases["swing_extension"].joints["knee"]
    assert changed.equilibrium_angle - preset.equilibrium_angle == pytest.approx(0.5 * DEGREE, abs=1e-3)
    assert changed.stiffness == preset.stiffness


def test_ctrl_c_without_a_duration_is_the_way_to_end(session) -> None:
    assert session["status"] == 0
    assert session["events"], "nothing in the log of the page"
    assert (session["summary"]["duration_s"]) == pytest.approx(len(session["log"]) * TICK)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_nothing_is_left_when_the_command_is_gone(tmp_path: Path, number: int) -> None:
    walk = Walk(tmp_path, "bench_leg")
    try:
        loop = children(walk.process.pid)
        assert loop, "the walk has a process of its own"
        time.sleep(1.0)  # of walking
        walk.end(number)
    finally:
        walk.close()
    assert not answers(walk.port)
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in loop), "the loop to be gone")
    if number != signal.SIGKILL:
        assert (walk.folder / LOG_FILE).is_file()


def answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def children(pid: int) -> list[str]:
    """Return the child processes of a process, including those started by its threads."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has just gone
            if int(stat.read_text().rpartition(")")[2].split()[1]) == pid:
                found.append(stat.parent.name)
    return found
