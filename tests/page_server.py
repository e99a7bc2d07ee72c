"""Server of a page in a thread during a block of a test."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from twin_gait.viewer.server import SceneServer


@contextmanager
def served(page: str, port: int = 0) -> Iterator[SceneServer]:
    """Serve a page; the server is created in the event loop of its thread."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    async def made() -> SceneServer:
        return SceneServer(page, first_port=port)

    server = asyncio.run_coroutine_threadsafe(made(), loop).result(10.0)
    try:
        yield server
    finally:
        asyncio.run_coroutine_threadsafe(server.close(), loop).result(10.0)
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
