"""Tests of the server of the live page: access, published messages, and the effect of a frozen page."""

import asyncio
import json
import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from errors import raises, states
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_messages import unpacked
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

from twin_gait.cli import main
from twin_gait.exceptions import ViewerError
from twin_gait.files import write_atomically
from twin_gait.live.page import LivePageServer
from twin_gait.viewer import server as scene_server
from twin_gait.viewer.commands import CommandBuffer, set_object, set_property
from twin_gait.viewer.server import (
    LONGEST_MESSAGE,
    MOST_WAITING,
    SceneServer,
    SendBuffer,
    is_loopback,
    is_own_page,
)

PAGE = "<!DOCTYPE html><title>page</title>"


class RecordingServer(LivePageServer):
    """Server without a simulation that records received messages."""

    def __init__(self, window: CommandBuffer, port: int = 0) -> None:
        self.received: list[str] = []
        self.stops, self.confirms, self.window = 0, True, window
        self.reported = ("<title>report</title>", "")
        SceneServer.__init__(self, PAGE, first_port=port)

    def initial_messages(self) -> list[dict[str, Any]]:
        return [{"kind": "state", "number": 1}]

    def scene(self) -> list[Any]:
        return [("scene", self.window.packed())] if self.window.commands() else []

    def receive(self, panel: Any, text: str) -> None:
        self.received.append(text)
        panel.send({"kind": "received", "text": text})

    async def report(self) -> tuple[str, str]:
        return self.reported

    async def stop(self) -> bool:
        self.stops += 1
        return self.confirms


class Listener:
    """Recording server and its clients."""

    def __init__(self, window: CommandBuffer | None = None) -> None:
        self.server = RecordingServer(window or CommandBuffer())
        self.origin, self.key = self.server.url.split("/?")
        self.clients: list[Any] = []

    @property
    def received(self) -> list[str]:
        return self.server.received

    @property
    def stops(self) -> int:
        return self.server.stops

    async def connect(self, path: str, *, key: str | None = None, **headers: str) -> Any:
        headers = {"Origin": self.origin, **{name.title(): value for name, value in headers.items()}}
        address = f"ws://127.0.0.1:{self.server.port}{path}?{self.key if key is None else key}"
        client = await websocket_connect(HTTPRequest(address, headers=headers))
        self.clients.append(client)
        return client

    async def close(self) -> None:
        streams = [client.protocol.stream for client in self.clients if client.protocol is not None]
        for client in self.clients:
            client.close()
        await self.server.close()
        await until(lambda: all(stream.closed() for stream in streams))
        AsyncHTTPClient().close()

    async def fetch(self, path: str, *, key: str | None = None, **options: Any) -> Any:
        address = f"{self.origin}{path}?{self.key if key is None else key}"
        return await AsyncHTTPClient().fetch(address, raise_error=False, **options)


def with_listener(scene: Callable[[Listener], Awaitable[None]], window: CommandBuffer | None = None) -> None:
    async def run() -> None:
        listener = Listener(window)
        try:
            await asyncio.wait_for(scene(listener), 20.0)
        finally:
            await listener.close()

    asyncio.run(run())


async def receive(panel: Any, kind: str) -> dict[str, Any]:
    """Return the next message of a kind."""
    while True:
        batch = await asyncio.wait_for(panel.read_message(), 5.0)
        assert batch is not None, "the socket was closed"
        for item in json.loads(batch):
            if item["kind"] == kind:
                return dict(item)


async def until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + 5.0
    while not true():
        assert time.monotonic() < end, "waited in vain"
        await asyncio.sleep(0.005)


def frozen_page(listener: Listener, path: str) -> socket.socket:
    """Open a socket that is no longer read."""
    port = listener.server.port
    page = socket.create_connection(("127.0.0.1", port))
    page.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    page.sendall(
        f"GET {path}?{listener.key} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}\r\n"
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
    )
    return page


# ---------------------------------------------------------------------- who may talk


def test_page_is_served_and_nothing_else() -> None:
    async def scene(listener: Listener) -> None:
        page = await listener.fetch("/")
        assert (page.code, page.body.decode()) == (200, PAGE)
        assert "frame-ancestors 'none'" in page.headers["Content-Security-Policy"]
        for path in (
            "/static/main.min.js",
            "/../server.py",
            "/%2e%2e/index.html",
            "/favicon.ico",
            "/panel.js",
        ):
            answer = await listener.fetch(path)
            assert answer.code == 404, path

    with_listener(scene)


