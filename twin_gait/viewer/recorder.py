"""Keeps commands for a page, in place of a window with a server."""

from __future__ import annotations

from twin_gait.viewer.commands import Command, pack

# Objects first, because setting one clears its properties; the animation last, because its tracks
# look for the objects.
_ORDER = ("set_object", "set_transform", "set_property", "set_animation")


class Recorder:
    """Window that remembers the last command of each kind for each place."""

    def __init__(self) -> None:
        """Start empty."""
        self._commands: dict[tuple[str, str, str], Command] = {}

    def send(self, command: Command) -> None:
        """Remember a command."""
        key = (command["type"], command["path"], command.get("property", ""))
        self._commands[key] = command

    def commands(self) -> list[Command]:
        """Commands in the order in which a viewer must take them."""
        return sorted(self._commands.values(), key=lambda command: _ORDER.index(command["type"]))

    def packed(self) -> bytes:
        """All commands, one after the other as :func:`~twin_gait.viewer.commands.pack` has them."""
        return b"".join(pack(command) for command in self.commands())
