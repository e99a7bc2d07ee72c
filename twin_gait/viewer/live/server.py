"""Web server of the live page: on the loopback interface, for any number of pages, refusing all others.

The protocol work is tornado's. A page has two web sockets: ``/socket`` brings the scene to it, in the
commands of meshcat's viewer, and ``/panel`` carries JSON both ways. What a page says is handed on as it came;
who receives it judges it.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.iostream import StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from twin_gait.exceptions import ViewerError
from twin_gait.viewer.live.guards import LONGEST_MESSAGE, Allowance, is_loopback, is_own_page
from twin_gait.viewer.live.outbox import Outbox
from twin_gait.viewer.live.window import Change
from twin_gait.viewer.loopback import LOOPBACK, bind_loopback
from twin_gait.viewer.page import viewer_folder

MOST_SOCKETS = 64
_LONGEST_HEADER = 16384  # [B]
_FAREWELL = 0.05  # [s] in which a page may answer that it has heard of the end

Message = Mapping[str, Any]


class LiveServer:
    """Serves the live page.

    It belongs to one event loop: make it, and call it, inside of it.

    Attributes:
        url: Address of the page.
        pages: Open panels.
        views: Open scenes.
        refused: How many requests and messages were refused here.
    """

    def __init__(
        self,
        page: str,
        *,
        first_port: int,
        on_message: Callable[[Panel, str], None],
        on_stop: Callable[[], None],
        refusal: Callable[[str], Message],
        greeting: Callable[[], Iterable[Message]],
        scene: Callable[[], Iterable[Change]],
    ) -> None:
        """Listen.

        Args:
            page: HTML of the page.
            first_port: If it is taken the next one is tried; 0 lets the system choose.
            on_message: Called with what a page says, which may be any text.
            on_stop: Called when a page asks to stop without its socket.
            refusal: Makes the answer to what is refused here, of the reason.
            greeting: Messages for a panel that has just been opened.
            scene: Packed commands for a scene that has just been opened.

        Raises:
            ViewerError: If no port is free.
        """
        self.page, self.greeting, self.scene = page, greeting, scene
        self.on_message, self.on_stop, self.refusal = on_message, on_stop, refusal
        self.pages: set[Panel] = set()
        self.views: set[SceneSocket] = set()
        self.refused = 0
        try:
            listener = bind_loopback(first_port)
        except OSError as error:
            raise ViewerError(f"the live page cannot be served: {error}; give another --port") from error
        self.port = int(listener.getsockname()[1])
        self.url = f"http://{LOOPBACK}:{self.port}/"
        self._http = HTTPServer(
            self._application(), max_body_size=LONGEST_MESSAGE, max_header_size=_LONGEST_HEADER
        )
        self._http.add_socket(listener)

    def show(self, changes: Iterable[Change]) -> None:
        """Bring changes of the scene to all pages.

        Args:
            changes: Key and packed command each.
        """
        changes = list(changes)
        for view in self.views:
            view.post(changes)

    def tell(self, message: Message, *, key: Hashable | None = None) -> None:
        """Tell all panels something.

        Args:
            message: Anything that JSON can hold.
            key: A later message of the same key makes this one needless; None keeps every one.
        """
        text = json.dumps(message, allow_nan=False)
        for panel in self.pages:
            panel.post_text(text, key)

    def has_room(self) -> bool:
        """Whether one more socket may be opened."""
        return len(self.pages) + len(self.views) < MOST_SOCKETS

    async def close(self) -> None:
        """Stop listening and close all sockets, those of frozen pages too."""
        self._http.stop()
        open_pages = [*self.pages, *self.views]
        for page in open_pages:
            page.close(1001, "the program has ended")
        await asyncio.sleep(_FAREWELL if open_pages else 0.0)
        for page in open_pages:
            await page.abandon()
        await self._http.close_all_connections()

    def _application(self) -> Application:
        owner = {"server": self}
        return Application(
            [
                (r"/", PageHandler, owner),
                (r"/static/main\.min\.js", BundleHandler, owner),
                (r"/stop", StopHandler, owner),
                (r"/socket", SceneSocket, owner),
                (r"/panel", Panel, owner),
            ],
            default_handler_class=NothingHandler,
            default_handler_args=owner,
            websocket_max_message_size=LONGEST_MESSAGE,
            log_function=lambda handler: None,
        )


class _Guarded(RequestHandler):  # type: ignore[misc]  # no type information in tornado
    """Answers only requests that name this machine; says in one line why not."""

    def initialize(self, server: LiveServer) -> None:
        """Remember the server.

        Args:
            server: The server.
        """
        self.server = server

    def prepare(self) -> None:
        """Refuse other hosts, and anything that another site's page sends."""
        origin = self.request.headers.get("Origin")
        if not is_loopback(self.request.host):
            self.refuse("this server answers under the names of this machine only")
        if origin is not None and not is_own_page(origin, self.request.host):
            self.refuse("this server answers its own pages only")

    def refuse(self, reason: str) -> None:
        """Answer with status 403.

        Args:
            reason: One line.

        Raises:
            HTTPError: Always.
        """
        self.server.refused += 1
        raise HTTPError(403, reason)

    def set_default_headers(self) -> None:
        """Keep the page out of other pages and out of caches."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("X-Frame-Options", "DENY")
        self.set_header("Content-Security-Policy", "frame-ancestors 'none'")
        self.set_header("Referrer-Policy", "no-referrer")

    def write_error(self, status_code: int, **details: Any) -> None:
        """Answer with the reason as plain text.

        Args:
            status_code: Of the answer.
            details: The exception, as ``exc_info``.
        """
        error = details.get("exc_info", (None, None, None))[1]
        reason = getattr(error, "log_message", None) or self._reason
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{reason}\n")

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        """Keep what others send wrongly out of the terminal; our own mistakes are logged.

        Args:
            kind: Class of the exception.
            error: The exception.
            trace: Its trace.
        """
        if not isinstance(error, HTTPError):
            super().log_exception(kind, error, trace)


class PageHandler(_Guarded):
    """The page."""

    def get(self) -> None:
        """Answer with the page."""
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.write(self.server.page)


class BundleHandler(_Guarded):
    """Meshcat's script."""

    def get(self) -> None:
        """Answer with the script."""
        self.set_header("Content-Type", "text/javascript; charset=utf-8")
        self.write((viewer_folder() / "dist" / "main.min.js").read_bytes())


