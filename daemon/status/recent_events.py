"""The last events of a run, and how many there were, for those who ask later."""

from __future__ import annotations

import logging
from collections import Counter, deque
from typing import NamedTuple

_KEPT = 20


class RecentEvent(NamedTuple):
    """One event of the journal.

    Attributes
    ----------
    time
        s since 1970.
    level
        Of the standard library's `logging`.
    text
        What was said.
    """

    time: float
    level: int
    text: str


class RecentEvents(logging.Handler):
    """A handler that keeps the last events.

    Attributes
    ----------
    events
        Oldest first.
    counts
        By level's name.
    """

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.events: deque[RecentEvent] = deque(maxlen=_KEPT)
        self.counts: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one event."""
        try:
            text = record.getMessage()
        except Exception:  # noqa: BLE001  (as logging's own handlers: the event is at fault)
            self.handleError(record)
            return
        # a file's name may hold what no UTF-8 can: a status that holds it would be no JSON
        text = text.encode("utf-8", "replace").decode("utf-8")
        self.events.append(RecentEvent(record.created, record.levelno, text))
        self.counts[record.levelname] += 1
