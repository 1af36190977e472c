"""Unsent bytes of a TCP connection in the operating system: old positions must not leave.

A write that is not acknowledged by the other side's network stays in a buffer of the operating
system, which goes on trying for minutes. A position of minutes ago would then be written.
"""

from __future__ import annotations

import asyncio
import fcntl
import socket
import struct
import termios
from typing import Any

_LINGER_NOT = struct.pack("ii", 1, 0)


def give_up_after(client: Any, seconds: float) -> None:
    """Have the operating system cut a TCP connection off that does not pass data on for so long."""
    if (sock := _socket_of(client)) is not None:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, max(1, round(1e3 * seconds)))


def unsent(client: Any) -> int:
    """Bytes of a TCP connection that the other side has not acknowledged."""
    if (sock := _socket_of(client)) is None:
        return 0
    try:
        answer = fcntl.ioctl(sock.fileno(), termios.TIOCOUTQ, b"\0" * 4)
    except (OSError, ValueError):
        return 0
    return int(struct.unpack("i", answer)[0])


def cut_off(client: Any) -> None:
    """Have the next close of a TCP connection drop what is still in its buffer."""
    if (sock := _socket_of(client)) is not None:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGER_NOT)
        transport = client.ctx.transport
        if isinstance(transport, asyncio.Transport):
            transport.abort()


def _socket_of(client: Any) -> Any:
    transport = client.ctx.transport
    if transport is None or not hasattr(transport, "get_extra_info"):
        return None
    sock = transport.get_extra_info("socket")
    return sock if sock is not None and sock.family in (socket.AF_INET, socket.AF_INET6) else None
