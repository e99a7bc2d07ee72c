"""Web server of a page and of its scene: on the loopback interface, for whoever has the token of this start.

The protocol work is tornado's. ``/`` is the page, complete with meshcat's viewer, and ``/socket`` brings the
scene to it in the commands of that viewer. The name of the machine and the origin keep other sites out; the
token keeps out the other users of this machine, who reach the port and can write any header.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import secrets
import socket
from collections.abc import Awaitable, Callable, Hashable, Iterable, Sequence
from resource import RLIM_INFINITY, RLIMIT_NOFILE, getrlimit
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.httputil import split_host_and_port
from tornado.iostream import IOStream, StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from twin_gait.exceptions import ViewerError

Change = tuple[Hashable, bytes]
LOOPBACK = "127.0.0.1"
PORTS_TRIED = 100
BACKLOG = 1024  # connections that wait to be accepted; with fewer a burst delays the next one by a second
MOST_CONNECTIONS = 256  # a page has three
# [s] in which a connection shows the token in a request; a page that was opened stays as long as it likes
FIRST_REQUEST = 2.0
MOST_WAITING = 4096  # items for one page; beyond it the oldest give way
LOOPBACK_NAMES = frozenset({LOOPBACK, "localhost"})
# What is longer is not read at all: the socket is closed with status 1009. Who checks the messages may set
# a lower limit and answer.
LONGEST_MESSAGE = 65536  # [B]
PATIENCE = 10.0  # [s] for the headers of a request, for its body, and for the next request
_LONGEST_HEADER = 16384  # [B]
_HEADERS = {
    "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "X-Frame-Options": "DENY",
    "Content-Security-Policy": "frame-ancestors 'none'", "Referrer-Policy": "no-referrer",
}  # fmt: skip
_FAREWELL = 0.05  # [s] in which a page may answer that it has heard of the end


def is_loopback(host: str) -> bool:
    """Whether the ``Host`` of a request is a name of this machine.

    Another site can point its own name at this machine, and its page then counts as of the same origin; only
    the name tells.
    """
    name, _ = split_host_and_port(host.lower())
    return name in LOOPBACK_NAMES


def is_own_page(origin: str | None, host: str) -> bool:
    """Whether a request comes from a page of this very server.

    ``origin``: the ``Origin`` header; None if there is none, which no browser leaves out here; ``host``: the
    ``Host`` header.
    """
    return origin is not None and is_loopback(host) and origin.lower() == f"http://{host.lower()}"


class Guarded(RequestHandler):  # type: ignore[misc]  # no type information in tornado
    """Answers only requests that name this machine and have the token; says why not."""

    needs_origin = False  # of its own page; without it also what does not say where it comes from is answered

    def initialize(self, server: Any) -> None:
        """Remember the server."""
        self.server = server

    def prepare(self) -> None:
        """Refuse what comes from another site or another user. Raises HTTPError: with status 403."""
        origin, host = self.request.headers.get("Origin"), self.request.host
        if not is_loopback(host):
            raise HTTPError(403, reason="this server answers under the names of this machine only")
        if (origin or self.needs_origin) and not is_own_page(origin, host):
            raise HTTPError(403, reason="this server answers its own pages only")
        if not self.server.knows(self.request.query_arguments.get("token", [b""])[-1]):
            raise HTTPError(403, reason="open the address that was printed: it holds the token of this start")
        self.server.admit(self.request.connection)

    def set_default_headers(self) -> None:
        """Keep the page out of other pages and out of caches."""
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        """Keep what others send wrongly out of the terminal; our own mistakes are logged."""
        if not isinstance(error, HTTPError):
            super().log_exception(kind, error, trace)


class NothingHandler(Guarded):
    """Everything that is not here."""

    def get(self) -> None:
        """Say so. Raises HTTPError: with status 404."""
        raise HTTPError(404)


class Outbox:
    """Sends to one page, one batch at a time.

    While a batch is on its way, what comes is kept under its key, and a newer item takes the place of an
    older one of the same key. A page that has stopped reading therefore costs a bounded memory and no time.
    """

    def __init__(self, write: Callable[[list[Any]], Awaitable[None]]) -> None:
        """Start empty.

        ``write``: writes one batch; what it returns ends when the network has taken the batch.
        """
        self._write = write
        self._waiting: dict[Hashable, Any] = {}
        self._sending: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        """How many items wait."""
        return len(self._waiting)

    def post(self, items: Iterable[tuple[Hashable, Any]]) -> None:
        """Send items as soon as the page takes them; returns at once, inside of an event loop."""
        for key, item in items:
            self._waiting.pop(key, None)  # a newer one comes last
            self._waiting[key] = item
        while len(self._waiting) > MOST_WAITING:
            del self._waiting[next(iter(self._waiting))]
        if self._sending is None or self._sending.done():
            self._sending = asyncio.get_running_loop().create_task(self._send())

    async def ended(self) -> None:
        """Wait until nothing is on its way."""
        if self._sending is not None:
            await self._sending

    async def _send(self) -> None:
        while self._waiting:
            batch, self._waiting = list(self._waiting.values()), {}
            await self._write(batch)


class GuardedSocket(Guarded, WebSocketHandler):  # type: ignore[misc]  # no type information in tornado
    """A web socket of our own page; ``write_batch`` of its kinds writes what has waited."""

    needs_origin = True

    def open(self) -> None:
        """Be known to the server."""
        self.set_nodelay(True)
        self.outbox = Outbox(self.write_batch)
        self.server.sockets.add(self)

    def on_close(self) -> None:
        """Be forgotten."""
        self.server.sockets.discard(self)

    async def abandon(self) -> None:
        """Close without waiting for the page."""
        if self.ws_connection is not None:
            self.ws_connection.stream.close()
        await self.outbox.ended()

    async def write_or_leave(self, content: str | bytes) -> bool:
        """Write to the page; one that has gone is no error. Returns whether the page is still there."""
        try:
            await self.write_message(content, binary=isinstance(content, bytes))
        except (WebSocketClosedError, StreamClosedError):
            self.close()
            return False
        return True


class CappedServer(HTTPServer):  # type: ignore[misc]  # no type information in tornado
    """HTTP server with a limited number of connections, half of which are reserved for the token.

    Connections use at most half of the files of the process. Those that have not shown the token are closed
    after ``FIRST_REQUEST``, or earlier, the oldest first, where a new one would exceed their half: a new
    connection is always accepted, so that idle ones keep nobody out. There is no limit per address, since a
    program of this machine connects from any address of 127.0.0.0/8.
    """

    admitted: Sequence[IOStream] = ()  # connections that have shown the token
    unknown: Sequence[IOStream] = ()  # other ones, the oldest first

    def handle_stream(self, stream: IOStream, address: Any) -> None:
        """Accept a connection if the token has not been shown on too many."""
        files, _ = getrlimit(RLIMIT_NOFILE)
        most = MOST_CONNECTIONS if files == RLIM_INFINITY else min(MOST_CONNECTIONS, files // 2)
        self.admitted, self.unknown = (
            [other for other in streams if not other.closed()] for streams in (self.admitted, self.unknown)
        )
        if len(self.admitted) >= most:
            stream.close()
            return
        too_many = len(self.unknown) + 1 - min(most // 2, most - len(self.admitted))
        for oldest in self.unknown[: max(too_many, 0)]:
            oldest.close()
        self.unknown = [*self.unknown, stream]
        asyncio.get_running_loop().call_later(FIRST_REQUEST, self._close_unknown, stream)
        super().handle_stream(stream, address)

    def admit(self, stream: IOStream) -> None:
        """Note that a connection has shown the token."""
        if stream in self.unknown:
            self.unknown = [other for other in self.unknown if other is not stream]
            self.admitted = [*self.admitted, stream]

    def _close_unknown(self, stream: IOStream) -> None:
        if stream in self.unknown:
            stream.close()


def bind_loopback(first_port: int) -> socket.socket:
    """Listen on the loopback interface.

    ``first_port``: if it is taken the next one is tried; 0 lets the system choose. Raises ViewerError if no
    port is free.
    """
    tried = [0] if first_port == 0 else range(first_port, min(first_port + PORTS_TRIED, 65536))
    for port in tried:
        with contextlib.suppress(OSError):
            return socket.create_server((LOOPBACK, port), backlog=BACKLOG)
    reason = f"no free port from {first_port} to {tried[-1]}"
    raise ViewerError(f"the page cannot be served: {reason}; give another --port")


class SceneServer:
    """Serves a page and its scene; belongs to one event loop: make it, and call it, inside of it."""

    def __init__(self, page: str, *, first_port: int) -> None:
        """Listen. ``first_port`` as in :func:`bind_loopback`, with its errors."""
        self.page = page
        self.sockets: set[GuardedSocket] = set()  # open ones
        self._token = secrets.token_hex(24)  # of this start
        listener = bind_loopback(first_port)
        listener.setblocking(False)
        self.port = int(listener.getsockname()[1])
        self.url = f"http://{LOOPBACK}:{self.port}/?token={self._token}"
        owner = {"server": self}
        application = Application(
            [(path, handler, owner) for path, handler in self.routes()],
            default_handler_class=NothingHandler, default_handler_args=owner,
            websocket_max_message_size=LONGEST_MESSAGE, log_function=lambda handler: None,
        )  # fmt: skip
        self._http = CappedServer(
            application, max_body_size=LONGEST_MESSAGE, max_header_size=_LONGEST_HEADER,
            idle_connection_timeout=PATIENCE, body_timeout=PATIENCE,
        )  # fmt: skip
        self._http.add_socket(listener)

    def scene(self) -> Iterable[Change]:
        """Packed commands for a scene that has just been opened; a page that holds its own needs none."""
        return ()

    @property
    def views(self) -> list[SceneSocket]:
        """Open scenes."""
        return [one for one in self.sockets if isinstance(one, SceneSocket)]

    def show(self, changes: Iterable[Change]) -> None:
        """Bring changes of the scene to all pages."""
        changes = list(changes)
        for view in self.views:
            view.outbox.post(changes)

    def knows(self, token: bytes) -> bool:
        """Whether a token is that of this start; how long it takes tells nothing of it."""
        return hmac.compare_digest(token, self._token.encode())

    def admit(self, connection: Any) -> None:
        """Note that a request of a connection has shown the token."""
        self._http.admit(connection.stream)

    async def close(self) -> None:
        """Stop listening and close all sockets, those of frozen pages too."""
        self._http.stop()
        open_pages = list(self.sockets)
        for page in open_pages:
            page.close(1001, "the program has ended")
        await asyncio.sleep(_FAREWELL if open_pages else 0.0)
        for page in open_pages:
            await page.abandon()
        await self._http.close_all_connections()

    def routes(self) -> list[tuple[str, type[RequestHandler]]]:
        """Paths and who answers them."""
        return [(r"/", PageHandler), (r"/socket", SceneSocket)]


class PageHandler(Guarded):
    """The page."""

    def get(self) -> None:
        """Answer with the page."""
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.write(self.server.page)


class SceneSocket(GuardedSocket):
    """Brings the scene to a page.

    The page says when it has drawn what came; until then it gets nothing more. The network alone would keep
    seconds of frames for a page that draws slowly.
    """

    def open(self) -> None:
        """Send the whole scene."""
        super().open()
        self._drawn = asyncio.Event()
        self.outbox.post(self.server.scene())

    def on_message(self, message: str | bytes) -> None:
        """Take it that the page has drawn what came, whatever it says."""
        self._drawn.set()

    def on_close(self) -> None:
        """Forget the page."""
        super().on_close()
        self._drawn.set()

    async def write_batch(self, batch: list[bytes]) -> None:
        """Write, and wait until it is drawn."""
        self._drawn.clear()
        if await self.write_or_leave(b"".join(batch)):
            await self._drawn.wait()
