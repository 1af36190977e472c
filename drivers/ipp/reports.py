"""Positions that an I++ DME server reports by itself, after ``OnMoveReportE``."""

from __future__ import annotations

import asyncio
import time

from abbe.drivers.ipp.config import MoveReportConfig
from abbe.drivers.ipp.grammar import parse
from abbe.drivers.ipp.question import IppQuestion
from abbe.drivers.link import LinkDownError, LinkProtocolError, Quality, Sample

_NAN = float("nan")
_LAST_EVENT = 9999


class MoveReport:
    """The stream of reports: how it is ordered, and the last position of each channel.

    Parameters
    ----------
    config
        How often.
    get
        The ``Get`` for the same axes.

    Attributes
    ----------
    question
        The command that orders it; it is due while the stream is not `ordered`.
    tag
        Of the reports. Each connection has another, so that nothing of an earlier one is taken.
    ordered
        Whether the server took the order.
    first
        Done when the first report came.
    """

    def __init__(self, config: MoveReportConfig, get: IppQuestion) -> None:
        axes = tuple(dict.fromkeys(f"{field.name}()" for field in get.fields.values()))
        pace = (f"Time({config.time:g})", f"Dis({config.distance:g})")
        self.question = IppQuestion("OnMoveReportE", (*pace, *axes), 0.0, get.fields, vital=True)
        self.wait_limit = config.wait_limit
        self.tag = "E0000"
        self.ordered = False
        self.first: asyncio.Future[None] | None = None
        self._number = 0
        self._came = 0.0
        self._last: dict[str, Sample] = {}

    def renew(self) -> None:
        """A new connection: nothing came yet, and nothing is ordered."""
        self._number = self._number % _LAST_EVENT + 1
        self.tag = f"E{self._number:04d}"
        self.ordered = False
        self.first = asyncio.get_running_loop().create_future()
        self._came = time.monotonic()
        self._last.clear()

    def order_taken(self) -> None:
        """The server took the order: from now on reports can be missing."""
        self.ordered = True
        self._came = max(self._came, time.monotonic())

    def take(self, text: str, since: float) -> bool:
        """Keep a report; False when it was not understood.

        Parameters
        ----------
        text
            Of the report.
        since
            Monotonic time in s before which the server did not send it.
        """
        good = True
        try:
            answer = self.question.named(parse(text))
        except LinkProtocolError as error:
            bad = Sample(_NAN, since, Quality.BAD, f"report: {error}")
            self._last = dict.fromkeys(self.question.fields, bad)
            return False
        for channel, field in self.question.fields.items():
            try:
                self._last[channel] = Sample(field.value(answer), since)
            except LinkProtocolError as error:
                self._last[channel] = Sample(_NAN, since, Quality.BAD, f"report: {error}")
                good = False
        self._came = time.monotonic()
        if self.first is not None and not self.first.done():
            self.first.set_result(None)
        return good

    def give_up(self, why: str) -> None:
        """The connection is lost: nobody need wait for a first report."""
        if self.first is not None and not self.first.done():
            self.first.set_exception(LinkDownError(why))
            # so that asyncio does not complain where nobody waits
            self.first.exception()

    def silence(self, now: float) -> str:
        """For how long no report has come, for people; empty when it is not too long."""
        if not self.ordered or now - self._came <= self.wait_limit:
            return ""
        return f"no move report for {now - self._came:.1f} s"

    def sample(self, channel: str, now: float) -> Sample:
        """The last value of a channel; it was sent after the time that it has."""
        last = self._last.get(channel)
        if why := self.silence(now):
            return Sample(_NAN, now, Quality.UNAVAILABLE, why)
        if last is None:
            return Sample(_NAN, now, Quality.UNAVAILABLE, "no move report yet")
        return last
