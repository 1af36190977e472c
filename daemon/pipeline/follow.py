"""Reading what is written: a position that follows our own writes is not a position.

Where the register of a corrected position is also that of the indicated one, each cycle corrects
what the last one wrote, and the position walks away while the machine stands. The configuration is
checked for that (`daemon.config.outputs`); a device that keeps both in one memory without anybody
knowing shows it only here. An axis that comes back exactly as it was written, some times in a row,
is no longer written: when it then stays where it was written last, it is our own.

An axis that happens to move by just its correction from one cycle to the next looks alike for some
cycles, and then does not stay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

_ALIKE = 3
"""Cycles in a row in which a position is what was written, until it is no longer written."""
_STAYS = 4
"""Further cycles in which it stays, until it is a fault."""


class _Axis:
    __slots__ = ("alike", "fault", "stays", "written")

    def __init__(self) -> None:
        self.written = math.nan
        self.alike = self.stays = 0
        self.fault = False


class Follow:
    """Watches for positions that follow what is written.

    Parameters
    ----------
    steps
        For each axis that is written, half the step of its position and of what is written, mm:
        what differs by less is the same.
    """

    def __init__(self, steps: Sequence[float]) -> None:
        self._steps = tuple(steps)
        self._axes = tuple(_Axis() for _ in steps)

    def doubts(self, indicated: Sequence[float]) -> list[int]:
        """Which axes are not to be written in this cycle, by place.

        Parameters
        ----------
        indicated
            Positions of the axes that are written, mm; NaN where not to be believed.
        """
        found = []
        for i, (axis, position) in enumerate(zip(self._axes, indicated, strict=True)):
            if axis.fault:
                found.append(i)
                continue
            if position != position or axis.written != axis.written:
                continue
            same = abs(position - axis.written) <= self._steps[i]
            if not same:
                axis.alike = axis.stays = 0
            elif axis.alike < _ALIKE:
                axis.alike += 1
            else:
                axis.stays += 1
                axis.fault = axis.stays > _STAYS
            if axis.alike >= _ALIKE:
                found.append(i)
        return found

    def faults(self) -> list[int]:
        """Axes whose position is what Abbe wrote, by place; for good."""
        return [i for i, axis in enumerate(self._axes) if axis.fault]

    def wrote(self, place: int, position: float, corrected: float) -> None:
        """Take note of what was written for an axis whose position was `position`, mm."""
        axis = self._axes[place]
        # where nothing is corrected, what is written says nothing
        far = abs(corrected - position) > 2.0 * self._steps[place]
        axis.written = corrected if far else math.nan
        if not far:
            axis.alike = axis.stays = 0