@pytest.mark.parametrize("path", ["/socket", "/panel"])
@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "https://127.0.0.1:{port}"},
        {"origin": "http://127.0.0.1:{other}"},
        {"origin": "null"},
        # DNS rebinding: a name of theirs that points at this machine.
        {"origin": "http://evil.example:{port}", "host": "evil.example:{port}"},
        {"host": "evil.example:{port}"},
    ],
)
def test_another_origin_gets_no_socket(path: str, headers: dict[str, str]) -> None:
    async def scene(listener: Listener) -> None:
        port = listener.server.port
        filled = {name: value.format(port=port, other=port + 1) for name, value in headers.items()}
        with raises(HTTPClientError, "403"):
            await listener.connect(path, **filled)
        assert not listener.server.pages and not listener.server.views

    with_listener(scene)


def test_the_report_or_the_reason_of_its_failure_is_served_with_the_token() -> None:
    async def scene(listener: Listener) -> None:
        page = await listener.fetch("/report")
        assert (page.code, page.body.decode()) == (200, "<title>report</title>")
        assert (await listener.fetch("/report", key="token=guess")).code == 403
        listener.server.reported = ("", "no record: <b>é</b>\n")
        failed = await listener.fetch("/report")
        assert (failed.code, failed.body.decode()) == (503, "no record: <b>é</b>\n")
        assert failed.headers["Content-Type"].startswith("text/plain")

    with_listener(scene)


def test_another_origin_gets_no_page_and_cannot_stop() -> None:
    async def scene(listener: Listener) -> None:
        foreign = {"Origin": "http://evil.example"}
        rebound = {"Host": f"evil.example:{listener.server.port}"}
        for path, method in (("/", "GET"), ("/nothing", "GET"), ("/report", "GET"), ("/stop", "POST")):
            for headers in (foreign, rebound):
                body = b"" if method == "POST" else None
                answer = await listener.fetch(path, method=method, headers=headers, body=body)
                assert answer.code == 403, (path, headers)
        # A form of another site may leave its origin out; a stop needs ours.
        assert (await listener.fetch("/stop", method="POST", body=b"")).code == 403
        assert (await listener.fetch("/stop", method="GET")).code == 403
        assert b"only pages of this server" in (await listener.fetch("/stop", method="GET")).body
        assert listener.stops == 0
        own = {"Origin": listener.origin}
        assert (await listener.fetch("/stop", method="POST", headers=own, body=b"")).code == 200
        assert listener.stops == 1

    with_listener(scene)


WRONG_KEYS = ["", "token=", "token=wrong", "token=%ff%fe", "Token={}", "token={}x", "token=wrong&token={}x"]


@pytest.mark.parametrize("wrong", WRONG_KEYS)
def test_nothing_answers_without_the_token_of_this_start(wrong: str) -> None:
    async def scene(listener: Listener) -> None:
        key = wrong.format(listener.key.partition("=")[2])
        own = {"Origin": listener.origin, "Cookie": listener.key}
        for path, method, body in (
            ("/", "GET", None),
            ("/", "HEAD", None),
            ("/nothing", "GET", None),
            ("/socket", "GET", None),
            ("/stop", "POST", b""),
            ("/stop", "POST", listener.key.encode()),
        ):
            answer = await listener.fetch(path, key=key, method=method, headers=own, body=body)
            assert answer.code == 403, (path, method)
            assert PAGE.encode() not in (answer.body or b"")
        for path in ("/socket", "/panel"):
            with raises(HTTPClientError, "403"):
                await listener.connect(path, key=key)
        assert not listener.stops and not listener.server.pages and not listener.server.views

    with_listener(scene)


def test_token_cannot_be_guessed() -> None:
    async def scene(listener: Listener) -> None:
        assert len(bytes.fromhex(listener.key.removeprefix("token="))) * 8 >= 128

    with_listener(scene)


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.0.0.1:7000", "localhost", "LOCALHOST:80", "localhost:7001"]
)
def test_names_of_this_machine_are_its_own(host: str) -> None:
    assert is_loopback(host)
    assert is_own_page(f"http://{host}", host)
    assert not is_own_page(None, host)


