"""The last answer to each question to an I++ DME server, as samples of its channels."""

from __future__ import annotations

import time

from drivers.ipp.question import Question
from drivers.ipp.session import Reply
from drivers.link import LinkProtocolError, Quality, Sample

_NAN = float("nan")


class Latest:
    """Channel → its last sample."""

    def __init__(self) -> None:
        self._last: dict[str, Sample] = {}

    def clear(self) -> None:
        """Forget everything."""
        self._last.clear()

    def keep(self, question: Question, reply: Reply) -> None:
        """Take an answer; a channel whose number it does not have becomes bad.

        Raises
        ------
        LinkProtocolError
            When the answer as a whole is not of the form that is expected.
        """
        now = time.monotonic()
        answer = question.named(reply.data)
        said = "".join(f" ({warning})" for warning in reply.warnings)
        for channel, field in question.fields.items():
            try:
                self._last[channel] = Sample(field.value(answer), now)
            except LinkProtocolError as error:
                why = f"{question.name}: {error}{said}"
                self._last[channel] = Sample(_NAN, now, Quality.BAD, why)

    def mark(self, question: Question, quality: Quality, why: str) -> None:
        """Take note that all channels of a question have no value."""
        sample = Sample(_NAN, time.monotonic(), quality, why)
        for name in question.fields:
            self._last[name] = sample

    def is_due(self, question: Question, name: str, now: float) -> bool:
        """Whether a channel's question is to be asked at `now` (monotonic, s)."""
        last = self._last.get(name)
        return (
            last is None
            or question.failures > 0
            or last.quality is Quality.UNAVAILABLE
            or now - last.time >= question.every
        )

    def sample(self, question: Question, name: str, now: float) -> Sample:
        """A channel's last sample."""
        missing = Sample(_NAN, now, Quality.UNAVAILABLE, f"{question.name}: not answered yet")
        return self._last.get(name, missing)
