"""A run as the service manager sees it: ready with the first cycle, alive with each one."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

from abbe.daemon.pipeline.headline import headline
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.status_word import Status
from abbe.daemon.systemd.notify import Notifier

logger = logging.getLogger("abbe.systemd")

EVERY = 2.0
"""s between two looks at the words of the status."""
_SHARE = 0.25
"""Part of the watchdog's time after which it is fed."""
_MILLI = 1e3


class Supervised:
    """A listener of the pipeline: tells the manager what the cycle does.

    Only a cycle that came to its end feeds the watchdog: one that hangs is ended and started anew
    by the manager, whatever else of the process still lives.

    Parameters
    ----------
    notifier
        The manager.
    axes
        Those whose corrected positions are written back; empty: nothing is.
    period
        Of the cycle, s.
    """

    def __init__(
        self,
        notifier: Notifier,
        axes: Sequence[str],
        period: float,
    ) -> None:
        self._notifier = notifier
        self._axes = axes
        self._feed_every = notifier.watchdog * _SHARE if notifier.watchdog else math.inf
        self._feed_at = self._words_at = -math.inf
        self._words = ""
        self._ready = self._stopping = False
        if notifier.watchdog and period > notifier.watchdog / 2:
            logger.warning(
                "the watchdog waits %g s, and a cycle takes %g s: set WatchdogSec to more than "
                "twice the period",
                notifier.watchdog,
                period,
            )

    def __call__(self, record: CycleRecord) -> None:
        """Take note of a cycle that came to its end."""
        now = record.time
        if not self._ready:
            self._ready = True
            self._notifier.ready()
        if now >= self._feed_at:
            self._feed_at = now + self._feed_every
            self._notifier.alive()
        if record.status & Status.ENDING and not self._stopping:
            self._stopping = True
            self._notifier.stopping()
        if now >= self._words_at:
            self._words_at = now + EVERY
            words = self.words(record)
            if words != self._words:
                self._words = words
                self._notifier.status(words)

    def words(self, record: CycleRecord) -> str:
        """The state of the machine's correction in one line."""
        state = headline(record)
        count = len(self._axes)
        parts = [state, f"{count} {'axis' if count == 1 else 'axes'}"] if count else [state]
        parts.append(f"cycle {record.duration * _MILLI:.1f} ms")
        if record.faults:
            first, why = next(iter(record.faults.items()))
            more = f", and {len(record.faults) - 1} more" if len(record.faults) > 1 else ""
            parts.append(f"{first}: {why}{more}")
        return "; ".join(parts)
