"""Who may talk to the server of the live page, and how much."""

from __future__ import annotations

import time
from collections.abc import Callable
from urllib.parse import urlsplit

from twin_gait.viewer.loopback import LOOPBACK

LOOPBACK_NAMES = frozenset({LOOPBACK, "localhost"})
# What is longer is not read at all: the socket is closed with status 1009. Who judges the messages may set
# a lower limit and answer.
LONGEST_MESSAGE = 65536  # [B]
MESSAGES_PER_SECOND = 200.0
_BURST = 400.0


def is_loopback(host: str) -> bool:
    """Whether the ``Host`` of a request is a name of this machine.

    Another site can point its own name at this machine, and its page then counts as of the same origin; only
    the name tells.

    Args:
        host: The header, with or without a port.
    """
    try:
        return urlsplit(f"//{host}").hostname in LOOPBACK_NAMES
    except ValueError:
        return False


def is_own_page(origin: str | None, host: str) -> bool:
    """Whether a request comes from a page of this very server.

    Args:
        origin: The ``Origin`` header; None if there is none, which no browser leaves out here.
        host: The ``Host`` header.
    """
    return origin is not None and is_loopback(host) and origin.lower() == f"http://{host.lower()}"


class Allowance:
    """How much a page may still say: so many messages a second, with a reserve for bursts."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start with the whole reserve.

        Args:
            clock: Time in [s].
        """
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
