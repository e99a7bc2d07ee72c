"""The server of the live viewer: meshcat's, on the loopback interface, ending with its parent.

Run as ``python -m twin_gait.viewer.server``; :class:`twin_gait.viewer.session.LiveViewer` starts it. It
writes one line of JSON to standard output, with the addresses or with an error, and leaves when its
standard input ends, which happens however its parent ends.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import sys
import threading
import warnings
from typing import Any

with warnings.catch_warnings():
    # meshcat 0.3.2 imports a module that pyzmq has renamed.
    warnings.filterwarnings("ignore", category=DeprecationWarning)
    from meshcat.servers import zmqserver
    from meshcat.servers.tree import find_node, walk

import umsgpack
from tornado.httpserver import HTTPServer
from tornado.web import Application, RequestHandler
from zmq.constants import LAST_ENDPOINT

from twin_gait.viewer.loopback import LOOPBACK, bind_loopback
from twin_gait.viewer.page import live_page

_PAGE, _SAMPLE, _COUNT = b"page", b"sample", b"pages"


class LivePage(RequestHandler):  # type: ignore[misc]  # no type information in tornado
    """The page with its read-outs."""

    def get(self) -> None:
        """Answer with the page."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.write(live_page())


class PageSocket(zmqserver.WebSocketHandler):  # type: ignore[misc]  # no type information in meshcat
    """Web socket of a page; it only listens to the server."""

    def open(self) -> None:
        """Send everything drawn so far."""
        self.bridge.websocket_pool.add(self)
        self.bridge.send_scene(self)

    def on_message(self, message: str | bytes) -> None:
        """Ignore what a page says.

        Args:
            message: The message.
        """

    def on_close(self) -> None:
        """Forget the page."""
        self.bridge.websocket_pool.discard(self)


class LoopbackBridge(zmqserver.ZMQWebSocketBridge):  # type: ignore[misc]  # no type information in meshcat
    """Meshcat's bridge, bound to the loopback interface only, that keeps one value per property.

    Meshcat 0.3.2 listens on all interfaces whatever host it is given, and keeps every property that was
    ever set.
    """

    def __init__(self, first_port: int) -> None:
        """Bind both sockets.

        Args:
            first_port: Of the page; if it is taken the next one is tried. 0 lets the system choose.

        Raises:
            OSError: If no port is free.
        """
        self.page_messages: dict[bytes, bytes] = {}
        self._listener = bind_loopback(first_port)
        self.page_port = int(self._listener.getsockname()[1])
        super().__init__(zmq_url=f"tcp://{LOOPBACK}:*", host=LOOPBACK, port=self.page_port)
        self.zmq_url = self.zmq_socket.getsockopt_string(LAST_ENDPOINT)
        self.web_url = f"http://{LOOPBACK}:{self.page_port}/"

    def make_app(self) -> Any:
        """Make the web application, whose ``listen`` takes the sockets that are bound already."""
        static = {"path": zmqserver.VIEWER_ROOT, "default_filename": zmqserver.VIEWER_HTML}
        application = Application()
        # Only under names of this machine: another site cannot point its own name here.
        application.add_handlers(
            rf"({LOOPBACK}|localhost)".replace(".", r"\."),
            [
                (r"/static/(.*)", zmqserver.StaticFileHandlerNoCache, static),
                (r"/socket", PageSocket, {"bridge": self}),
                (r"/", LivePage),
            ],
        )

        def listen(port: int, **options: Any) -> None:
            del port
            HTTPServer(application, **options).add_sockets([self._listener])

        application.listen = listen
        return application

    def handle_zmq(self, frames: list[bytes]) -> None:
        """Handle a request of the session.

        Args:
            frames: Kind, place and content of a command.
        """
        if frames[0] in (_PAGE, _SAMPLE):
            self.page_messages[frames[0]] = frames[2]
            self.forward_to_websockets(frames)
            self.zmq_socket.send(b"ok")
        elif frames[0] == _COUNT:
            self.zmq_socket.send(str(len(self.websocket_pool)).encode())
        else:
            super().handle_zmq(frames)
            if frames[0] == b"set_property":
                self._keep_last(frames)

    def _keep_last(self, frames: list[bytes]) -> None:
        node = find_node(self.tree, [part for part in frames[1].decode().split("/") if part])
        name = umsgpack.unpackb(frames[2])["property"]
        others = [old for old in node.properties[:-1] if umsgpack.unpackb(old)["property"] != name]
        node.properties = [*others, frames[2]]

    def send_scene(self, websocket: Any) -> None:
        """Send everything to a page that has just been opened.

        Args:
            websocket: Its socket.
        """
        messages = [self.page_messages.get(_PAGE)]
        for node in walk(self.tree):
            messages += [node.object, node.transform, *node.properties]
        messages.append(self.page_messages.get(_SAMPLE))
        for message in messages:
            if message is not None:
                websocket.write_message(message, binary=True)


async def _serve(first_port: int) -> None:
    bridge = LoopbackBridge(first_port)
    print(json.dumps({"zmq_url": bridge.zmq_url, "web_url": bridge.web_url}), flush=True)
    parent_gone = asyncio.Event()
    loop = asyncio.get_running_loop()

    def watch() -> None:
        sys.stdin.buffer.read()
        loop.call_soon_threadsafe(parent_gone.set)

    threading.Thread(target=watch, daemon=True).start()
    parent = os.getppid()
    # A process that our parent forked may hold the other end of standard input open.
    while not parent_gone.is_set() and os.getppid() == parent:
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(parent_gone.wait(), timeout=1.0)


def main() -> None:
    """Serve until standard input ends."""
    parser = argparse.ArgumentParser(description="Server of the live viewer, for this machine only.")
    parser.add_argument("--port", type=int, default=7000, help="first port to try (7000); 0: any")
    arguments = parser.parse_args()
    try:
        asyncio.run(_serve(arguments.port))
    except OSError as error:
        print(json.dumps({"error": str(error)}), flush=True)
    # Nothing here needs a tidy end, and open sockets of pages must not delay it.
    os._exit(0)


if __name__ == "__main__":
    main()
