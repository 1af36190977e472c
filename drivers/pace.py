"""Pace: when something that is asked for every so often is due, sooner after a failure."""

from __future__ import annotations

import math
from dataclasses import dataclass

_FIRST_WAIT = 0.05
"""s between the first two attempts after one that failed; the next one is made at once."""


@dataclass(slots=True)
class Pace:
    """The pace of one question: when it is due.

    A refusal that lasts a moment is to cost a value for that moment, not until it is due again:
    what could not be had is asked for at once, and then after a while that doubles up to `every`.

    Attributes
    ----------
    every
        s between two questions; 0: at every call.
    """

    every: float
    _due_at: float = -math.inf
    _wait: float = 0.0

    def is_due(self, now: float) -> bool:
        """Whether to ask at `now` (monotonic, s)."""
        return now >= self._due_at

    def asked(self, at: float, *, good: bool) -> None:
        """Take note of a question that left at `at`, and whether all that it is for was had."""
        if good:
            self._due_at, self._wait = at + self.every, 0.0
        else:
            self._due_at = at + self._wait
            self._wait = min(self.every, max(2.0 * self._wait, _FIRST_WAIT))

    def clear(self) -> None:
        """Ask at the next call."""
        self._due_at, self._wait = -math.inf, 0.0
