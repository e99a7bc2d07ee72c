"""The way to the live viewer's server: start it, talk to it, end it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

from zmq.constants import LINGER, RCVTIMEO, REQ, SNDTIMEO
from zmq.error import ZMQError
from zmq.sugar.context import Context

from twin_gait.exceptions import ViewerError
from twin_gait.viewer.commands import Command, encode


class ServerWindow:
    """Sends commands to the server; a server that does not answer is an error, not a wait for ever."""

    def __init__(self, zmq_url: str, timeout: float) -> None:
        """Connect.

        Args:
            zmq_url: Address of the server.
            timeout: Longest wait for an answer in [s].
        """
        self._context = Context()
        self._socket = self._context.socket(REQ)
        self._socket.setsockopt(LINGER, 0)
        self._socket.setsockopt(RCVTIMEO, int(1000 * timeout))
        self._socket.setsockopt(SNDTIMEO, int(1000 * timeout))
        self._socket.connect(zmq_url)

    def send(self, command: Command) -> None:
        """Send a command and wait until it has arrived.

        Args:
            command: The command.

        Raises:
            ViewerError: If the server does not take it.
        """
        answer = self.request(command["type"].encode(), command["path"].encode(), encode(command))
        if answer != b"ok":
            raise ViewerError(f"the viewer's server refused a command: {answer.decode(errors='replace')}")

    def request(self, *frames: bytes) -> bytes:
        """Send a request of several parts and return the answer.

        Args:
            frames: The parts.

        Returns:
            The answer.

        Raises:
            ViewerError: If there is none.
        """
        try:
            self._socket.send_multipart(frames)
            return bytes(self._socket.recv())
        except ZMQError as error:
            raise ViewerError("the viewer's server does not answer; start the viewer again") from error

    def close(self) -> None:
        """Close the connection."""
        self._socket.close(0)
        self._context.term()


def start_server(port: int) -> subprocess.Popen[str]:
    """Start the server as a child that ends with this process.

    Args:
        port: First port to try for the page; 0 lets the system choose.

    Returns:
        The child.
    """
    package_root = str(Path(__file__).parents[2])
    known = [package_root, *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.Popen(
        [sys.executable, "-m", "twin_gait.viewer.server", "--port", str(port)],
        stdin=subprocess.PIPE,  # its end tells the server that we have gone
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,  # a pipe that nobody reads would stop the server when it is full
        start_new_session=True,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(known)},
    )


def read_addresses(process: subprocess.Popen[str], timeout: float) -> dict[str, str]:
    """Wait for the server's line; reading in a thread also works where pipes cannot be polled.

    Args:
        process: The child.
        timeout: Longest wait in [s].

    Returns:
        ``zmq_url`` for commands and ``web_url`` of the page.

    Raises:
        ViewerError: If the server does not start.
    """
    lines: list[str] = []
    stream = process.stdout
    assert stream is not None  # a pipe was asked for
    reader = threading.Thread(target=lambda: lines.append(stream.readline()), daemon=True)
    reader.start()
    reader.join(timeout)
    if not lines or not lines[0].strip():
        raise ViewerError(f"the viewer's server did not start within {timeout:g} s; is meshcat installed?")
    answer: dict[str, str] = json.loads(lines[0])
    if "error" in answer:
        raise ViewerError(f"the viewer's server cannot start: {answer['error']}; give another --port")
    return answer


def end_server(process: subprocess.Popen[str]) -> None:
    """End the server and wait until it has gone.

    Args:
        process: The child.
    """
    assert process.stdin is not None  # a pipe was asked for
    assert process.stdout is not None
    process.stdin.close()
    try:
        process.wait(3.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    process.stdout.close()
