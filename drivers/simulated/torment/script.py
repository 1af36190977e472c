"""The script: what goes wrong when, the same for the same seed."""

from __future__ import annotations

import random
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from abbe.drivers.simulated.torment.kinds import KINDS, LAST, TormentKind

CALM = (0.3, 1.0, 3.5)
"""s without any torment, one of these after each."""


class Torment(NamedTuple):
    """One torment: from `begin` to `end` (s after the script's beginning), so strong."""

    kind: str
    begin: float
    end: float
    amount: float

    def __str__(self) -> str:
        return f"{self.begin:8.2f} … {self.end:7.2f} s  {self.kind} {self.amount:.3g}"


_NONE: tuple[list[float], list[Torment]] = ([], [])


class Script:
    """Torments one after the other, with calm between; some overlap.

    Parameters
    ----------
    seed
        The same seed, protocol, kinds and length make the same script.
    kinds
        Those that may occur.
    seconds
        The last torment is over 3 s before.
    known
        What the kinds are.
    calm
        s from the end of a torment to the next, one of these each time.
    """

    def __init__(
        self,
        seed: str,
        kinds: Sequence[str],
        seconds: float,
        known: Mapping[str, TormentKind] = KINDS,
        calm: Sequence[float] = CALM,
    ) -> None:
        torments = _made(random.Random(seed), kinds, seconds - 3.0, known, calm)
        self.torments = tuple(sorted(torments, key=lambda torment: torment.begin))
        self._begins = [t.begin for t in self.torments]
        self._begin = float("inf")
        self._by_kind = {
            kind: ([t.begin for t in those], those)
            for kind in kinds
            if (those := [t for t in self.torments if t.kind == kind])
        }

    def start(self, now: float) -> None:
        """The script begins at this monotonic time, s."""
        self._begin = now

    @property
    def begun(self) -> bool:
        """Whether it has begun."""
        return self._begin < float("inf")

    def elapsed(self, time: float) -> float:
        """Script time of a monotonic time, s; before the beginning negative."""
        return time - self._begin if self.begun else -1.0

    def active(self, kind: str, now: float) -> Torment | None:
        """The torment of this kind that goes on at a monotonic time."""
        elapsed = self.elapsed(now)
        begins, torments = self._by_kind.get(kind, _NONE)
        at = bisect_right(begins, elapsed) - 1
        return torments[at] if at >= 0 and elapsed < torments[at].end else None

    def around(self, time: float, before: float = 4.0) -> list[Torment]:
        """What went on at a monotonic time, or had within `before` s."""
        elapsed = self.elapsed(time)
        last = bisect_right(self._begins, elapsed)
        near = self.torments[max(0, last - 30) : last]  # none is longer than its 30 followers
        return [t for t in near if t.end >= elapsed - before]


def _made(
    chance: random.Random,
    kinds: Sequence[str],
    seconds: float,
    known: Mapping[str, TormentKind],
    calm: Sequence[float],
) -> Iterator[Torment]:
    if not kinds:
        return
    time = 1.0
    made: list[Torment] = []
    waiting: list[str] = []
    last = [name for name in kinds if name in LAST]
    often = [name for name in kinds if name not in LAST]
    if last:
        name = chance.choice(last)
        seconds -= known[name].seconds[1] + 1.0
        yield Torment(name, seconds + 1.0, seconds + 1.0 + known[name].seconds[1], 0.0)
    while often:
        if not waiting:
            waiting = list(often)
            chance.shuffle(waiting)
        name = waiting.pop()
        kind = known[name]
        length = chance.uniform(*kind.seconds) ** 2 / kind.seconds[1]  # short ones more often
        length = max(kind.seconds[0], length)
        torment = Torment(name, time, time + length, chance.uniform(*kind.amount))
        if torment.end > seconds:
            break
        made.append(torment)
        if chance.random() < 0.2:
            time += chance.uniform(0.0, length)
        else:
            time = max(t.end for t in made) + chance.choice(calm)
    yield from made
