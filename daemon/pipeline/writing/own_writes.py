"""Own writes that come back: a position that follows what is written is not a position.

Where the register of a corrected position is also that of the indicated one, each cycle corrects
what the last one wrote, and the position walks away while the machine stands. The configuration is
checked for that (`abbe.daemon.config.outputs`); a device that keeps both in one memory without
anybody
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


class Follow:
    """The check for positions that follow what is written.

    Parameters
    ----------
    steps
        For each axis that is written, what its position and what is written may differ by and still
        be the same, mm.
    """

    def __init__(self, steps: Sequence[float]) -> None:
        self._steps = tuple(steps)
        self._indicated: Sequence[float] = [math.nan] * len(self._steps)
        self._written: Sequence[float] = self._indicated
        self._alike = [0] * len(self._steps)
        self._any = False

    def doubts(self, indicated: Sequence[float]) -> list[int]:
        """Which axes are not to be written in this cycle, by place.

        Parameters
        ----------
        indicated
            Positions of the axes that are written, mm; NaN where not to be believed.
        """
        near = False
        for position, written, step in zip(indicated, self._written, self._steps, strict=True):
            if -step <= position - written <= step:
                near = True
        if not (near or self._any):
            return []
        return [i for i, position in enumerate(indicated) if self._doubted(i, position)]

    def _doubted(self, place: int, position: float) -> bool:
        """Whether one axis is not to be written."""
        alike, step = self._alike[place], self._steps[place]
        way = position - self._written[place]
        # where nothing is corrected, what is written says nothing
        corrected = abs(self._written[place] - self._indicated[place]) > 2.0 * step
        if alike <= _ALIKE + _STAYS and way == way:
            alike = alike + 1 if abs(way) <= step and corrected else 0
            self._alike[place] = alike
            self._any = any(self._alike)
        return alike >= _ALIKE

    def faults(self) -> list[int]:
        """Axes whose position is what Abbe wrote, by place; for good."""
        return [i for i, alike in enumerate(self._alike) if alike > _ALIKE + _STAYS]

    def wrote(self, indicated: Sequence[float], written: Sequence[float], kept: int = 0) -> None:
        """Take note of what was written, mm, and at which positions; neither is changed later.

        What is NaN was not written, nor what is in the mask `kept`: there, the last one counts.
        """
        if kept or math.isnan(sum(written)):
            rows = zip(indicated, written, self._indicated, self._written, strict=True)
            chosen = [
                (was, before) if kept >> i & 1 or new != new else (at, new)
                for i, (at, new, was, before) in enumerate(rows)
            ]
            indicated, written = [at for at, _ in chosen], [new for _, new in chosen]
        self._indicated, self._written = indicated, written
