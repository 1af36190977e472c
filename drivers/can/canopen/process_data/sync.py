"""SYNC on a CANopen bus: sent, and the PDOs that answer it waited for."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections import deque
from collections.abc import Collection
from typing import TYPE_CHECKING

from abbe.drivers.can.bus import CanBus
from abbe.drivers.can.canopen.config import CanopenConfig
from abbe.drivers.can.frames import frame
from abbe.drivers.link import LinkError, LinkStatus
from abbe.drivers.reply_wait import ReplyWait

if TYPE_CHECKING:
    from abbe.drivers.can.canopen.process_data.pdo import Pdo

SYNC_ID = 0x80
_REMEMBERED = 64
"""SYNC whose time is kept: more than are sent while we are stalled."""


class Sync:
    """The SYNC producer of one bus.

    Parameters
    ----------
    bus
        Where it goes.
    config
        The link's section.
    status
        Counts requests.
    """

    def __init__(self, bus: CanBus, config: CanopenConfig, status: LinkStatus) -> None:
        self._bus = bus
        self._config = config
        self._status = status
        self._frame = frame(SYNC_ID, b"")
        self._missing = 0
        self._times: deque[float] = deque(maxlen=_REMEMBERED)
        self._answered: ReplyWait[None] = ReplyWait(bus.wait)

    async def ask(self, pdos: Collection[Pdo]) -> None:
        """Send a SYNC and wait, at most one time-out, for the PDOs that answer it.

        Raises
        ------
        LinkDownError
            When it cannot be sent, or the bus is closed meanwhile.
        """
        config = self._config
        began = time.monotonic()
        self._bus.drain()  # what waits to be read is no answer
        waited_for = [pdo for pdo in pdos if began >= pdo.not_before]
        for pdo in waited_for:
            pdo.awaited_since = began
        self._missing = len(waited_for)
        answered = self._answered
        answered.begin(len(waited_for))
        self._status.requests += 1
        try:
            self._bus.send((self._frame,), began + config.timeout)
            self.went(began)
            if waited_for:
                await answered.get(config.timeout)
        except TimeoutError:
            pass  # what came in time counts
        finally:
            answered.end()
            for pdo in waited_for:
                if pdo.awaited_since is not None:
                    # its answer may still come, and is not to pass for the next one's
                    pdo.awaited_since = None
                    pdo.not_before = time.monotonic() + config.late_reply_max
        self._status.round_trip = time.monotonic() - began

    async def send_for_ever(self, period: float) -> None:
        """Send a SYNC every `period` s."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            with contextlib.suppress(LinkError):
                now = time.monotonic()
                self._bus.drain()
                self._bus.send((self._frame,), now + period)
                self.went(now)
            due = max(due + period, loop.time())
            await asyncio.sleep(due - loop.time())

    def went(self, at: float) -> None:
        """A SYNC went over the bus (monotonic, s), ours or somebody else's."""
        self._times.append(at)

    def before(self, at: float) -> float:
        """When the last SYNC went before `at` (monotonic, s); infinite when none is known."""
        return next((time for time in reversed(self._times) if time <= at), math.inf)

    def came(self) -> None:
        """A PDO that was waited for is there; the last one ends the wait."""
        self._missing -= 1
        if not self._missing:
            self._answered.give(None)

    def fail(self, error: Exception) -> None:
        """End a wait with an error."""
        self._answered.fail(error)