@pytest.mark.parametrize(
    "host",
    ["", "evil.example", "127.0.0.1.evil.example", "localhost.evil.example", "evil@127.0.0.1x", "0.0.0.0",
     "127.0.0.2", "[::1", "[::1]:7000", "localhost evil.example", "evil.example#127.0.0.1"],
)  # fmt: skip
def test_other_names_are_not(host: str) -> None:
    assert not is_loopback(host)
    assert not is_own_page(f"http://{host}", host)


def listening_addresses() -> set[str]:
    """Return the addresses on which this process listens, as the kernel lists them."""
    own = set()
    for descriptor in Path("/proc/self/fd").iterdir():
        target = os.readlink(descriptor) if descriptor.is_symlink() else ""
        if target.startswith("socket:["):
            own.add(target[8:-1])
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and fields[9] in own:
                found.add(fields[1])
    return found


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="needs /proc of Linux")
def test_nothing_listens_on_another_address() -> None:
    before = listening_addresses()

    async def scene(listener: Listener) -> None:
        assert listening_addresses() - before == {f"0100007F:{listener.server.port:04X}"}

    with_listener(scene)


def test_occupied_port_is_replaced_by_the_next() -> None:
    async def scene(listener: Listener) -> None:
        taken = listener.server.port
        second = RecordingServer(CommandBuffer(), taken)
        try:
            assert taken < second.port < taken + 100
            assert second.url.startswith(f"http://127.0.0.1:{second.port}/?token=")
            assert second.url.partition("=")[2] not in listener.key  # every start has its own
        finally:
            await second.close()

    with_listener(scene)


def test_no_free_port_is_one_line_with_a_suggestion() -> None:
    async def run() -> None:
        with raises(ViewerError, "--port") as caught:
            RecordingServer(CommandBuffer(), 65535)
        assert "\n" not in str(caught.value)

    with socket.socket() as blocker:
        try:
            blocker.bind(("127.0.0.1", 65535))
        except OSError:
            pytest.skip("port 65535 is in use")
        asyncio.run(run())


# ---------------------------------------------------------------------- how many, and how long


def disconnected(caller: socket.socket, within: float) -> bool:
    caller.settimeout(within)
    try:
        while caller.recv(4096):
            pass
    except TimeoutError:
        return False
    except ConnectionError:
        pass
    return True


def test_silent_and_slow_clients_are_disconnected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_server, "REQUEST_TIMEOUT", 0.3)

    async def scene(listener: Listener) -> None:
        head = f"Host: 127.0.0.1:{listener.server.port}\r\nOrigin: {listener.origin}\r\n"
        openings = {
            "nothing": "",
            "half a request": "GET / HT",
            "half the headers": f"GET /?{listener.key} HTTP/1.1\r\n{head}",
            "no second request": f"GET /?{listener.key} HTTP/1.1\r\n{head}\r\n",
            "half a body": f"POST /stop?{listener.key} HTTP/1.1\r\n{head}Content-Length: 9\r\n\r\nabc",
        }
        panel = await listener.connect("/panel")
        for name, text in openings.items():
            with socket.create_connection(("127.0.0.1", listener.server.port)) as caller:
                caller.sendall(text.encode())
                assert await asyncio.to_thread(disconnected, caller, 3.0), name
        await panel.write_message("still here")  # an open page may be silent for as long as it likes
        assert (await receive(panel, "received"))["text"] == "still here"
        assert not listener.stops

    with_listener(scene)


FEW_FILES = """
import asyncio, resource, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (128, 128))
from twin_gait.viewer.server import SceneServer

async def run():
    print(SceneServer("page", first_port=0).url, flush=True)
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)

asyncio.run(run())
"""


