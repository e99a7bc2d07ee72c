"""What has been drawn, for pages to come, and what has changed since the last frame, for open ones."""

from __future__ import annotations

from collections.abc import Hashable

from twin_gait.viewer.commands import Command, Recorder, pack

Change = tuple[Hashable, bytes]
SCENE_ROOT = "/meshcat"  # under which everything is drawn


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

    def clear(self) -> None:
        """Forget the scene, and take it out of open pages."""
        self._recorder, self._notes = Recorder(), {}
        self._changes = {"clear": {"type": "delete", "path": SCENE_ROOT}}

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
