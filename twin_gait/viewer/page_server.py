"""Serve a page on this machine from a thread of this process, for as long as a block of code runs."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError
from types import TracebackType
from typing import Self, TypeVar

from twin_gait.exceptions import ViewerError
from twin_gait.viewer.live.scene_server import SceneServer
from twin_gait.viewer.live.window import LiveWindow

_Result = TypeVar("_Result")


class PageServer:
    """Serves one page, and a scene that may change, on the loopback interface; a context manager.

    It runs in a thread of this process, so that nothing is left of it when the process ends in any way.

    Attributes:
        url: Address of the page, with the token that lets in.
        window: The scene; only :meth:`call` may touch it.
    """

    def __init__(self, page: str, *, port: int, timeout: float = 10.0) -> None:
        """Listen, and begin to answer.

        Args:
            port: First port to try; 0 lets the system choose.
            timeout: Longest wait for the thread in [s].

        Raises:
            ViewerError: If the port is out of range or none is free.
        """
        if not 0 <= port <= 65535:
            raise ViewerError(f"port: expected a number from 0 to 65535, got {port!r}")
        self._timeout = timeout
        self.window = LiveWindow()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="page server", daemon=True)
        self._thread.start()
        try:
            self._server = self.call(lambda: SceneServer(page, first_port=port, scene=self.window.everything))
        except BaseException:
            self._end()
            raise
        self.url = self._server.url

    def call(self, function: Callable[[], _Result]) -> _Result:
        """Call a function in the thread of the server, and return what it returns.

        Raises:
            ViewerError: If the server has been closed or does not answer.
        """

        async def run() -> _Result:
            return function()

        if not self._thread.is_alive():
            raise ViewerError("the viewer has been closed; start it again")
        try:
            return asyncio.run_coroutine_threadsafe(run(), self._loop).result(self._timeout)
        except (TimeoutError, CancelledError) as error:
            raise ViewerError("the viewer's server does not answer; start the viewer again") from error

    def show(self) -> None:
        """Bring what has changed in the scene to all pages.

        Raises:
            ViewerError: If the server has been closed or does not answer.
        """
        self.call(lambda: self._server.show(self.window.changes()))

    def pages(self) -> int:
        """How many pages show the scene.

        Raises:
            ViewerError: If the server has been closed or does not answer.
        """
        return self.call(lambda: len(self._server.views))

    def close(self) -> None:
        """Stop."""
        if self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self._server.close(), self._loop).result(self._timeout)
            self._end()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop."""
        self.close()

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