def test_many_clients_cause_no_output_and_leave_file_descriptors_free() -> None:
    """130 of them at ``ulimit -n 128`` gave 23 MB of traces in seconds."""
    with subprocess.Popen(
        [sys.executable, "-c", FEW_FILES], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        assert process.stdout
        url = process.stdout.readline().strip()
        callers = [socket.create_connection(("127.0.0.1", urlsplit(url).port)) for _ in range(130)]
        time.sleep(0.5)
        inside = [caller for caller in callers if not disconnected(caller, 0.01)]
        assert len(inside) == 32  # half of the files are for connections, and half of those for the token
        for caller in callers:
            caller.close()
        page = urllib.request.urlopen(url, timeout=5.0).read()
        _, output = process.communicate()
    assert page == b"page"
    assert output == ""


IDLE = 320  # connections without the token, which shut out the owner before
ROUNDS = 20  # of requests of the owner during the attack


def test_owner_is_answered_while_idle_connections_without_the_token_are_renewed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(scene_server, "FIRST_REQUEST", 60.0)  # the limit of the number alone has to do

    async def scene(listener: Listener) -> None:
        address, idle = ("127.0.0.1", listener.server.port), []
        own = {"Origin": listener.origin}

        def attack(count: int) -> None:
            idle.extend(socket.create_connection(address) for _ in range(count))

        await asyncio.to_thread(attack, IDLE)
        panel = await listener.connect("/panel")
        for _ in range(ROUNDS):
            answer = await listener.fetch(
                "/stop", method="POST", headers=own, body=b"", connect_timeout=0.5, request_timeout=0.5
            )
            assert answer.code == 200
            await asyncio.to_thread(attack, IDLE // ROUNDS)
        assert listener.stops == ROUNDS
        await panel.write_message("still here")  # what has shown the token is not closed
        assert (await receive(panel, "received"))["text"] == "still here"
        for caller in idle:
            caller.close()

    with_listener(scene)


def test_clients_without_the_token_are_disconnected_early(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_server, "FIRST_REQUEST", 0.1)

    async def scene(listener: Listener) -> None:
        address = "127.0.0.1", listener.server.port
        wrong = f"GET /?token=wrong HTTP/1.1\r\nHost: 127.0.0.1:{listener.server.port}\r\n\r\n"
        for text in ("", wrong):
            with socket.create_connection(address) as caller:
                caller.sendall(text.encode())
                assert await asyncio.to_thread(disconnected, caller, 5.0), text
        with socket.create_connection(address) as owner:
            owner.sendall(wrong.replace("token=wrong", listener.key).encode())
            assert not await asyncio.to_thread(disconnected, owner, 0.5)

    with_listener(scene)


def test_a_stop_that_the_simulation_does_not_confirm_is_not_answered_as_done() -> None:
    async def scene(listener: Listener) -> None:
        listener.server.confirms = False
        own = {"Origin": listener.origin}
        answer = await listener.fetch("/stop", method="POST", headers=own, body=b"")
        assert answer.code == 504 and "not confirmed" in answer.reason
        assert listener.stops == 1

    with_listener(scene)


# ---------------------------------------------------------------------- received messages


def test_message_is_forwarded_unchanged() -> None:
    async def scene(listener: Listener) -> None:
        panel = await listener.connect("/panel")
        assert (await receive(panel, "state"))["number"] == 1
        for text in ('{"kind": "set"}', "[", "", "ünïcode \u2028", "x" * 60000):
            await panel.write_message(text)
            assert (await receive(panel, "received"))["text"] == text
        assert len(listener.received) == 5

    with_listener(scene)


def test_oversized_message_ends_its_socket_and_no_other() -> None:
    async def scene(listener: Listener) -> None:
        guilty, other = await listener.connect("/panel"), await listener.connect("/panel")
        await receive(guilty, "state")
        await guilty.write_message("x" * (LONGEST_MESSAGE + 1))
        while await asyncio.wait_for(guilty.read_message(), 5.0) is not None:
            pass
        assert guilty.close_code == 1009
        await until(lambda: len(listener.server.pages) == 1)
        await other.write_message("still here")
        assert (await receive(other, "received"))["text"] == "still here"
        assert listener.received == ["still here"]

    with_listener(scene)


def test_socket_of_the_scene_does_not_listen() -> None:
    async def scene(listener: Listener) -> None:
        view = await listener.connect("/socket")
        await view.write_message('{"kind": "do", "action": "stop"}')
        panel = await listener.connect("/panel")
        await panel.write_message("after")
        await receive(panel, "received")
        assert listener.received == ["after"] and not listener.stops

    with_listener(scene)


def test_page_receives_no_more_before_it_has_drawn_the_last_frame() -> None:
    window = CommandBuffer()

    async def scene(listener: Listener) -> None:
        view = await listener.connect("/socket")
        await until(lambda: len(listener.server.views) == 1)
        for step in range(10):
            window.send(set_property("/a", "position", [float(step)]))
            window.sample({"time": float(step)})
            listener.server.show(window.changes())
            await asyncio.sleep(0.002)
        first = unpacked(await asyncio.wait_for(view.read_message(), 5.0))
        assert [item["type"] for item in first] == ["set_property", "sample"]
        coming = asyncio.ensure_future(view.read_message())
        await asyncio.sleep(0.1)
        assert not coming.done()
        await view.write_message("drawn")
        commands = unpacked(await asyncio.wait_for(coming, 5.0))
        # The newest posture, and every sample for the curves.
        assert [item["value"] for item in commands if item["type"] == "set_property"] == [[9.0]]
        times = [item["sample"]["time"] for item in commands if item["type"] == "sample"]
        assert times == [float(step) for step in range(1, 10)]

    with_listener(scene, window)


# ---------------------------------------------------------------------- published messages


def test_page_that_comes_late_gets_the_whole_scene() -> None:
    window = CommandBuffer()
    window.send({"type": "page", "path": "", "page": {"title": "first"}})
    for step in range(50):
        window.send(set_property("/belt", "position", [float(step), 0.0, 0.0]))
        window.send(set_property("/belt", "visible", step % 2 == 0))
        window.sample({"time": float(step)})

    async def scene(listener: Listener) -> None:
        view = await listener.connect("/socket")
        commands = unpacked(await asyncio.wait_for(view.read_message(), 5.0))
        assert [item["type"] for item in commands] == ["page", "set_property", "set_property", "sample"]
        assert commands[1]["value"] == [49.0, 0.0, 0.0]
        assert commands[2]["value"] is False
        assert commands[3]["sample"] == {"time": 49.0}

    with_listener(scene, window)


def test_several_pages_get_every_change() -> None:
    window = CommandBuffer()

    async def scene(listener: Listener) -> None:
        views = [await listener.connect("/socket") for _ in range(5)]
        await until(lambda: len(listener.server.views) == 5)
        window.send(set_property("/a", "visible", True))
        listener.server.show(window.changes())
        for view in views:
            (command,) = unpacked(await asyncio.wait_for(view.read_message(), 5.0))
            assert (command["path"], command["value"]) == ("/a", True)
        assert window.changes() == []

    with_listener(scene, window)


def test_frozen_page_misses_frames_and_delays_no_other_page() -> None:
    window = CommandBuffer()

    async def scene(listener: Listener) -> None:
        frozen = frozen_page(listener, "/socket")
        view = await listener.connect("/socket")
        await until(lambda: len(listener.server.views) == 2)
        worst, last = 0.0, -1.0
        for step in range(300):
            window.send(set_property("/belt", "position", [float(step)]))
            window.send(set_property("/shape", "values", bytes([step % 256]) * 40_000))
            began = time.perf_counter()
            listener.server.show(window.changes())
            worst = max(worst, time.perf_counter() - began)
            await asyncio.sleep(0)
        while last < 299.0:
            commands = unpacked(await asyncio.wait_for(view.read_message(), 5.0))
            await view.write_message("drawn")
            for command in commands:
                if command["path"] == "/belt":
                    last = max(last, command["value"][0])
        stuck = max((one.outbox for one in listener.server.views), key=len)
        assert len(stuck) == 2  # one value for each property: the newest
        assert worst < 0.1
        frozen.close()

    with_listener(scene, window)


def test_frozen_panel_keeps_a_bounded_number_of_events() -> None:
    async def scene(listener: Listener) -> None:
        frozen = frozen_page(listener, "/panel")
        await until(lambda: len(listener.server.pages) == 1)
        (panel,) = listener.server.pages
        for number in range(7000):
            listener.server.publish({"kind": "event", "text": "x" * 4000, "number": number})
            listener.server.publish({"kind": "frame", "number": number}, key="frame")
            if number % 100 == 0:
                await asyncio.sleep(0)
        assert len(panel.outbox) == MOST_WAITING
        frozen.close()

    with_listener(scene)


def test_page_that_goes_away_is_forgotten() -> None:
    async def scene(listener: Listener) -> None:
        frozen = frozen_page(listener, "/socket")
        await until(lambda: len(listener.server.views) == 1)
        frozen.close()
        for _ in range(50):
            listener.server.show([("key", b"x" * 100000)])
            await asyncio.sleep(0.002)
        await until(lambda: not listener.server.views)

    with_listener(scene)


def test_reconnecting_many_times_leaves_nothing_behind() -> None:
    async def scene(listener: Listener) -> None:
        for _ in range(30):
            panel, view = await listener.connect("/panel"), await listener.connect("/socket")
            panel.close()
            view.close()
        await until(lambda: not listener.server.pages and not listener.server.views)

    with_listener(scene)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("post"), st.integers(0, 5), st.integers()),
            st.tuples(st.just("read"), st.just(0), st.just(0)),
        ),
        max_size=60,
    )
)
def test_slow_page_ends_with_the_last_value_of_every_key(steps: list[tuple[str, int, int]]) -> None:
    async def run() -> None:
        got: dict[int, int] = {}
        gate = asyncio.Semaphore(0)

        async def write(batch: list[tuple[int, int]]) -> None:
            await gate.acquire()
            got.update(batch)

        outbox = SendBuffer(write)
        truth: dict[int, int] = {}
        for kind, key, value in steps:
            if kind == "post":
                truth[key] = value
                outbox.post([(key, (key, value))])
            else:
                gate.release()
            await asyncio.sleep(0)
            assert len(outbox) <= 6
        for _ in range(len(steps) + 1):
            gate.release()
            await asyncio.sleep(0)
        assert got == truth

    asyncio.run(run())


