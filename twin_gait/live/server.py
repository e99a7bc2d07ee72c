"""Web server of the live page: beside the scene a panel that speaks with the session, and a way to stop."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Any

from tornado.web import RequestHandler

from twin_gait.viewer.connections import Outbox
from twin_gait.viewer.server import Change, Guarded, GuardedSocket, SceneServer

MESSAGES_PER_SECOND = 200.0
_BURST = 400.0
Message = Mapping[str, Any]


class RateLimit:
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
        self._limit = RateLimit()
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
        elif not self._limit.take():
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
