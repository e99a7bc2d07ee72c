"""What has been drawn, for pages to come, and what has changed since the last frame, for open ones."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Hashable, Iterable
from typing import Generic, TypeVar

from twin_gait.viewer.commands import Command, Recorder, pack

Change = tuple[Hashable, bytes]
MOST_WAITING = 4096  # items for one page; beyond it the oldest give way


class LiveWindow:
    """Window that keeps the whole scene and collects the changes of a frame."""

    def __init__(self) -> None:
        """Start empty."""
        self._recorder = Recorder()
        self._changes: dict[Hashable, Command] = {}
        self._notes: dict[str, Command] = {}
        self._samples = 0

    def send(self, command: Command) -> None:
        """Take a drawing command."""
        self._recorder.send(command)
        self._changes[command["type"], command["path"], command.get("property", "")] = command

    def describe(self, page: Command) -> None:
        """Take the description of the page."""
        self._note("page", page, "page")

    def sample(self, sample: Command) -> None:
        """Take the numbers of a moment; none gives way to a later one, because curves are drawn of them."""
        self._samples += 1
        self._note("sample", sample, ("sample", self._samples))

    def _note(self, kind: str, content: Command, key: Hashable) -> None:
        command = {"type": kind, "path": "", kind: content}
        self._notes[kind] = command
        self._changes[key] = command

    def changes(self) -> list[Change]:
        """What has changed since the last call: a key each, and the packed command."""
        packed = [(key, pack(command)) for key, command in self._changes.items()]
        self._changes.clear()
        return packed

    def everything(self) -> list[Change]:
        """The whole scene for a page that has just been opened: description, drawing, last numbers."""
        page, sample = self._notes.get("page"), self._notes.get("sample")
        commands = [page, *self._recorder.commands(), sample]
        return [(index, pack(command)) for index, command in enumerate(commands) if command is not None]


Item = TypeVar("Item")


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
