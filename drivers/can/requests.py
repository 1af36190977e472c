"""Messages that are asked for: requests sent, answers waited for, late ones told apart."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from drivers.can.bus import CanBus
from drivers.can.dbc_config import DbcConfig, RequestConfig
from drivers.can.heard import Heard
from drivers.link import LinkStatus
from drivers.patience import Patience
from drivers.quarantine import Roster

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
    """

    def __init__(self, bus: CanBus, config: DbcConfig, roster: Roster, status: LinkStatus) -> None:
        self._bus = bus
        self._config = config
        self._roster = roster
        self._status = status
        self._awaited: set[Heard] = set()
        self._answered: asyncio.Future[None] | None = None
        self._patience = Patience(_expire)

    def due(self, wanted: Iterable[Heard]) -> list[Heard]:
        """Which of the messages are to be asked for now."""
        now = time.monotonic()
        asked: dict[Heard, None] = {}
        for heard in wanted:
            if heard.request is None or now - heard.came < heard.every:
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
        loop = asyncio.get_running_loop()
        began = time.monotonic()
        for heard in asked:
            heard.asked = True
        self._status.requests += len(asked)
        self._awaited = set(asked)
        answered = self._answered = loop.create_future()
        self._patience.begin(answered, self._config.timeout)
        try:
            self._bus.send([_frame(heard) for heard in asked])
            await answered
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
            self._patience.end()
            self._awaited, self._answered = set(), None

    def is_awaited(self, heard: Heard) -> bool:
        """Whether a frame of a message that is asked for is an answer; late ones are none."""
        if heard in self._awaited:
            return True
        heard.asked_at = None  # late, or unasked: not what is asked for next
        return False

    def took(self, heard: Heard) -> None:
        """An answer was taken in; the last one ends the wait."""
        self._awaited.discard(heard)
        if not self._awaited and self._answered is not None and not self._answered.done():
            self._answered.set_result(None)

    def fail(self, error: Exception) -> None:
        """End a wait with an error."""
        if self._answered is not None and not self._answered.done():
            self._answered.set_exception(error)


def _frame(heard: Heard) -> can.Message:
    """The frame that asks for a message."""
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


def _expire(answered: asyncio.Future[None]) -> None:
    if not answered.done():
        answered.set_exception(TimeoutError())
