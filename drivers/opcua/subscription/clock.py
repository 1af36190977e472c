"""A server's clock beside ours: how far apart they can be, by questions that it answered."""

from __future__ import annotations

import math
from datetime import datetime

from abbe.compcore.units import in_digits
from abbe.drivers.opcua.subscription.lost import SubscriptionLostError

_DRIFT = 1e-3
"""s per s by which a clock runs fast or slow, or is slewed, unnoticed; more shows as a step."""
_STEP = 0.05
"""s by which a clock may contradict itself: some are renewed every 16 ms only."""


class ServerClock:
    """How far a server's clock is ahead of ours, between two bounds (Cristian).

    An answer with the stamp c was made after its question had left, at a, and before it came, at
    b: the server's clock is ahead by c − b at least and by c − a at most.
    """

    def __init__(self) -> None:
        self._least, self._most = -math.inf, math.inf
        self._looked = -math.inf

    def answered(self, asked_at: float, arrived_at: float, stamp: float) -> None:
        """Take in an answer.

        Parameters
        ----------
        asked_at, arrived_at
            When its question left and when it came, monotonic, s.
        stamp
            When the server says that it made it, `seconds` of its own clock.

        Raises
        ------
        SubscriptionLostError
            When it contradicts what was answered before: the clock was set, or the stamp is not
            that of the answer. Earlier answers count no longer.
        """
        drifted = _DRIFT * max(0.0, arrived_at - self._looked) if self._looked > -math.inf else 0.0
        # it may have been made as soon as its question left: from there on clocks drift
        self._looked = asked_at
        least, most = stamp - arrived_at, stamp - asked_at
        self._least = max(self._least - drifted, least)
        self._most = min(self._most + drifted, most)
        step = self._least - self._most
        if step > _STEP:
            self._least, self._most = least, most
            raise SubscriptionLostError(
                f"the server's clock was set by {in_digits(step)} s or more, or its answers do not "
                "carry the time at which they are made"
            )

    def earliest(self, stamp: float) -> float:
        """The earliest moment (monotonic, s) at which the server's clock can have shown `stamp`."""
        return stamp - self._most


def seconds(stamp: datetime) -> float:
    """A server's time stamp as a number, s, for differences only."""
    return (stamp - datetime(2000, 1, 1, tzinfo=stamp.tzinfo)).total_seconds()
