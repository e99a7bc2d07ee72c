"""Web server of a page and of its scene: on the loopback interface, for whoever has the token of this start.

The protocol work is tornado's. ``/`` is the page, complete with meshcat's viewer, and ``/socket`` brings the
scene to it in the commands of that viewer. The name of the machine and the origin keep other sites out; the
token keeps out the other users of this machine, who reach the port and can write any header.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import resource
import secrets
import socket
import time
from collections.abc import Awaitable, Callable, Hashable, Iterable, Mapping
from typing import Any, Generic, TypeVar
from urllib.parse import urlsplit

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream, StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from twin_gait.exceptions import ViewerError

LOOPBACK = "127.0.0.1"
PORTS_TRIED = 100
MOST_CONNECTIONS = 256  # a page has three
_RETRY = 0.5  # [s] until a process that has no files left looks again whether somebody waits
Change = tuple[Hashable, bytes]
MOST_WAITING = 4096  # items for one page; beyond it the oldest give way
Item = TypeVar("Item")
LOOPBACK_NAMES = frozenset({LOOPBACK, "localhost"})
# What is longer is not read at all: the socket is closed with status 1009. Who checks the messages may set
# a lower limit and answer.
LONGEST_MESSAGE = 65536  # [B]
MOST_SOCKETS = 64
MESSAGES_PER_SECOND = 200.0
_BURST = 400.0
PATIENCE = 10.0  # [s] for the headers of a request, for its body, and for the next request
_LONGEST_HEADER = 16384  # [B]
_FAREWELL = 0.05  # [s] in which a page may answer that it has heard of the end
Message = Mapping[str, Any]


def bind_loopback(first_port: int) -> socket.socket:
    """Listen on the loopback interface.

    ``first_port``: if it is taken the next one is tried; 0 lets the system choose. Raises OSError if no port
    is free.
    """
    tried = [0] if first_port == 0 else range(first_port, min(first_port + PORTS_TRIED, 65536))
    for port in tried:
        try:
            listener = socket.create_server((LOOPBACK, port), backlog=128)
        except OSError:
            continue
        listener.setblocking(False)
        return listener
    raise OSError(f"no free port from {first_port} to {tried[-1]}")


class Door:
    """Lets callers in while there is room and hangs up on the others, in the running event loop.

    Asyncio and tornado log a trace each time that they look at a caller whom a process without free files
    cannot take, thousands of times a second.
    """

    def __init__(self, listener: socket.socket, welcome: Callable[[socket.socket, Any], None]) -> None:
        """Open.

        ``listener`` of :func:`bind_loopback`; belongs to the door from now on; ``welcome``: takes the socket
        of a caller, which does not block, and its address.
        """
        self._listener, self._welcome = listener, welcome
        self._inside: list[socket.socket] = []
        self._loop = asyncio.get_running_loop()
        self._open()

    def close(self) -> None:
        """Let nobody in any more."""
        self._loop.remove_reader(self._listener)
        self._listener.close()

    def _open(self) -> None:
        if self._listener.fileno() >= 0:
            self._loop.add_reader(self._listener, self._answer)

    def _answer(self) -> None:
        try:
            caller, address = self._listener.accept()
        except (BlockingIOError, ConnectionAbortedError):
            return
        except OSError:  # no files left
            self._loop.remove_reader(self._listener)
            self._loop.call_later(_RETRY, self._open)
            return
        self._inside = [other for other in self._inside if other.fileno() >= 0]
        if len(self._inside) >= most_connections():
            caller.close()
            return
        caller.setblocking(False)
        self._inside.append(caller)
        self._welcome(caller, address)


def most_connections() -> int:
    """How many callers may be in at a time: at most half of the files that this process may open."""
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return MOST_CONNECTIONS if limit == resource.RLIM_INFINITY else min(MOST_CONNECTIONS, limit // 2)


class Outbox(Generic[Item]):
    """Sends to one page, one batch at a time.

    While a batch is on its way, what comes is kept under its key, and a newer item takes the place of an
    older one of the same key. A page that has stopped reading therefore costs a bounded memory and no time.
    """

    def __init__(self, write: Callable[[list[Item]], Awaitable[None]]) -> None:
        """Start empty.

        ``write``: writes one batch; what it returns ends when the network has taken the batch.
        """
        self._write = write
        self._waiting: dict[Hashable, Item] = {}
        self._sending: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        """How many items wait."""
        return len(self._waiting)

    def post(self, items: Iterable[tuple[Hashable, Item]]) -> None:
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


class LiveServer(SceneServer):
    """Serves the live page."""

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

        ``first_port``: if it is taken the next one is tried; 0 lets the system choose; ``on_message``: called
        with what a page says, which may be any text; ``on_stop``: called when a page asks to stop without its
        socket; ``refusal``: makes the answer to what is refused here, of the reason; ``greeting`` and
        ``scene``: messages for a panel, and packed commands for a scene, that have just been opened. Raises
        ViewerError if no port is free.
        """
        self.on_message, self.on_stop = on_message, on_stop
        self.refusal, self.greeting = refusal, greeting
        self.pages: set[Panel] = set()  # open panels
        super().__init__(page, first_port=first_port, scene=scene)

    def tell(self, message: Message, *, key: Hashable | None = None) -> None:
        """Tell all panels something.

        ``key``: a later message of the same key makes this one needless; None keeps every one.
        """
        text = json.dumps(message, allow_nan=False)
        for panel in self.pages:
            panel.post_text(text, key)

    def sockets(self) -> set[Any]:
        """Open web sockets."""
        return super().sockets() | self.pages

    def routes(self) -> list[tuple[str, type[RequestHandler]]]:
        """Paths and who answers them."""
        return [*super().routes(), (r"/stop", StopHandler), (r"/panel", Panel)]


class StopHandler(Guarded):
    """The way to stop when the socket of a page is not open."""

    def post(self) -> None:
        """Stop."""
        self.require_own_page()
        self.server.on_stop()
        self.write("stopped\n")


class Panel(GuardedSocket):
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

        ``key``: a later message of the same key makes this one needless; None keeps every one.
        """
        self.post_text(json.dumps(message, allow_nan=False), key)

    def post_text(self, text: str, key: Hashable | None) -> None:
        """Send a message as soon as the page takes it."""
        self._count += 1
        self.outbox.post([(self._count if key is None else ("last", key), text)])

    def on_message(self, message: str | bytes) -> None:
        """Hand on what the page says."""
        if isinstance(message, bytes):
            self.refuse_message("message: expected text, got bytes")
        elif not self._allowance.take():
            self.refuse_message("message: too many in a second; wait a moment")
        else:
            self.server.on_message(self, message)

    def refuse_message(self, reason: str) -> None:
        """Answer that a message was refused."""
        self.server.refused += 1
        self.tell(self.server.refusal(reason), key=reason)

    def on_close(self) -> None:
        """Forget the page."""
        self.server.pages.discard(self)

    async def _write(self, batch: list[str]) -> None:
        # One message for the batch: a list of what was told.
        await self.write_or_leave(f"[{','.join(batch)}]", binary=False)