def test_redrawn_object_is_complete_for_late_pages() -> None:
    from twin_gait.viewer import shapes
    from twin_gait.viewer.commands import Material

    window = CommandBuffer()
    window.send(set_property("/a", "visible", False))
    window.send(set_object("/a", shapes.ball(1.0), Material(colour=(1.0, 0.0, 0.0))))
    kinds = [command["type"] for command in window.commands()]
    assert kinds == ["set_object", "set_property"]


# ---------------------------------------------------------------------- the command


@pytest.mark.parametrize(
    ("words", "facts"),
    [
        (["nosuch"], ("nosuch",)),
        (["--port", "99999"], ("--port", "0", "65535", "99999")),
        (["--duration", "-1"], ("duration_s", "-1")),
        (["--duration", "nan"], ("duration_s", "nan")),
        (["--set", "patient.mass_kg=x"], ("patient.mass_kg", "x")),
        (["--out", "taken"], ("taken", "--out")),
    ],
)
def test_wrong_arguments_end_in_one_line_and_leave_nothing(
    words: list[str], facts: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    (tmp_path / "taken").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TWIN_GAIT_SESSIONS", str(tmp_path / "sessions.db"))
    assert main(["live", *words, "--no-browser"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1 and states(captured.err, *facts)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["taken"]


def test_everything_that_a_live_session_writes_is_for_its_user_alone(tmp_path: Path) -> None:
    database = tmp_path / "sessions.db"
    folder = tmp_path / "run"
    command = [sys.executable, "-m", "twin_gait", "live", "bench_leg", "--duration", "0.5", "--port", "0",
               "--no-browser", "--out", str(folder)]  # fmt: skip
    environment = os.environ | {"TWIN_GAIT_SESSIONS": str(database)}
    subprocess.run(command, check=True, capture_output=True, umask=0o022, env=environment)
    written = [database, folder, *folder.rglob("*")]
    assert {"log.parquet", "animation.html", "figures"} <= {path.name for path in written}
    open_to_others = [path.name for path in written if path.stat().st_mode & 0o077]
    assert not open_to_others


def test_other_files_have_the_mode_that_the_user_has_set(tmp_path: Path) -> None:
    for mask, expected in ((0o022, 0o644), (0o077, 0o600), (0o027, 0o640)):
        before = os.umask(mask)
        try:
            write_atomically(tmp_path / "file", "content")
        finally:
            os.umask(before)
        assert (tmp_path / "file").stat().st_mode & 0o777 == expected
