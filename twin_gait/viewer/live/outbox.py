"""What still has to go to one page: newer values replace older ones, so that a slow page misses frames."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Hashable, Iterable
from typing import Generic, TypeVar

Item = TypeVar("Item")


class Outbox(Generic[Item]):
    """Sends to one page, one batch at a time.

    While a batch is on its way, what comes is kept under its key, and a newer item takes the place of an
    older one of the same key. A page that has stopped reading therefore costs a bounded memory and no time.

    Attributes:
        replaced: How many items gave way to newer ones.
        dropped: How many items were thrown away because too many had come.
    """

    def __init__(self, write: Callable[[list[Item]], Awaitable[None]], *, most: int = 4096) -> None:
        """Start empty.

        Args:
            write: Writes one batch; what it returns ends when the network has taken the batch.
            most: Largest number of items kept; beyond it the oldest give way.
        """
        self._write = write
        self._most = most
        self._waiting: dict[Hashable, Item] = {}
        self._sending: asyncio.Task[None] | None = None
        self.replaced = 0
        self.dropped = 0

    def __len__(self) -> int:
        """How many items wait."""
        return len(self._waiting)

    def post(self, items: Iterable[tuple[Hashable, Item]]) -> None:
        """Send items as soon as the page takes them; returns at once, inside of an event loop."""
        for key, item in items:
            if self._waiting.pop(key, None) is not None:
                self.replaced += 1
            self._waiting[key] = item
        while len(self._waiting) > self._most:
            del self._waiting[next(iter(self._waiting))]
            self.dropped += 1
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
