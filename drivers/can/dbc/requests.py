"""Requests for messages: sent, answers waited for, late ones told apart."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from abbe.drivers.can.bus import CanBus
from abbe.drivers.can.dbc.config import DbcConfig, RequestConfig
from abbe.drivers.can.dbc.received_message import ReceivedMessage
from abbe.drivers.link import LinkStatus
from abbe.drivers.quarantine import MemberHealth
from abbe.drivers.reply_wait import ReplyWait

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
    health
        Keeps count of who answers.
    status
        Counts requests.

    Attributes
    ----------
    asked_at
        Monotonic time in s at which the last requests left.
    """

    def __init__(
        self, bus: CanBus, config: DbcConfig, health: MemberHealth, status: LinkStatus
    ) -> None:
        self._bus = bus
        self._config = config
        self._health = health
        self._status = status
        self.asked_at = 0.0
        self._awaited: set[ReceivedMessage] = set()
        self._frames: dict[ReceivedMessage, can.Message] = {}
        self._answered: ReplyWait[None] = ReplyWait(bus.wait)

    def due(self, wanted: Iterable[ReceivedMessage]) -> list[ReceivedMessage]:
        """Which of the messages are to be asked for now."""
        now = time.monotonic()
        asked: dict[ReceivedMessage, None] = {}
        for received in wanted:
            if received.request is None or not received.pace.is_due(now):
                continue
            if received.failures and received.refusal(now):
                continue
            if (
                received.asked_at is not None
                and now - received.asked_at < self._config.late_reply_max
            ):
                received.why = f"{received.name} may still be answered late"
                continue
            asked[received] = None
        return list(asked)

    async def ask(self, asked: Sequence[ReceivedMessage]) -> None:
        """Send all requests, then wait for all answers, once `timeout`.

        Raises
        ------
        LinkError
            When a request cannot be sent, or the interface is closed meanwhile.
        """
        frames = []
        for received in asked:
            received.asked = True
            frames.append(self._frames.get(received) or self._frame(received))
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
            for received in list(self._awaited):
                received.asked_at = began
                self._status.failures += 1
                why = f"{received.name}: no answer in {self._config.timeout:g} s"
                self._health.unanswered(received, why)
        except asyncio.CancelledError:
            for received in self._awaited:
                received.asked_at = began
            raise
        finally:
            answered.end()
            self._awaited = set()

    def _frame(self, received: ReceivedMessage) -> can.Message:
        """The frame that asks for a message, kept for the next time."""
        made = self._frames[received] = _asking(received)
        return made

    def is_awaited(self, received: ReceivedMessage, latest: float) -> bool:
        """Whether a frame of a message that is asked for is an answer; late ones are none.

        `latest` is the latest moment at which it can have arrived (monotonic, s).
        """
        if received in self._awaited:
            return latest >= self.asked_at
        received.asked_at = None  # late, or unasked: not what is asked for next
        return False

    def took(self, received: ReceivedMessage) -> None:
        """An answer was taken in; the last one ends the wait."""
        self._awaited.discard(received)
        if not self._awaited:
            self._answered.give(None)

    def fail(self, error: Exception) -> None:
        """End a wait with an error."""
        self._answered.fail(error)


def _asking(received: ReceivedMessage) -> can.Message:
    """The frame that asks for a message; interfaces only read it."""
    import can

    if isinstance(received.request, RequestConfig):
        request = received.request
        return can.Message(
            arbitration_id=request.id,
            data=bytes.fromhex(request.data),
            is_extended_id=request.extended,
        )
    return can.Message(
        arbitration_id=received.message.frame_id,
        is_extended_id=received.message.is_extended_frame,
        is_remote_frame=True,
        dlc=received.message.length,
    )