class NothingHandler(_Guarded):
    """Everything that is not here."""

    def prepare(self) -> None:
        """Answer with status 404, or 403 as everywhere.

        Raises:
            HTTPError: Always.
        """
        super().prepare()
        raise HTTPError(404, "there is nothing here")


class StopHandler(_Guarded):
    """The way to stop when the socket of a page is not open."""

    def post(self) -> None:
        """Stop."""
        if not is_own_page(self.request.headers.get("Origin"), self.request.host):
            self.refuse("this server answers its own pages only")
        self.server.on_stop()
        self.write("stopped\n")


class _Socket(_Guarded, WebSocketHandler):  # type: ignore[misc]  # no type information in tornado
    """A web socket of our own page."""

    outbox: Outbox[Any]

    def prepare(self) -> None:
        """Refuse what is not our own page, and more pages than anybody has."""
        super().prepare()
        if not is_own_page(self.request.headers.get("Origin"), self.request.host):
            self.refuse("this server answers its own pages only")
        if not self.server.has_room():
            self.server.refused += 1
            raise HTTPError(503, "too many pages are open; close one")

    def check_origin(self, origin: str) -> bool:
        """Whether a page of this origin may open the socket.

        Args:
            origin: The header.
        """
        return is_own_page(origin, self.request.host)

    async def abandon(self) -> None:
        """Close without waiting for the page."""
        if self.ws_connection is not None:
            self.ws_connection.stream.close()
        await self.outbox.ended()

    async def write_or_leave(self, content: str | bytes, *, binary: bool) -> bool:
        """Write to the page; one that has gone is no error.

        Args:
            content: The message.
            binary: Whether it is bytes.

        Returns:
            Whether the page is still there.
        """
        try:
            await self.write_message(content, binary=binary)
        except (WebSocketClosedError, StreamClosedError):
            self.close()
            return False
        return True


class SceneSocket(_Socket):
    """Brings the scene to a page.

    The page says when it has drawn what came; until then it gets nothing more. The network alone would keep
    seconds of frames for a page that draws slowly.
    """

    def open(self) -> None:
        """Send the whole scene."""
        self.set_nodelay(True)
        self._drawn = asyncio.Event()
        self.outbox = Outbox(self._write)
        self.server.views.add(self)
        self.post(self.server.scene())

    def post(self, changes: Iterable[Change]) -> None:
        """Send changes as soon as the page takes them.

        Args:
            changes: Key and packed command each.
        """
        self.outbox.post(changes)

    def on_message(self, message: str | bytes) -> None:
        """Take it that the page has drawn what came, whatever it says.

        Args:
            message: What the page says.
        """
        self._drawn.set()

    def on_close(self) -> None:
        """Forget the page."""
        self.server.views.discard(self)
        self._drawn.set()

    async def _write(self, batch: list[bytes]) -> None:
        self._drawn.clear()
        if await self.write_or_leave(b"".join(batch), binary=True):
            await self._drawn.wait()


class Panel(_Socket):
    """Talks with the panel of a page."""

    def open(self) -> None:
        """Send what the panel has to know."""
        self.set_nodelay(True)
        self.outbox = Outbox(self._write)
        self._allowance = Allowance()
        self._count = 0
        self.server.pages.add(self)
        for message in self.server.greeting():
            self.tell(message)

    def tell(self, message: Message, *, key: Hashable | None = None) -> None:
        """Tell this panel something.

        Args:
            message: Anything that JSON can hold.
            key: A later message of the same key makes this one needless; None keeps every one.
        """
        self.post_text(json.dumps(message, allow_nan=False), key)

    def post_text(self, text: str, key: Hashable | None) -> None:
        """Send a message as soon as the page takes it.

        Args:
            text: JSON.
            key: See :meth:`tell`.
        """
        self._count += 1
        self.outbox.post([(self._count if key is None else ("last", key), text)])

    def on_message(self, message: str | bytes) -> None:
        """Hand on what the page says.

        Args:
            message: Anything.
        """
        if isinstance(message, bytes):
            self.refuse_message("message: expected text, got bytes")
        elif not self._allowance.take():
            self.refuse_message("message: too many in a second; wait a moment")
        else:
            self.server.on_message(self, message)

    def refuse_message(self, reason: str) -> None:
        """Answer that a message was refused.

        Args:
            reason: Why.
        """
        self.server.refused += 1
        self.tell(self.server.refusal(reason), key=reason)

    def on_close(self) -> None:
        """Forget the page."""
        self.server.pages.discard(self)

    async def _write(self, batch: list[str]) -> None:
        # One message for the batch: a list of what was told.
        await self.write_or_leave(f"[{','.join(batch)}]", binary=False)
