"""The control socket of a running correction: who asks is known, what is asked is logged.

One JSON object a line in, one out. A door says who is answered; the kernel says who asks. Nothing
that is asked can stop the cycle: a request has a bounded length, a bounded time, and its faults are
answers.
"""

from __future__ import annotations

import asyncio
import json
import logging
import socket
from collections.abc import Awaitable, Callable
from typing import Any

from pydantic import ValidationError

from abbe.compcore.errors import AbbeError
from abbe.compcore.validation import in_one_line
from abbe.daemon.control.doors import Door, Peer
from abbe.daemon.control.requests import LONGEST, REQUEST, Request

logger = logging.getLogger("abbe.control")

Handle = Callable[[Request, str], Awaitable[dict[str, Any]]]
"""A request and who asks (for the journal) → the answer; raises `AbbeError` for what cannot be."""

_WITHIN = 5.0
"""s for a request to arrive."""


class ControlServer:
    """Takes requests at one door, from `start` to `stop`.

    Parameters
    ----------
    door
        Where, and from whom.
    handle
        What does what is asked.
    """

    def __init__(self, door: Door, handle: Handle) -> None:
        self._door, self._handle = door, handle
        self._server: asyncio.Server | None = None

    async def start(self) -> None:
        """Listen.

        Raises
        ------
        AbbeError
            When the socket cannot be had.
        """
        self._server = await asyncio.start_unix_server(
            self._serve, sock=self._door.listen(), limit=LONGEST, start_serving=True
        )

    async def stop(self) -> None:
        """Listen no more."""
        if self._server is None:
            return
        self._server.close()
        self._server = None
        self._door.leave()

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
        peer = Peer.of(connection)
        if reason := self._door.refuses(peer):
            logger.warning("control: %s was refused: %s", peer, reason)
            return {"ok": False, "error": reason}
        try:
            request = REQUEST.validate_json(line)
        except ValidationError as error:
            return {"ok": False, "error": f"not a request: {in_one_line(error)}"}
        if not self._door.lets(request):
            return {"ok": False, "error": "nothing can be changed here: ask at control.socket"}
        try:
            return {"ok": True, **await self._handle(request, str(peer))}
        except AbbeError as error:
            logger.warning("control: refused, asked by %s: %s", peer, error)
            return {"ok": False, "error": str(error)}
        except Exception as error:
            logger.exception("control: a request failed; the correction goes on")
            return {"ok": False, "error": f"failed: {error}"}
