"""Serve one finished page on this machine, for as long as a block of code runs."""

from __future__ import annotations

import re
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, Self

from twin_gait.exceptions import ViewerError
from twin_gait.viewer.loopback import LOOPBACK, bind_loopback

_OWN_NAMES = re.compile(rf"({re.escape(LOOPBACK)}|localhost)(:\d+)?")


class PageServer:
    """Serves one page on the loopback interface; use it as a context manager.

    It runs in a thread of this process, so that nothing is left of it when the process ends in any way.

    Attributes:
        url: Address of the page.
    """

    def __init__(self, page: str, *, port: int) -> None:
        """Listen.

        Args:
            page: The HTML.
            port: First port to try; 0 lets the system choose.

        Raises:
            ViewerError: If the port is out of range or none is free.
        """
        if not 0 <= port <= 65535:
            raise ViewerError(f"port: expected a number from 0 to 65535, got {port!r}")
        try:
            listener = bind_loopback(port)
        except OSError as error:
            raise ViewerError(f"the page cannot be served: {error}; give another --port") from error
        listener.setblocking(True)
        self._server = ThreadingHTTPServer(listener.getsockname(), _handler(page), bind_and_activate=False)
        self._server.socket.close()
        self._server.socket = listener
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True)
        self.url = f"http://{LOOPBACK}:{listener.getsockname()[1]}/"

    def __enter__(self) -> Self:
        """Begin to answer."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def _handler(page: str) -> type[BaseHTTPRequestHandler]:
    content = page.encode("utf-8")

    class Handler(BaseHTTPRequestHandler):
        timeout = 10.0

        def do_GET(self) -> None:
            # Another site cannot point its own name here.
            known = _OWN_NAMES.fullmatch(self.headers.get("Host", "")) and self.path.split("?")[0] == "/"
            answer = content if known else b"there is nothing here\n"
            self.send_response(200 if known else 404)
            self.send_header("Content-Type", f"text/{'html' if known else 'plain'}; charset=utf-8")
            self.send_header("Content-Length", str(len(answer)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(answer)

        def log_message(self, format: str, *arguments: Any) -> None:
            """Keep requests out of the terminal."""

    return Handler
