"""The live page in headless Chromium: a hung simulation, the list of changes, the order of the log, keys."""

from __future__ import annotations

import math
import os
import signal
import socket
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from test_live_browser import Page, Walk, browser, children, read_changes, until

__all__ = ["browser"]  # a fixture

pytestmark = [pytest.mark.slow, pytest.mark.browser]

K, HIP = "middle_stance.knee.stiffness", "middle_stance.hip.equilibrium"
IDLE = 320
CHANGING = ["panel-quick", "body-walk", "body-table", "body-monitor", "body-disturb", "panel-forecast"]


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Walk]:
    begun = Walk(tmp_path_factory.mktemp("state"), "treadmill_guided")
    yield begun
    begun.close()


@pytest.fixture
def page(browser: Any, walk: Walk) -> Iterator[Page]:
    opened = Page(browser, walk, forecasts=True)
    if opened.status() != "walking":
        opened.page.click("[data-action=restart]")
        until(lambda: opened.status() == "walking", "a new walk")
    yield opened
    # A stop that is not confirmed is answered with status 504, which Chromium notes.
    opened.complaints = [text for text in opened.complaints if "status of 504" not in text]
    opened.close()


@contextmanager
def stopped(process: int) -> Iterator[None]:
    os.kill(process, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(process, signal.SIGCONT)


def no_data(page: Page) -> str:
    shown = page.page.locator("#no-data")
    return str(shown.inner_text()) if shown.is_visible() else ""


def inert(page: Page) -> set[bool]:
    return set(page.page.evaluate("ids => ids.map((id) => document.getElementById(id).inert)", CHANGING))


# ---------------------------------------------------------------------- a simulation that hangs


@pytest.mark.parametrize("process_kind", ["child", "server"])
def test_a_hung_simulation_is_seen_and_a_stop_is_not_confirmed_before_it_answers(
    page: Page, walk: Walk, process_kind: str
) -> None:
    assert no_data(page) == "" and inert(page) == {False}
    process = walk.process.pid if process_kind == "server" else int(children(walk.process.pid)[0])
    with stopped(process):
        until(lambda: no_data(page).startswith("No data for 0.5 s"), "half a second without data")
        until(lambda: no_data(page).startswith("No data for 2 s"), "two of them")
        reason = "The program" if process_kind == "server" else "The process of the simulation"
        assert f"{reason} does not respond" in no_data(page)
        assert page.status() == "no_data" and inert(page) == {True}
        assert "grayscale" in page.page.evaluate("getComputedStyle(document.querySelector('.pane')).filter")
        stop, stop_state = page.page.locator("#stop"), page.page.locator("#stop-state")
        assert stop.is_enabled()
        stop.click()
        assert stop_state.inner_text() == "Stop sent"
        until(lambda: stop_state.get_attribute("data-kind") == "missing", "the missing confirmation")
        assert stop_state.inner_text().startswith("Stop has not been confirmed for 0.5 s")
        until(
            lambda: stop_state.inner_text().startswith("Stop has not been confirmed for 2 s"),
            "two seconds of it",
        )
    until(lambda: stop_state.inner_text().startswith("Stop confirmed after"), "the confirmation")
    until(lambda: page.status() == "held" and no_data(page) == "", "the hold")
    assert inert(page) == {False}
    assert ("sent nothing" in "".join(page.log())) or process_kind == "server"
    page.page.click("[data-action=restart]")
    until(
        lambda: page.status() == "walking" and not stop_state.is_visible(), "a new walk, without the old stop"
    )


def test_a_pause_is_not_taken_for_a_hung_simulation(page: Page) -> None:
    page.page.click("[data-action=pause]")
    until(lambda: page.status() == "paused", "the pause")
    for _ in range(20):
        assert page.status() == "paused" and no_data(page) == ""
        time.sleep(0.1)
    page.page.click("[data-action=walk]")
    until(lambda: page.status() == "walking", "the walk")


def test_stop_of_the_owner_is_answered_during_an_attack_of_idle_connections(page: Page, walk: Walk) -> None:
    token = walk.url.partition("?")[2]
    idle = [socket.create_connection(("127.0.0.1", walk.port)) for _ in range(IDLE)]
    try:
        request = urllib.request.Request(
            f"{walk.home}stop?{token}", method="POST", headers={"Origin": walk.home.rstrip("/")}
        )
        with urllib.request.urlopen(request, timeout=0.5) as answer:
            assert answer.read() == b"stopped\n"
        until(lambda: page.status() == "held", "the hold")
        page.page.click("[data-action=restart]")
        until(lambda: page.status() == "walking", "the page to go on")
    finally:
        for caller in idle:
            caller.close()


def test_controls_of_a_session_that_is_gone_are_disabled(browser: Any, tmp_path: Path) -> None:
    walk = Walk(tmp_path, "bench_leg")
    page = Page(browser, walk, forecasts=True)
    walk.end(signal.SIGKILL)
    until(lambda: page.status() == "offline" and no_data(page), "the end")
    assert inert(page) == {True} and "not connected" in no_data(page)
    page.page.click("#stop")
    until(lambda: "not been confirmed" in page.page.locator("#stop-state").inner_text(), "the red line")
    page.page.close()


# ---------------------------------------------------------------------- changes that wait


def test_changes_wait_in_a_list_with_one_forecast_and_one_apply(browser: Any, tmp_path: Path) -> None:
    walk = Walk(tmp_path, "treadmill_guided")
    page = Page(browser, walk, forecasts=True)
    lines = page.page.locator("#panel-forecast li")
    try:
        page.wait(2.0)
        page.tab("table")
        page.page.click('.chip[data-phase="middle_stance"]')
        begun = page.value(K), page.value(HIP)
        page.type(K, 9.0)  # above the present value, and above the published range
        page.type(HIP, -22.5)
        forecast = page.forecast()
        assert (
            lines.count() == 2
            and "Unusual: middle stance: knee k 9.00" in forecast
            and "Walks on" in forecast
        )
        assert (page.value(K), page.value(HIP)) == (9.0, -22.5)
        assert not any(item["changed"] for item in page.controls().values())
        # A refusal is that of the last edit alone.
        page.type("middle_stance.knee.gain", 7)
        assert "expected 0 to 1" in page.refusal("middle_stance.knee.gain")
        page.forecast()
        assert lines.count() == 2
        # One that is taken out while its forecast is being made does not come back with it.
        page.type("middle_stance.knee.gain", 0.5)
        page.type("middle_stance.knee.gain", page.controls()["middle_stance.knee.gain"]["value"])
        page.settle()
        page.forecast()
        assert lines.count() == 2
        # One of them is taken out, and back in.
        page.page.click(f'[data-change="{K}"] .remove')
        assert page.value(K) == begun[0] and "Unusual: middle stance: knee" not in page.forecast()
        page.type(K, 8.5)
        page.forecast()
        page.page.click("[data-forecast=apply]")
        until(lambda: all(page.controls()[name]["changed"] for name in (K, HIP)), "both changes")
        until(lambda: not page.page.locator("#panel-forecast").is_visible(), "the list to be gone")
        assert (page.value(K), page.value(HIP)) == (8.5, -22.5)
        # The way back is a change like any other.
        page.row(K).locator(".back").click()
        page.forecast()
        page.page.click("[data-forecast=apply]")
        until(lambda: not page.controls()[K]["changed"], "the preset")
        page.close()
        assert walk.end() == 0
    finally:
        walk.close()
    both, back = (item["set"] for item in read_changes(walk))  # one event for all changes of the list
    knee = "table.phases.middle_stance.knee.stiffness_Nm_per_rad"
    assert len(both) == 2 and any(
        key.startswith("table.phases.middle_stance.hip.equilibrium") for key in both
    )
    assert list(back) == [knee] and both[knee] == pytest.approx(math.degrees(8.5))


def test_a_forecast_is_made_again_after_a_hold_and_after_a_change_of_another_page(
    page: Page, browser: Any, walk: Walk
) -> None:
    page.page.set_viewport_size({"width": 480, "height": 800})
    page.tab("table")
    page.page.click('.chip[data-phase="middle_stance"]')
    page.type(K, 8.3)
    assert "after a new start" not in page.forecast().lower()
    page.page.keyboard.press("Escape")
    until(lambda: page.status() == "held", "the hold")
    until(lambda: "After a new start" in page.forecast(), "a forecast of what comes after the hold")
    page.page.click("[data-action=restart]")
    until(lambda: page.status() == "walking", "a new walk")
    until(lambda: "After a new start" not in page.forecast(), "a forecast of the new walk")
    made = page.page.evaluate("livePanel.changes.event.serial")
    other = Page(browser, walk, draws=False)
    other.tab("walk")
    other.type("support_share", 0.61)
    other.settle()
    serial = "livePanel.changes.event.serial"
    until(lambda: page.forecast() and page.page.evaluate(serial) > made, "another forecast")
    other.row("support_share").locator(".back").click()
    other.settle()
    other.close()
    page.forecast()
    page.page.click("[data-forecast=discard]")
    assert page.value(K) == pytest.approx(page.controls()[K]["value"])


def test_a_silence_does_not_discard_a_forecast(page: Page) -> None:
    """Regression: on a slow machine silence before the next forecast disabled the button Apply."""
    page.tab("table")
    page.page.click('.chip[data-phase="middle_stance"]')
    page.type(K, 8.3)
    page.forecast()
    beats = """() => {
        const receive = livePanel.link.socket.onmessage, classes = document.body.classList;
        const silent = [2, 0].map((seconds) => {
            receive({data: JSON.stringify([{kind: "heartbeat", time_since_message_s: seconds}])});
            return classes.contains("without-data"); });
        return [...silent, livePanel.changes.busy, livePanel.changes.edits.length]; }"""
    # The first look of a page that stood still itself counts for nothing.
    found = until(lambda: (now := page.page.evaluate(beats))[0] and now, "a silence")
    assert found == [True, False, False, 0]
    page.page.click("[data-forecast=discard]")


# ---------------------------------------------------------------------- faults, keys, log


def test_break_it_begins_with_a_place_that_fits(page: Page) -> None:
    page.tab("disturb")
    selector = page.page.locator('[data-control="place"] select')
    offered = {}
    for kind in ("supply_dip", "foot_load_stuck", "encoder_freeze"):
        page.page.select_option('[data-control="kind"] select', kind)
        offered[kind] = selector.locator("option").evaluate_all("list => list.map((one) => one.value)")
    assert offered["supply_dip"] == [""] and offered["foot_load_stuck"] == ["left_foot", "right_foot"]
    assert "left_hip" in offered["encoder_freeze"] and selector.input_value() == "left_hip"
    page.page.click("#panel-body [data-action=fault]")
    done = page.page.locator(".action .done")
    until(lambda: done.count() > 0, "the fault")
    assert "encoder_freeze:left_hip" in done.inner_text()
    page.page.click("[data-action=restart]")
    until(lambda: page.status() == "walking" and page.clock() < 2.0, "a new walk")


def test_the_key_of_the_tooltip_changes_light_and_dark_but_not_while_typing(page: Page) -> None:
    theme = "document.documentElement.dataset.theme"
    begun = page.page.evaluate(theme)
    page.page.keyboard.press("t")
    assert {begun, page.page.evaluate(theme)} == {"light", "dark"}
    page.page.keyboard.press("t")
    page.tab("disturb")
    page.page.locator('[data-control="size"] input').press("t")
    assert page.page.evaluate(theme) == begun


def test_the_log_is_in_the_order_of_walks_and_ticks(page: Page) -> None:
    receive = "(batch) => livePanel.link.socket.onmessage({data: JSON.stringify(batch)})"
    phases = page.page.evaluate("[...livePanel.board.colours.values()]")

    def event(serial: int, tick: int, text: str, **rest: str) -> dict[str, Any]:
        words = {"kind": "event", "response": "applied", "id": "", "subject": "", **rest}
        return {**words, "serial": serial, "tick": tick, "text": text}

    # A forecast belongs to the time of its request, and arrives later.
    events = [event(1, 100, "a"), event(2, 900, "c"), event(3, 500, "b", response="forecast"),
              event(4, 0, "again", subject="restart"), event(5, 50, "d")]  # fmt: skip
    page.page.evaluate(receive, [{"kind": "page", "session": "another", "phases": phases}, *events])
    assert page.log() == ["d", "again", "c", "b", "a"]
