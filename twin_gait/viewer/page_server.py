"""Serve a page on this machine from a thread of this process, for as long as a block of code runs."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from concurrent.futures import CancelledError
from types import TracebackType
from typing import Any, Self, TypeVar

from twin_gait.exceptions import ViewerError
from twin_gait.viewer.live.scene_server import SceneServer

_Result = TypeVar("_Result")
_PATIENCE = 10.0  # [s] with the thread of the server


class PageServer:
    """Serves one page on the loopback interface; a context manager.

    It runs in a thread of this process, so that nothing is left of it when the process ends in any way.

    Attributes:
        url: Address of the page, with the token that lets in.
    """

    def __init__(self, page: str, *, port: int) -> None:
        """Listen, and begin to answer.

        ``port``: first port to try; 0 lets the system choose. Raises ViewerError if the port is out of range,
        none is free, or the thread does not answer.
        """
        if not 0 <= port <= 65535:
            raise ViewerError(f"port: expected a number from 0 to 65535, got {port!r}")
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="page server", daemon=True)
        self._thread.start()
        try:
            self._server = self._result(_made(page, port))
        except BaseException:
            self._end()
            raise
        self.url = self._server.url

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop."""
        self._result(self._server.close())
        self._end()

    def _result(self, work: Coroutine[Any, Any, _Result]) -> _Result:
        """What comes of work in the thread of the server."""
        try:
            return asyncio.run_coroutine_threadsafe(work, self._loop).result(_PATIENCE)
        except (TimeoutError, CancelledError) as error:
            raise ViewerError("the viewer's server does not answer; start the viewer again") from error

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


async def _made(page: str, port: int) -> SceneServer:
    """A server belongs to the loop that it is made in."""
    return SceneServer(page, first_port=port)
