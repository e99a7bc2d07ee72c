"""Ports of this machine that no other machine can reach."""

from __future__ import annotations

import socket

LOOPBACK = "127.0.0.1"
PORTS_TRIED = 100


def bind_loopback(first_port: int) -> socket.socket:
    """Listen on the loopback interface.

    Args:
        first_port: If it is taken the next one is tried; 0 lets the system choose.

    Returns:
        The listening socket, which does not block.

    Raises:
        OSError: If no port is free.
    """
    tried = [0] if first_port == 0 else range(first_port, min(first_port + PORTS_TRIED, 65536))
    for port in tried:
        try:
            listener = socket.create_server((LOOPBACK, port), backlog=128)
        except OSError:
            continue
        listener.setblocking(False)
        return listener
    raise OSError(f"no free port from {first_port} to {tried[-1]}")
