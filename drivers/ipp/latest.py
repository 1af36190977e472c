"""The last answer to each question to an I++ DME server, as samples of its channels."""

from __future__ import annotations

import time

from abbe.drivers.ipp.question import IppQuestion
from abbe.drivers.ipp.session import CommandReply
from abbe.drivers.link import LinkProtocolError, Quality, Sample

_NAN = float("nan")


class Latest:
    """Channel → its last sample."""

    def __init__(self) -> None:
        self._last: dict[str, Sample] = {}

    def clear(self) -> None:
        """Forget everything."""
        self._last.clear()

    def keep(self, question: IppQuestion, reply: CommandReply) -> None:
        """Take an answer; a channel whose number it does not have becomes bad.

        Raises
        ------
        LinkProtocolError
            When the answer as a whole is not of the form that is expected.
        """
        answer, asked_at, good = question.named(reply.data), reply.asked_at, True
        said = "".join(f" ({warning})" for warning in reply.warnings)
        for channel, field in question.fields.items():
            try:
                self._last[channel] = Sample(field.value(answer), asked_at)
            except LinkProtocolError as error:
                why = f"{question.name}: {error}{said}"
                self._last[channel] = Sample(_NAN, asked_at, Quality.BAD, why)
                good = False
        question.pace.asked(asked_at, good=good)

    def mark(self, question: IppQuestion, quality: Quality, why: str) -> None:
        """Take note that all channels of a question have no value."""
        now = time.monotonic()
        question.pace.asked(now, good=False)
        self._last |= dict.fromkeys(question.fields, Sample(_NAN, now, quality, why))

    def is_due(self, question: IppQuestion, name: str, now: float) -> bool:
        """Whether a channel's question is to be asked at `now` (monotonic, s)."""
        last = self._last.get(name)
        return (
            last is None
            or question.failures > 0
            or last.quality is Quality.UNAVAILABLE
            or question.pace.is_due(now)
        )

    def sample(self, question: IppQuestion, name: str, now: float) -> Sample:
        """A channel's last sample."""
        missing = Sample(_NAN, now, Quality.UNAVAILABLE, f"{question.name}: not answered yet")
        return self._last.get(name, missing)
