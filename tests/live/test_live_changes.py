"""Tests of several changes in one message, a hanging process, and messages at too high a rate."""

import json
import os
import signal
import time
from collections import Counter
from contextlib import closing
from types import SimpleNamespace

import pytest
from errors import states
from test_live_loop import Rig, say, wait_for

from twin_gait.configuration.experiments import load_experiment
from twin_gait.live import telemetry
from twin_gait.live.controls import ControlPanel
from twin_gait.live.forecast import find_warnings
from twin_gait.live.page import BURST, LivePageServer
from twin_gait.live.protocol import DoAction, RateLimiter
from twin_gait.live.session import LiveSession
from twin_gait.live.telemetry import HANG_TIMEOUT, EventLog, WalkProcess
from twin_gait.simulation.simulation_setup import build_setup

K, ZERO = "late_stance.hip.stiffness", "swing_flexion.knee.equilibrium"


@pytest.fixture(scope="module")
def bench():
    return load_experiment("bench_leg", ["duration_s=60"])


@pytest.fixture(scope="module")
def session(bench, tmp_path_factory):
    folder = tmp_path_factory.mktemp("changes") / "run"
    with closing(LiveSession(loaded=bench, folder=folder, user="Ann", pictures=False)) as begun:
        begun.start()
        yield begun


def answers(session, number):
    return [item for item in session.event_log.after(0) if item.id == f"m{number}"]


# ---------------------------------------------------------------------- several changes


def test_several_changes_are_applied_in_one_tick_or_not_at_all(session):
    begun = {item.name: item.value for item in session.controls}
    say(session, kind="set", changes={K: 2.4, ZERO: 57.0})
    found = answers(session, say.count)
    assert [item.response for item in found] == ["applied"] * 2 and len({item.tick for item in found}) == 1
    assert [(item.subject, item.before, item.value) for item in found] == [
        (K, begun[K], pytest.approx(2.4)),
        (ZERO, begun[ZERO], pytest.approx(57.0)),
    ]
    # The last one is out of its range, or unsafe: the first one is not applied either.
    wrong = ({ZERO: 999.0}, f"{ZERO}: expected"), ({"middle_stance.hip.gain": 0.95}, "unstable")
    for last, reason in wrong:
        refused = say(session, kind="set", changes={K: 1.9, **last})
        assert refused.response == "refused" and refused.text.startswith(reason)
        assert {item.name: item.value for item in session.controls}[K] == pytest.approx(2.4)
    # Null goes back to the preset, together with a change.
    assert say(session, kind="set", changes={K: None, ZERO: 58.0}).response == "applied"
    shown = {item.name: item for item in session.controls}
    assert shown[K].value == begun[K] and not shown[K].changed and shown[ZERO].value == pytest.approx(58.0)


def test_one_forecast_is_made_of_several_changes_and_warns_of_unusual_ones(session):
    response = say(session, kind="try", changes={"middle_stance.knee.stiffness": 9.0, ZERO: 58.5})
    assert response.response == "forecast" and response.subject == ""
    assert "middle_stance.knee.stiffness: 3 → 9; swing_flexion.knee.equilibrium:" in response.text
    assert [text for text in response.forecast["warnings"] if text.startswith("middle stance: knee k 9.00")]
    one = say(session, kind="try", changes={K: 2.0})
    assert one.subject == K and one.forecast["warnings"] == ()


def test_warnings_name_a_spring_and_an_equilibrium_that_are_unusual():
    panel = ControlPanel(load_experiment("treadmill_guided", ["duration_s=1"]).experiment)
    begun = find_warnings(panel.preset)
    for name, value, text in (
        ("late_stance.hip.stiffness", 6.0, "late stance: hip k 6.00 N·m/deg is outside"),
        ("late_stance.hip.equilibrium", -30.0, "late stance: hip θ0 -30.0° is outside -20.0"),
    ):
        found = [item for item in find_warnings(panel.set(panel.preset, name, value)) if item not in begun]
        assert any(item.startswith(text) for item in found), found


# ---------------------------------------------------------------------- a process that hangs


