"""Who may talk to the server of a page, and how much.

The name of the machine and the origin keep other sites out. The token keeps out the other users of this
machine: they reach the port and can write any header.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from tornado.iostream import StreamClosedError
from tornado.web import HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from twin_gait.viewer.live.window import Outbox
from twin_gait.viewer.loopback import LOOPBACK

LOOPBACK_NAMES = frozenset({LOOPBACK, "localhost"})
# What is longer is not read at all: the socket is closed with status 1009. Who checks the messages may set
# a lower limit and answer.
LONGEST_MESSAGE = 65536  # [B]
MOST_SOCKETS = 64
MESSAGES_PER_SECOND = 200.0
_BURST = 400.0


def is_loopback(host: str) -> bool:
    """Whether the ``Host`` of a request is a name of this machine.

    Another site can point its own name at this machine, and its page then counts as of the same origin; only
    the name tells.
    """
    try:
        return urlsplit(f"//{host}").hostname in LOOPBACK_NAMES
    except ValueError:
        return False


def is_own_page(origin: str | None, host: str) -> bool:
    """Whether a request comes from a page of this very server.

    ``origin``: the ``Origin`` header; None if there is none, which no browser leaves out here; ``host``: the
    ``Host`` header.
    """
    return origin is not None and is_loopback(host) and origin.lower() == f"http://{host.lower()}"


class Allowance:
    """How much a page may still say: so many messages a second, with a reserve for bursts."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start with the whole reserve. ``clock``: time in [s]."""
        self._clock = clock
        self._left = _BURST
        self._since = clock()

    def take(self) -> bool:
        """Take one message off; False if there is none left."""
        now = self._clock()
        self._left = min(_BURST, self._left + MESSAGES_PER_SECOND * (now - self._since))
        self._since = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Guarded(RequestHandler):  # type: ignore[misc]  # no type information in tornado
    """Answers only requests that name this machine and have the token; says in one line why not."""

    def initialize(self, server: Any) -> None:
        """Remember the server."""
        self.server = server

    def prepare(self) -> None:
        """Refuse what comes from another site or another user."""
        origin = self.request.headers.get("Origin")
        if not is_loopback(self.request.host):
            self.refuse("this server answers under the names of this machine only")
        if origin is not None and not is_own_page(origin, self.request.host):
            self.refuse("this server answers its own pages only")
        if not self.server.knows(self.request.query_arguments.get("token", [b""])[-1]):
            self.refuse("open the address that the program has printed: it holds the token of this start")

    def refuse(self, reason: str) -> None:
        """Answer with status 403. Raises HTTPError: Always."""
        self.server.refused += 1
        raise HTTPError(403, reason)

    def require_own_page(self) -> None:
        """Refuse what does not say that it comes from our own page."""
        if not is_own_page(self.request.headers.get("Origin"), self.request.host):
            self.refuse("this server answers its own pages only")

    def set_default_headers(self) -> None:
        """Keep the page out of other pages and out of caches."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("X-Frame-Options", "DENY")
        self.set_header("Content-Security-Policy", "frame-ancestors 'none'")
        self.set_header("Referrer-Policy", "no-referrer")

    def write_error(self, status_code: int, **details: Any) -> None:
        """Answer with the reason as plain text. ``details``: the exception, as ``exc_info``."""
        error = details.get("exc_info", (None, None, None))[1]
        reason = getattr(error, "log_message", None) or self._reason
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{reason}\n")

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        """Keep what others send wrongly out of the terminal; our own mistakes are logged."""
        if not isinstance(error, HTTPError):
            super().log_exception(kind, error, trace)


class NothingHandler(Guarded):
    """Everything that is not here."""

    def prepare(self) -> None:
        """Answer with status 404, or 403 as everywhere. Raises HTTPError: Always."""
        super().prepare()
        raise HTTPError(404, "there is nothing here")


class GuardedSocket(Guarded, WebSocketHandler):  # type: ignore[misc]  # no type information in tornado
    """A web socket of our own page."""

    outbox: Outbox[Any]

    def prepare(self) -> None:
        """Refuse what is not our own page, and more pages than anybody has."""
        super().prepare()
        self.require_own_page()
        if len(self.server.sockets()) >= MOST_SOCKETS:
            self.server.refused += 1
            raise HTTPError(503, "too many pages are open; close one")

    def check_origin(self, origin: str) -> bool:
        """Whether a page of this origin may open the socket."""
        return is_own_page(origin, self.request.host)

    async def abandon(self) -> None:
        """Close without waiting for the page."""
        if self.ws_connection is not None:
            self.ws_connection.stream.close()
        await self.outbox.ended()

    async def write_or_leave(self, content: str | bytes, *, binary: bool) -> bool:
        """Write to the page; one that has gone is no error. Returns whether the page is still there."""
        try:
            await self.write_message(content, binary=binary)
        except (WebSocketClosedError, StreamClosedError):
            self.close()
            return False
        return True
