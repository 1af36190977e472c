"""Dividing a read that a device refuses as a whole: only when proved, and never for good.

Some devices refuse a request that touches an address which they do not have, and answer its parts.
Others refuse everything for a moment: while a program is loaded, while a gateway starts. So a
request is divided only where its parts are answered while the whole is still refused; never when it
was answered a minute ago; never between channels that must be of one moment; and the whole is tried
again after a while, which doubles.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass

from abbe.drivers.link import LinkProtocolError
from abbe.drivers.modbus.bus.refusals import ModbusExceptionError
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.plan import Cut, ReadRequest, Span, Together, cut_of, read_plan

logger = logging.getLogger("abbe.drivers.modbus")

ADDRESS_REFUSALS = (2, 3)
"""Exceptions that say that the device does not have what was asked for, or not so much of it."""

_FIRST_TRIAL, _LAST_TRIAL = 60.0, 3600.0
"""s until a whole request is tried again, at first and at most."""
_MOMENT = 60.0
"""s for which a request may be refused that was answered before, until it may be divided."""
_FIRST_PROOF, _LAST_PROOF = 1.0, 60.0
"""s until the parts of a request of which nothing was answered are tried again."""

Ask = Callable[[Span], Awaitable[bytes]]


@dataclass(slots=True)
class _Wait:
    """When something is tried again; each wait is twice as long as the one before."""

    due: float
    seconds: float

    def longer(self, most: float) -> None:
        self.seconds = min(2.0 * self.seconds, most)
        self.due = time.monotonic() + self.seconds


@dataclass(slots=True)
class _Division:
    """One cut, the request that it was made for, and when that is tried again."""

    whole: Span
    wait: _Wait


class Dividing:
    """Where the reads of one connection are divided.

    Parameters
    ----------
    name
        The link's name, for the log.
    config
        The link's section.
    together
        Sets of channels that are never divided.

    Attributes
    ----------
    cuts
        Addresses that no request may cross.
    """

    def __init__(self, name: str, config: ModbusConfig, together: Together) -> None:
        self._name = name
        self._config = config
        self._together = together
        self.cuts: dict[Cut, _Division] = {}
        self._answered: set[Span] = set()
        self._latest: Span | None = None
        self._refused_since: dict[Span, float] = {}
        self._in_vain: dict[Span, _Wait] = {}

    def answered(self, span: Span) -> None:
        """Take note that the device answers a request as it stands."""
        if span is not self._latest:
            self._latest = span
            self._answered.add(span)
        if self._refused_since:
            self._refused_since.pop(span, None)

    def forget(self) -> None:
        """A new connection: what refused then need not refuse now."""
        self.cuts.clear()
        self._in_vain.clear()

    async def divide(self, request: ReadRequest, refusal: ModbusExceptionError, ask: Ask) -> bool:
        """Find out whether a refused request is answered in parts; whether `cuts` have changed.

        Raises
        ------
        LinkError
            As `ask` does, except for refusals.
        """
        span = request.span
        if refusal.code not in ADDRESS_REFUSALS or self._for_a_moment(span):
            return False
        wait = self._in_vain.get(span)
        if wait is not None and time.monotonic() < wait.due:
            return False
        found: list[Cut] = []
        if not await self._parts(request, ask, found) or await _answers(ask, span):
            if wait is None:
                wait = self._in_vain[span] = _Wait(0.0, _FIRST_PROOF / 2.0)
            wait.longer(_LAST_PROOF)
            return False
        now = time.monotonic()
        for cut in found:
            self.cuts[cut] = _Division(span, _Wait(now + _FIRST_TRIAL, _FIRST_TRIAL))
        logger.warning(
            "link %s: %s, and answered in parts: read in %d parts, divided before address %s",
            self._name,
            refusal,
            len(found) + 1,
            ", ".join(str(at) for _, _, at in sorted(found)),
        )
        return True

    def _for_a_moment(self, span: Span) -> bool:
        """Whether a refused request was answered before, and not refused ever since for long."""
        if span not in self._answered:
            return False
        now = time.monotonic()
        return now - self._refused_since.setdefault(span, now) < _MOMENT

    async def retry(self, ask: Ask) -> bool:
        """Try a request whole again whose time has come; whether `cuts` have changed.

        At most one a call. Raises as `divide`.
        """
        now = time.monotonic()
        due = next((d for d in self.cuts.values() if d.wait.due <= now), None)
        if due is None:
            return False
        same = [cut for cut, division in self.cuts.items() if division.whole == due.whole]
        if await _answers(ask, due.whole):
            for cut in same:
                del self.cuts[cut]
            logger.warning("link %s: %s is answered again and read in one", self._name, due.whole)
            return True
        for cut in same:
            self.cuts[cut].wait.longer(_LAST_TRIAL)
        return False

    async def _parts(self, request: ReadRequest, ask: Ask, found: list[Cut]) -> bool:
        """Whether any part of a refused request is answered; `found` takes the cuts on the way."""
        cut = cut_of(self._config, request, self._together)
        if cut is None:
            return False
        found.append(cut)
        any_answered = False
        for part in read_plan(self._config, request.names, {cut}, self._together):
            if await _answers(ask, part.span):
                any_answered = True
            else:
                any_answered |= await self._parts(part, ask, found)
        return any_answered


async def _answers(ask: Ask, span: Span) -> bool:
    try:
        await ask(span)
    except LinkProtocolError:
        return False
    return True


def groups_of(sets: Iterable[frozenset[str]]) -> Together:
    """Sets with channels in common made one."""
    joined: list[frozenset[str]] = []
    for members in sets:
        apart = [other for other in joined if not other & members]
        joined = [*apart, members.union(*(other for other in joined if other & members))]
    return tuple(joined)
