"""Messages that a page receives over the socket of its scene."""

import struct
from typing import Any

import msgpack


def unpacked(message: bytes) -> list[dict[str, Any]]:
    """Return the commands of a message, each of which follows its length in four bytes."""
    commands, at = [], 0
    while at < len(message):
        (length,) = struct.unpack_from("<I", message, at)
        commands.append(msgpack.unpackb(message[at + 4 : at + 4 + length]))
        at += 4 + length
    return commands
