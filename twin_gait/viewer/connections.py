"""Connections of the pages: whom the loopback interface lets in, and how one page is sent to."""

from __future__ import annotations

import asyncio
import resource
import socket
from collections.abc import Awaitable, Callable, Hashable, Iterable
from typing import Any, Generic, TypeVar

LOOPBACK = "127.0.0.1"
PORTS_TRIED = 100
MOST_CONNECTIONS = 256  # a page has three
_RETRY = 0.5  # [s] until a process that has no files left looks again whether somebody waits
MOST_WAITING = 4096  # items for one page; beyond it the oldest give way
Item = TypeVar("Item")


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


class Acceptor:
    """Lets callers in while there is room and hangs up on the others, in the running event loop.

    Asyncio and tornado log a trace each time that they look at a caller whom a process without free files
    cannot take, thousands of times a second.
    """

    def __init__(self, listener: socket.socket, welcome: Callable[[socket.socket, Any], None]) -> None:
        """Open.

        ``listener`` of :func:`bind_loopback`; belongs to it from now on; ``welcome``: takes the socket
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