def test_the_heartbeat_goes_on_in_a_pause_and_comes_from_the_loop(bench):
    rig = Rig(build_setup(bench.experiment), [(0.1, {"serial": 1, "command": "pause"}),
                                                (1.1, {"serial": 2, "command": "end"})])  # fmt: skip
    rig.loop.walk()
    kinds = Counter(item["kind"] for item in rig.sent)
    assert kinds["heartbeat"] == pytest.approx(100, abs=2)  # one in every 10 ms of the pause
    assert kinds["telemetry"] < 20


def test_silence_of_the_process_is_noted_once_and_so_is_its_end(bench, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(telemetry, "time", SimpleNamespace(monotonic=lambda: now[0]))
    book = EventLog()
    walk = WalkProcess(
        book, build_setup(bench.experiment), on_compile=lambda: None, on_store_failure=pytest.fail
    )
    monkeypatch.setattr(WalkProcess, "alive", True)

    def look(until):
        while now[0] < until:
            now[0] += 0.1
            silent = walk.time_since_message()
        return silent

    assert look(0.4) == pytest.approx(0.4) and book.after(0) == []
    assert look(3.0) == pytest.approx(3.0)
    (note,) = book.after(0)
    assert note.response == "note" and states(note.text, "0.5 s")
    walk._last_message = now[0] = 3.2
    assert walk.time_since_message() == 0.0 and states(book.after(1)[0].text, "3.2 s")
    now[0] += 30.0  # this program itself stood still: messages of the process may wait to be read
    assert walk.time_since_message() == pytest.approx(30.0) and len(book.after(0)) == 2
    walk._last_message = now[0]
    assert walk.time_since_message() == 0.0 and len(book.after(0)) == 2


def test_a_process_that_is_stopped_is_noticed_and_a_stop_is_not_confirmed(session):
    process = session.walk.process.pid
    wait_for(lambda: session.walk.time_since_message() < HANG_TIMEOUT)
    os.kill(process, signal.SIGSTOP)
    try:
        wait_for(lambda: session.walk.time_since_message() > HANG_TIMEOUT)
        coming = session.submit(DoAction(id="late", action="stop"))
        time.sleep(0.2)
        assert not coming.done()
    finally:
        os.kill(process, signal.SIGCONT)
    assert coming.result(10.0)  # confirmed at last
    wait_for(lambda: session.walk.time_since_message() < HANG_TIMEOUT and session.walk.status == "held")
    texts = [item.text for item in session.event_log.after(0)]
    assert [sum(text.startswith(f"the process of the simulation {words}") for text in texts)
            for words in ("has sent nothing", "sends again")] == [1, 1]  # fmt: skip


# ---------------------------------------------------------------------- messages that come too fast


@pytest.fixture
def listening(monkeypatch):
    """Return a page without a server, the messages that its session receives, and a panel."""
    monkeypatch.setattr(RateLimiter, "__init__", frozen_limit)
    page, submitted, book = LivePageServer.__new__(LivePageServer), [], EventLog()
    page._session = SimpleNamespace(event_log=book, user="Ann", submit=submitted.append)
    return page, submitted, book


def frozen_limit(limit, rate, burst):
    """Return a rate limit that is not refilled by time, so that the test counts instead of waiting."""
    limit.dropped, limit._rate, limit._burst, limit._left, limit._last = 0, 0.0, burst, float(burst), 0.0


def test_a_flood_of_a_page_is_cut_off_with_one_line_and_stop_still_passes(listening):
    page, submitted, book = listening
    panel, other = (SimpleNamespace(limit=RateLimiter(20, BURST)) for _ in range(2))
    for _ in range(BURST + 500):
        page.receive(panel, '{"kind": "set", "' + "x" * 3000 + '": 1}')
    events = book.after(0)
    assert len(events) == BURST + 1 and max(len(item.text) for item in events) < 250
    assert events[-1].response == "refused" and states(events[-1].text, "20")
    page.receive(panel, json.dumps({"kind": "do", "id": "1", "action": "stop"}))
    page.receive(panel, json.dumps({"kind": "do", "id": "2", "action": "walk"}))
    assert [item.action for item in submitted] == ["stop"]
    page.receive(other, json.dumps({"kind": "do", "id": "3", "action": "walk"}))
    assert [item.action for item in submitted] == ["stop", "walk"]  # other pages are not affected
    panel.limit._left = 1.0
    page.receive(panel, json.dumps({"kind": "do", "id": "4", "action": "pause"}))
    assert submitted[-1].action == "pause"
    assert states(book.after(0)[-1].text, "501")
