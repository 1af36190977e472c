"""Moves that nobody looked at: after them it is not known from which side an axis came."""

from __future__ import annotations

import math
from collections.abc import Sequence

from abbe.daemon.measure.late_looks import LateLooks


class UnseenMoves:
    """Follows looks at a machine and tells which axes moved while nobody looked.

    A program goes beyond a target and comes back, so that the target is met from the stated side.
    A busy computer may look at neither: what it sees then is a move in the other direction. So an
    axis that has moved between two looks that are unusually far apart has no direction until it
    moves again, seen.

    Parameters
    ----------
    deadbands
        For each axis, by how much it has moved when it has, mm (rotary: rad).
    """

    def __init__(self, deadbands: Sequence[float]) -> None:
        self._deadbands = tuple(deadbands)
        self._unseen = [False] * len(self._deadbands)
        self._at = [math.nan] * len(self._deadbands)
        self._looks = LateLooks()

    def step(self, time: float, positions: Sequence[float]) -> list[bool]:
        """For each axis, whether it has come to where it is by a move that nobody looked at.

        Parameters
        ----------
        time
            Monotonic, s.
        positions
            mm (rotary: rad); with a NaN among them, this was no look.
        """
        if any(math.isnan(q) for q in positions):
            return list(self._unseen)
        late = self._looks.late(time)
        for i, (position, deadband) in enumerate(zip(positions, self._deadbands, strict=True)):
            if self._at[i] != self._at[i]:
                self._at[i] = position
            elif abs(position - self._at[i]) > deadband:
                self._unseen[i] = late
                self._at[i] = position
        return list(self._unseen)
