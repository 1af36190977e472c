"""Standing faults: each is logged once when it begins and once when it is over."""

from __future__ import annotations

import logging
from collections.abc import Mapping

logger = logging.getLogger("abbe.faults")


class StandingFaults:
    """Compares what is wrong now with what was wrong before, and logs the difference.

    Parameters
    ----------
    linger
        s for which a fault must be gone before it counts as over: one that comes and goes is one
        fault.
    """

    def __init__(self, linger: float = 1.0) -> None:
        self._linger = linger
        self._began: dict[str, float] = {}
        self._seen: dict[str, float] = {}

    def stands(self, what: str) -> bool:
        """Whether a fault has begun and does not count as over yet."""
        return what in self._began

    def update(self, present: Mapping[str, str], now: float) -> None:
        """Take in what is wrong now (what → why) at a monotonic time, s."""
        if not present and not self._began:
            return
        for what, why in present.items():
            if what not in self._began:
                self._began[what] = now
                logger.warning("%s: %s", what, why, extra={"event": "fault began"})
            self._seen[what] = now
        for what in [w for w in self._began if w not in present]:
            if now - self._seen[what] >= self._linger:
                lasted = self._seen.pop(what) - self._began.pop(what)
                logger.info(
                    "%s: sound again after %.1f s", what, lasted, extra={"event": "fault over"}
                )
