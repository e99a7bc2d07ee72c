"""Web server of a page and its scene on the loopback interface, which requires the token of this start.

Tornado implements the protocols. ``/`` is the page, complete with meshcat's viewer, and ``/socket`` sends the
scene to it as commands of that viewer. The checks of host and origin protect against other sites. The token
protects against other users of this machine, who can reach the port and send any header.
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
PORTS_TRIED = 100  # number of ports that are tried, from the first one on
BACKLOG = 1024  # connections waiting to be accepted; with fewer, a burst delays the next one by a second
MOST_CONNECTIONS = 256  # largest number of connections; a page uses three
# Timeout in [s] for the first request with the token; a connection that has sent it has no time limit.
FIRST_REQUEST = 2.0
MOST_WAITING = 4096  # largest number of items that wait for one page; the oldest ones beyond it are dropped
LOOPBACK_NAMES = frozenset({LOOPBACK, "localhost"})
# A longer message is not read: the socket is closed with status 1009. The functions that check messages may
# set a lower limit and reply.
LONGEST_MESSAGE = 65536  # [B]
REQUEST_TIMEOUT = 10.0  # [s], timeout for the headers of a request, for its body, and for the next request
_LONGEST_HEADER = 16384  # [B]
_HEADERS = {
    "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "X-Frame-Options": "DENY",
    "Content-Security-Policy": "frame-ancestors 'none'", "Referrer-Policy": "no-referrer",
}  # fmt: skip
_CLOSE_TIMEOUT = 0.05  # [s], time for a page to acknowledge the close message


def is_loopback(host: str) -> bool:
    """Return whether the ``Host`` of a request is a name of this machine.

    Another site can let its own name resolve to this machine, and its page then has the same origin; only the
    name in the request differs.
    """
    name, _ = split_host_and_port(host.lower())
    return name in LOOPBACK_NAMES


def is_own_page(origin: str | None, host: str) -> bool:
    """Return whether a request comes from a page of this server.

    ``origin``: the ``Origin`` header, or None without one (every browser sends it when it opens a web
    socket); ``host``: the ``Host`` header.
    """
    return origin is not None and is_loopback(host) and origin.lower() == f"http://{host.lower()}"


class GuardedHandler(RequestHandler):  # type: ignore[misc]  # no type information in tornado
    """Handler of requests that have a name of this machine and the token; it rejects others with a reason."""

    needs_origin = False  # whether a request without an origin is rejected

    def initialize(self, server: Any) -> None:
        """Store the server."""
        self.server = server

    def prepare(self) -> None:
        """Check that a request is from this site and this user; raise HTTPError with status 403 if not."""
        origin, host = self.request.headers.get("Origin"), self.request.host
        if not is_loopback(host):
            raise HTTPError(403, reason="wrong host: use 127.0.0.1 or localhost in the address")
        if (origin or self.needs_origin) and not is_own_page(origin, host):
            raise HTTPError(403, reason="wrong origin: only pages of this server may send requests to it")
        if not self.server.is_valid_token(self.request.query_arguments.get("token", [b""])[-1]):
            raise HTTPError(403, reason="wrong token: open the address that the program has printed")
        self.server.admit(self.request.connection)

    def set_default_headers(self) -> None:
        """Set the headers that prevent caching and embedding in other pages."""
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        """Log internal errors; rejected requests are not logged."""
        if not isinstance(error, HTTPError):
            super().log_exception(kind, error, trace)


class NotFoundHandler(GuardedHandler):
    """Handler of all unknown paths."""

    def get(self) -> None:
        """Raise HTTPError with status 404."""
        raise HTTPError(404)


class SendBuffer:
    """Send buffer of one page, which sends one batch at a time.

    While a batch is being sent, new items wait under their keys, and a newer item replaces an older one of
    the same key. A page that has stopped reading therefore needs bounded memory and no computing time.
    """

    def __init__(self, write: Callable[[list[Any]], Awaitable[None]]) -> None:
        """Create an empty buffer.

        ``write``: coroutine function that writes one batch and ends when the network has accepted it.
        """
        self._write = write
        self._waiting: dict[Hashable, Any] = {}
        self._sending: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        """Return the number of waiting items."""
        return len(self._waiting)

    def post(self, items: Iterable[tuple[Hashable, Any]]) -> None:
        """Send items as soon as the page accepts them; must be called inside an event loop."""
        for key, item in items:
            self._waiting.pop(key, None)  # so that the newer item is the last one
            self._waiting[key] = item
        while len(self._waiting) > MOST_WAITING:
            del self._waiting[next(iter(self._waiting))]
        if self._sending is None or self._sending.done():
            self._sending = asyncio.get_running_loop().create_task(self._send())

    async def ended(self) -> None:
        """Wait until no batch is being sent."""
        if self._sending is not None:
            await self._sending

    async def _send(self) -> None:
        while self._waiting:
            batch, self._waiting = list(self._waiting.values()), {}
            await self._write(batch)


class GuardedSocket(GuardedHandler, WebSocketHandler):  # type: ignore[misc]  # no type information in tornado
    """Web socket of an own page; its subclasses define ``write_batch``, which sends the waiting items."""

    needs_origin = True

    def open(self) -> None:
        """Register the socket with the server."""
        self.set_nodelay(True)
        self.outbox = SendBuffer(self.write_batch)
        self.server.sockets.add(self)

    def on_close(self) -> None:
        """Remove the socket from the server."""
        self.server.sockets.discard(self)

    async def close_immediately(self) -> None:
        """Close without waiting for the page."""
        if self.ws_connection is not None:
            self.ws_connection.stream.close()
        await self.outbox.ended()

    async def try_write(self, content: str | bytes) -> bool:
        """Write to the page, and return whether it is still open; a closed page is not an error."""
        try:
            await self.write_message(content, binary=isinstance(content, bytes))
        except (WebSocketClosedError, StreamClosedError):
            self.close()
            return False
        return True


class LimitedServer(HTTPServer):  # type: ignore[misc]  # no type information in tornado
    """HTTP server with a limited number of connections, of which half are reserved for those with the token.

    Connections use at most half of the file descriptors of the process. A connection that has not sent the
    token is closed after ``FIRST_REQUEST``, or earlier, the oldest first, if a new one would exceed their
    half. Idle connections therefore cannot prevent a new one. There is no limit per address, because a
    program on this machine can connect from any address of 127.0.0.0/8.
    """

    admitted: Sequence[IOStream] = ()  # connections that have sent the token
    unknown: Sequence[IOStream] = ()  # other connections, the oldest first

    def handle_stream(self, stream: IOStream, address: Any) -> None:
        """Accept a connection, unless too many connections have sent the token."""
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
        """Mark a connection as one that has sent the token."""
        if stream in self.unknown:
            self.unknown = [other for other in self.unknown if other is not stream]
            self.admitted = [*self.admitted, stream]

    def _close_unknown(self, stream: IOStream) -> None:
        if stream in self.unknown:
            stream.close()


def bind_loopback(first_port: int) -> socket.socket:
    """Open a listening socket on the loopback interface.

    ``first_port``: if it is in use, the next ones are tried; 0 lets the system choose. Raises ViewerError if
    no port is free.
    """
    tried = [0] if first_port == 0 else range(first_port, min(first_port + PORTS_TRIED, 65536))
    for port in tried:
        with contextlib.suppress(OSError):
            return socket.create_server((LOOPBACK, port), backlog=BACKLOG)
    reason = f"no free port from {first_port} to {tried[-1]}"
    raise ViewerError(f"the page cannot be served: there is {reason}; give another --port")


class SceneServer:
    """Server of a page and its scene; it must be created and called inside of one event loop."""

    def __init__(self, page: str, *, first_port: int) -> None:
        """Start to listen; ``first_port`` and errors as in :func:`bind_loopback`."""
        self.page = page
        self.sockets: set[GuardedSocket] = set()  # open sockets
        self._token = secrets.token_hex(24)  # token of this start
        listener = bind_loopback(first_port)
        listener.setblocking(False)
        self.port = int(listener.getsockname()[1])
        self.url = f"http://{LOOPBACK}:{self.port}/?token={self._token}"
        owner = {"server": self}
        application = Application(
            [(path, handler, owner) for path, handler in self.routes()],
            default_handler_class=NotFoundHandler, default_handler_args=owner,
            websocket_max_message_size=LONGEST_MESSAGE, log_function=lambda handler: None,
        )  # fmt: skip
        self._http = LimitedServer(
            application, max_body_size=LONGEST_MESSAGE, max_header_size=_LONGEST_HEADER,
            idle_connection_timeout=REQUEST_TIMEOUT, body_timeout=REQUEST_TIMEOUT,
        )  # fmt: skip
        self._http.add_socket(listener)

    def scene(self) -> Iterable[Change]:
        """Return the encoded commands for a newly opened page; empty for a page that contains its scene."""
        return ()

    @property
    def views(self) -> list[SceneSocket]:
        """Sockets of the open scenes."""
        return [one for one in self.sockets if isinstance(one, SceneSocket)]

    def show(self, changes: Iterable[Change]) -> None:
        """Send changes of the scene to all pages."""
        changes = list(changes)
        for view in self.views:
            view.outbox.post(changes)

    def is_valid_token(self, token: bytes) -> bool:
        """Return whether a token is that of this start; the time of the comparison does not depend on it."""
        return hmac.compare_digest(token, self._token.encode())

    def admit(self, connection: Any) -> None:
        """Mark the connection of a request as one that has sent the token."""
        self._http.admit(connection.stream)

    async def close(self) -> None:
        """Stop listening and close all sockets, also those of pages that do not respond."""
        self._http.stop()
        open_pages = list(self.sockets)
        for page in open_pages:
            page.close(1001, "the program has ended")
        await asyncio.sleep(_CLOSE_TIMEOUT if open_pages else 0.0)
        for page in open_pages:
            await page.close_immediately()
        await self._http.close_all_connections()

    def routes(self) -> list[tuple[str, type[RequestHandler]]]:
        """Return the paths and their handlers."""
        return [(r"/", PageHandler), (r"/socket", SceneSocket)]


class PageHandler(GuardedHandler):
    """Handler of the page."""

    def get(self) -> None:
        """Send the page."""
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.write(self.server.page)


class SceneSocket(GuardedSocket):
    """Web socket that sends the scene to a page.

    The page acknowledges each batch after it has drawn it; then the next batch is sent. Otherwise the network
    would buffer seconds of frames for a page that draws slowly.
    """

    def open(self) -> None:
        """Send the whole scene."""
        super().open()
        self._drawn = asyncio.Event()
        self.outbox.post(self.server.scene())

    def on_message(self, message: str | bytes) -> None:
        """Store that the page has drawn the batch; every message is this acknowledgement."""
        self._drawn.set()

    def on_close(self) -> None:
        """Remove the socket, and end the wait for the page."""
        super().on_close()
        self._drawn.set()

    async def write_batch(self, batch: list[bytes]) -> None:
        """Write a batch, and wait until it is drawn."""
        self._drawn.clear()
        if await self.try_write(b"".join(batch)):
            await self._drawn.wait()
