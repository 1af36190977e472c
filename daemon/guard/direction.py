"""One direction of the guard: its state, and its share of the computed correction."""

from __future__ import annotations

import enum
import math

from abbe.daemon.guard.limits import GuardLimits


class GuardState(enum.Enum):
    """The state of the guard in one direction."""

    OFF = "off"
    """No correction: something is missing for longer than hold and ramp, or nothing began yet."""
    RISING = "rising"
    """Sound again; the correction is ramped in."""
    ACTIVE = "active"
    """The computed correction is handed out in full."""
    HOLDING = "holding"
    """Something is missing; the last good correction is held."""
    FALLING = "falling"
    """Missing for longer than the hold time; ramped to zero."""

    # every cycle looks its states up in tables, and an Enum's own hash is that of its name
    __hash__ = object.__hash__


class Direction:
    """One direction's share and, while something is missing, since when."""

    __slots__ = ("fault_since", "share", "share_at_fault", "state")

    def __init__(self) -> None:
        self.state = GuardState.OFF
        self.share = 0.0
        self.share_at_fault = 0.0
        self.fault_since = math.nan

    def sound(self, dt: float, limits: GuardLimits) -> None:
        """Take note that nothing is missing; `dt` in s since the last step."""
        self.fault_since = math.nan
        if self.share < 1.0:
            self.share = min(1.0, self.share + dt / limits.ramp)
        self.state = GuardState.ACTIVE if self.share == 1.0 else GuardState.RISING

    def faulty(self, now: float, hold: float, ramp: float) -> None:
        """Take note that something is missing at `now`: hold for `hold` s, fall in `ramp` s."""
        if self.fault_since != self.fault_since:
            self.fault_since = now
            self.share_at_fault = self.share
        over = now - self.fault_since - hold
        if over > 0.0:
            self.share = max(0.0, min(self.share, self.share_at_fault - over / ramp))
        if self.share == 0.0:
            self.state = GuardState.OFF
        else:
            self.state = GuardState.FALLING if over > 0.0 or hold == 0.0 else GuardState.HOLDING
