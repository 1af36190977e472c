"""The control socket of a running correction: who asks is known, what is asked is logged.

One JSON object a line in, one out. The socket belongs to the user who runs the correction, and only
that user (or root) is answered; the kernel says who asks. Nothing that is asked can stop the cycle:
a request has a bounded length, a bounded time, and its faults are answers.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import pwd
import socket
import struct
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from abbe.compcore.errors import AbbeError
from abbe.daemon.control.requests import LONGEST, REQUEST, Request
from abbe.daemon.socket_path import bound

logger = logging.getLogger("abbe.control")

Handle = Callable[[Request, str], Awaitable[dict[str, Any]]]
"""A request and who asks (for the journal) → the answer; raises `AbbeError` for what cannot be."""

_WITHIN = 5.0
"""s for a request to arrive."""
_CREDENTIALS = struct.Struct("3i")


class ControlServer:
    """Takes requests while the context lasts.

    Parameters
    ----------
    path
        The socket.
    handle
        What does what is asked.
    """

    def __init__(self, path: Path, handle: Handle) -> None:
        self._path, self._handle = path, handle
        self._server: asyncio.Server | None = None
        self._inode = 0

    async def start(self) -> None:
        """Listen.

        Raises
        ------
        AbbeError
            When the socket cannot be had.
        """
        try:
            listening = bound(self._path)
        except OSError as error:
            raise AbbeError(f"control.socket {self._path}: {error.strerror}") from None
        self._inode = self._path.lstat().st_ino
        self._server = await asyncio.start_unix_server(
            self._serve, sock=listening, limit=LONGEST, start_serving=True
        )

    async def stop(self) -> None:
        """Listen no more; the socket's file goes, if it is still this one's."""
        if self._server is None:
            return
        self._server.close()
        self._server = None
        with contextlib.suppress(OSError):
            if self._path.lstat().st_ino == self._inode:
                self._path.unlink()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            async with asyncio.timeout(_WITHIN):
                line = await reader.readuntil(b"\n")
            answer = await self._answer(line, writer.get_extra_info("socket"))
            writer.write(json.dumps(answer, ensure_ascii=False).encode() + b"\n")
            async with asyncio.timeout(_WITHIN):
                await writer.drain()
        except (TimeoutError, OSError, ValueError, asyncio.IncompleteReadError):
            pass  # who asks nothing, or hangs up, is not answered
        except asyncio.LimitOverrunError:
            logger.warning("control: a request longer than %d bytes was not read", LONGEST)
        finally:
            writer.close()

    async def _answer(self, line: bytes, connection: socket.socket) -> dict[str, Any]:
        uid, who = _asking(connection)
        if uid not in (os.geteuid(), 0):
            logger.warning("control: %s was refused: not the user who runs the correction", who)
            return {"ok": False, "error": "only the user who runs the correction may change it"}
        try:
            request = REQUEST.validate_json(line)
        except ValidationError as error:
            return {"ok": False, "error": f"not a request: {error.errors()[0]['msg']}"}
        try:
            return {"ok": True, **await self._handle(request, who)}
        except AbbeError as error:
            logger.warning("control: refused, asked by %s: %s", who, error)
            return {"ok": False, "error": str(error)}
        except Exception as error:
            logger.exception("control: a request failed; the correction goes on")
            return {"ok": False, "error": f"failed: {error}"}


def _asking(connection: socket.socket) -> tuple[int, str]:
    """User number, and name and process for people, by the kernel's word."""
    if not hasattr(socket, "SO_PEERCRED"):
        return os.geteuid(), "somebody"
    found = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, uid, _ = _CREDENTIALS.unpack(found)
    name = str(uid)
    with contextlib.suppress(KeyError):
        name = pwd.getpwuid(uid).pw_name
    return uid, f"{name} (process {pid})"
