"""Messages that are asked for: requests sent, answers waited for, late ones told apart."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from abbe.drivers.can.bus import CanBus
from abbe.drivers.can.dbc.config import DbcConfig, RequestConfig
from abbe.drivers.can.dbc.received_message import Heard
from abbe.drivers.link import LinkStatus
from abbe.drivers.quarantine import Roster
from abbe.drivers.reply_wait import Awaited

if TYPE_CHECKING:
    import can


class Requests:
    """Asks for messages on one bus.

    Parameters
    ----------
    bus
        Where requests go.
    config
        The link's section.
    roster
        Keeps count of who answers.
    status
        Counts requests.

    Attributes
    ----------
    asked_at
        Monotonic time in s at which the last requests left.
    """

    def __init__(self, bus: CanBus, config: DbcConfig, roster: Roster, status: LinkStatus) -> None:
        self._bus = bus
        self._config = config
        self._roster = roster
        self._status = status
        self.asked_at = 0.0
        self._awaited: set[Heard] = set()
        self._frames: dict[Heard, can.Message] = {}
        self._answered: Awaited[None] = Awaited(bus.wait)

    def due(self, wanted: Iterable[Heard]) -> list[Heard]:
        """Which of the messages are to be asked for now."""
        now = time.monotonic()
        asked: dict[Heard, None] = {}
        for heard in wanted:
            if heard.request is None or not heard.pace.is_due(now):
                continue
            if heard.failures and heard.refusal(now):
                continue
            if heard.asked_at is not None and now - heard.asked_at < self._config.late_reply_max:
                heard.why = f"{heard.name} may still be answered late"
                continue
            asked[heard] = None
        return list(asked)

    async def ask(self, asked: Sequence[Heard]) -> None:
        """Send all requests, then wait for all answers, once `timeout`.

        Raises
        ------
        LinkError
            When a request cannot be sent, or the interface is closed meanwhile.
        """
        frames = []
        for heard in asked:
            heard.asked = True
            frames.append(self._frames.get(heard) or self._frame(heard))
        began = self.asked_at = time.monotonic()
        self._bus.drain()  # what waits to be read is no answer
        self._awaited = set(asked)
        answered = self._answered
        answered.begin(len(asked))
        try:
            self._bus.send(frames, began + self._config.timeout)
            self._status.requests += len(asked)
            await answered.get(self._config.timeout)
            self._status.round_trip = time.monotonic() - began
        except TimeoutError:
            for heard in list(self._awaited):
                heard.asked_at = began
                self._status.failures += 1
                why = f"{heard.name}: no answer in {self._config.timeout:g} s"
                self._roster.unanswered(heard, why)
        except asyncio.CancelledError:
            for heard in self._awaited:
                heard.asked_at = began
            raise
        finally:
            answered.end()
            self._awaited = set()

    def _frame(self, heard: Heard) -> can.Message:
        """The frame that asks for a message, kept for the next time."""
        made = self._frames[heard] = _asking(heard)
        return made

    def is_awaited(self, heard: Heard, latest: float) -> bool:
        """Whether a frame of a message that is asked for is an answer; late ones are none.

        `latest` is the latest moment at which it can have arrived (monotonic, s).
        """
        if heard in self._awaited:
            return latest >= self.asked_at
        heard.asked_at = None  # late, or unasked: not what is asked for next
        return False

    def took(self, heard: Heard) -> None:
        """An answer was taken in; the last one ends the wait."""
        self._awaited.discard(heard)
        if not self._awaited:
            self._answered.give(None)

    def fail(self, error: Exception) -> None:
        """End a wait with an error."""
        self._answered.fail(error)


def _asking(heard: Heard) -> can.Message:
    """The frame that asks for a message; interfaces only read it."""
    import can

    if isinstance(heard.request, RequestConfig):
        request = heard.request
        return can.Message(
            arbitration_id=request.id,
            data=bytes.fromhex(request.data),
            is_extended_id=request.extended,
        )
    return can.Message(
        arbitration_id=heard.message.frame_id,
        is_extended_id=heard.message.is_extended_frame,
        is_remote_frame=True,
        dlc=heard.message.length,
    )
