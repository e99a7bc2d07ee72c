"""Web server of a page and of its scene: on the loopback interface, for whoever has the token of this start.

The protocol work is tornado's. ``/`` is the page, complete with meshcat's viewer, and ``/socket`` brings the
scene to it in the commands of that viewer.
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
from collections.abc import Callable, Iterable
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream
from tornado.web import Application, RequestHandler

from twin_gait.exceptions import ViewerError
from twin_gait.viewer.live.guards import LONGEST_MESSAGE, Guarded, GuardedSocket, NothingHandler
from twin_gait.viewer.live.window import Change, Outbox
from twin_gait.viewer.loopback import LOOPBACK, Door, bind_loopback

PATIENCE = 10.0  # [s] for the headers of a request, for its body, and for the next request
_LONGEST_HEADER = 16384  # [B]
_FAREWELL = 0.05  # [s] in which a page may answer that it has heard of the end


class SceneServer:
    """Serves a page and its scene; belongs to one event loop: make it, and call it, inside of it."""

    def __init__(
        self, page: str, *, first_port: int, scene: Callable[[], Iterable[Change]] = lambda: ()
    ) -> None:
        """Listen.

        ``first_port``: if it is taken the next one is tried; 0 lets the system choose; ``scene``: packed
        commands for a scene that has just been opened. Raises ViewerError if no port is free.
        """
        self.page, self.scene = page, scene
        self.views: set[SceneSocket] = set()  # open scenes
        self.refused = 0  # requests and messages
        self._token = secrets.token_hex(24)  # of this start
        try:
            listener = bind_loopback(first_port)
        except OSError as error:
            raise ViewerError(f"the page cannot be served: {error}; give another --port") from error
        self.port = int(listener.getsockname()[1])
        self.url = f"http://{LOOPBACK}:{self.port}/?token={self._token}"
        owner = {"server": self}
        application = Application(
            [(path, handler, owner) for path, handler in self.routes()],
            default_handler_class=NothingHandler,
            default_handler_args=owner,
            websocket_max_message_size=LONGEST_MESSAGE,
            log_function=lambda handler: None,
        )
        self._http = HTTPServer(
            application,
            max_body_size=LONGEST_MESSAGE,
            max_header_size=_LONGEST_HEADER,
            idle_connection_timeout=PATIENCE,
            body_timeout=PATIENCE,
        )
        self._door = Door(
            listener, lambda caller, address: self._http.handle_stream(IOStream(caller), address)
        )

    def show(self, changes: Iterable[Change]) -> None:
        """Bring changes of the scene to all pages."""
        changes = list(changes)
        for view in self.views:
            view.post(changes)

    def knows(self, token: bytes) -> bool:
        """Whether a token is that of this start; how long it takes tells nothing of it."""
        return hmac.compare_digest(token, self._token.encode())

    def sockets(self) -> set[Any]:
        """Open web sockets."""
        return set(self.views)

    async def close(self) -> None:
        """Stop listening and close all sockets, those of frozen pages too."""
        self._door.close()
        open_pages = self.sockets()
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
        self.set_nodelay(True)
        self._drawn = asyncio.Event()
        self.outbox = Outbox(self._write)
        self.server.views.add(self)
        self.post(self.server.scene())

    def post(self, changes: Iterable[Change]) -> None:
        """Send changes as soon as the page takes them."""
        self.outbox.post(changes)

    def on_message(self, message: str | bytes) -> None:
        """Take it that the page has drawn what came, whatever it says."""
        self._drawn.set()

    def on_close(self) -> None:
        """Forget the page."""
        self.server.views.discard(self)
        self._drawn.set()

    async def _write(self, batch: list[bytes]) -> None:
        self._drawn.clear()
        if await self.write_or_leave(b"".join(batch), binary=True):
            await self._drawn.wait()
