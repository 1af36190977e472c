"""How fast the machine came to where it stands, as its positions were seen to move."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.structure import is_rotary
from abbe.daemon.config.sections.measure import MeasureSection
from abbe.daemon.measure.late_looks import LateLooks
from abbe.daemon.measure.machine_view import SeenMachine
from abbe.daemon.measure.rows import FEED, FEED_TURN

F64 = NDArray[np.float64]

_PIECE = 0.05
"""s that a piece of a move lasts at least: the moment of a look is unsure by a few ms."""
_TURNS = 0.7
"""Cosine of the angle between pieces from which on the path has turned."""
_FEWEST = 3
"""Pieces of a move whose feed is told: in the first and the last one it starts and stops."""
_MOST = 2000
"""Pieces of a move that are kept, the last ones."""
_DIGITS = 3
"""Digits of a feed that was seen and not commanded."""


class ArrivalFeed:
    """The feed with which linear axes, and rotary ones, moved last.

    The last move is what was seen since the axes stood or their path turned. Its feed is the median
    of the speeds along it, each weighted by its way, so that starting and stopping do not count.
    What was seen for too short a time, or through a look that came late, has none.

    Parameters
    ----------
    limits
        By which positions may vary at rest, and for how long.
    axes
        The machine's axes.
    """

    def __init__(self, limits: MeasureSection, axes: Sequence[str]) -> None:
        linear = [a for a in axes if not is_rotary(a)]
        rotary = [a for a in axes if is_rotary(a)]
        self._looks = LateLooks()
        self._moves = {
            name: _LastMove(own, still, limits.still_for)
            for name, own, still in (
                (FEED, linear, limits.still),
                (FEED_TURN, rotary, limits.still_turn),
            )
            if own
        }

    def look(self, seen: SeenMachine) -> None:
        """Take in one look at the machine."""
        if seen.fault or any(math.isnan(q) for q in seen.positions.values()):
            return
        late = self._looks.late(seen.time)
        for move in self._moves.values():
            move.look(seen, late=late)

    def values(self) -> dict[str, float | None]:
        """Column → feed, mm/min (of rotary axes: degrees per minute); None: not seen."""
        return {name: move.feed() for name, move in self._moves.items()}


class _LastMove:
    def __init__(self, axes: Sequence[str], still: float, still_for: float) -> None:
        self._axes = axes
        self._still, self._still_for = still, still_for
        self._at: F64 | None = None
        self._since = math.nan
        self._stands = True
        self._pieces: deque[tuple[float, float]] = deque(maxlen=_MOST)
        self._ways: deque[F64] = deque(maxlen=2)

    def look(self, seen: SeenMachine, *, late: bool) -> None:
        """Take in where the axes are."""
        at = np.array([self._shown(axis, seen.positions[axis]) for axis in self._axes])
        if self._at is None:
            self._at, self._since = at, seen.time
            return
        way = at - self._at
        moved = float(np.linalg.norm(way))
        took = seen.time - self._since
        if late:
            if moved > self._still:
                self._begin()
            self._at, self._since = at, seen.time
        elif moved > self._still:
            if took >= _PIECE or self._stands:
                self._piece(way, moved, took)
                self._at, self._since = at, seen.time
        elif self._stands:
            self._since = seen.time
        elif took > self._still_for:
            self._at, self._since, self._stands = at, seen.time, True

    @staticmethod
    def _shown(axis: str, position: float) -> float:
        return math.degrees(position) if is_rotary(axis) else position

    def _piece(self, way: F64, moved: float, took: float) -> None:
        unit = way / moved
        if self._stands or any(float(unit @ before) < _TURNS for before in self._ways):
            self._begin()
        self._stands = False
        self._ways.append(unit)
        self._pieces.append((moved, moved / took))

    def _begin(self) -> None:
        self._pieces.clear()
        self._ways.clear()

    def feed(self) -> float | None:
        """The feed of the last move, mm or degrees per minute."""
        if len(self._pieces) < _FEWEST:
            return None
        ways, speeds = np.array(list(self._pieces)[1:-1]).T
        order = np.argsort(speeds)
        middle = int(np.searchsorted(np.cumsum(ways[order]), 0.5 * ways.sum()))
        return float(f"{60.0 * float(speeds[order][middle]):.{_DIGITS}g}")
