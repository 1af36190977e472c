"""The choice of set-ups: the mean variance in the volume falls most per hour (I-optimal).

Greedy first, once by the fall of the variance and once by that of its logarithm; then every chosen
set-up is exchanged for whatever makes more of its time, until nothing does. What the others have
made superfluous is left out in the end: a plan may be shorter than the time there is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.planning.knowledge import VolumeError
from abbe.compcore.planning.planned_setup import PlannedSetup

F64 = NDArray[np.float64]

RUNS = (1, 2, 4)
"""How often a set-up's targets may be visited each way; the last also of all its placings."""
_PASSES = 3
_WORTH = 1e-3
"""Part of the variance by which an exchange must be better, and a set-up must do in the end."""
_LEAST = 1e-4
"""Part of the variance that a set-up must take away."""


class Knowledge:
    """What is known with some set-ups: precision and covariance of the scaled unknowns.

    Attributes
    ----------
    variance
        Mean square of the error that is left over the volume, mm².
    """

    def __init__(self, precision: F64, volume: VolumeError) -> None:
        self.precision = precision
        self.covariance = inverse(precision)
        self.volume = volume
        self.variance = volume.mean(self.covariance) ** 2

    @classmethod
    def beforehand(cls, covariance: F64, volume: VolumeError) -> Knowledge:
        """What is known before any set-up (`knowledge.prior`)."""
        return cls(inverse(covariance), volume)

    def with_(self, root: F64, runs: int = 1) -> Knowledge:
        """With some runs of a set-up more; `root` as of `knowledge.added`."""
        return Knowledge(self.precision + runs * (root.T @ root), self.volume)

    def without(self, root: F64, runs: int) -> Knowledge:
        """Without those that it has."""
        return Knowledge(self.precision - runs * (root.T @ root), self.volume)


class Candidates:
    """Set-ups that may be chosen, each with several numbers of runs.

    Attributes
    ----------
    setups, roots
        The set-ups, and what one run of each adds.
    runs
        How often the targets of each may be visited.
    index
        Of each candidate: the set-up's number, how many runs.
    seconds
        Shape (c,).
    """

    def __init__(
        self,
        setups: Sequence[PlannedSetup],
        roots: Sequence[F64],
        runs: Sequence[int] = RUNS,
    ) -> None:
        self.setups = tuple(setups)
        self.roots = tuple(roots)
        self.runs = tuple(runs)
        ends = np.cumsum([len(r) for r in roots])
        self._rows = [slice(e - len(r), e) for e, r in zip(ends.tolist(), roots, strict=True)]
        self._stacked = np.vstack(roots) if roots else np.zeros((0, 0))
        self.index = [(i, n) for i in range(len(setups)) for n in self.runs]
        self.seconds = np.array([replace(setups[i], runs=n).seconds for i, n in self.index])

    def falls(self, known: Knowledge) -> F64:
        """By how much each candidate would make the mean variance fall, (c,), mm²."""
        half = self._stacked @ known.covariance
        weighed = half @ known.volume.weight
        runs = np.array(self.runs)[:, None]
        found = []
        for root, rows in zip(self.roots, self._rows, strict=True):
            mine = half[rows]
            inner, turned = np.linalg.eigh(mine @ root.T)
            inner = np.maximum(inner, 0.0)
            felt = np.einsum("ik,ik->k", turned, (weighed[rows] @ mine.T) @ turned)
            found.append((runs * felt / (1.0 + runs * inner)).sum(axis=1))
        return np.concatenate(found) if found else np.zeros(0)

    def open(self, chosen: Sequence[Chosen], seconds: float) -> NDArray[np.bool_]:
        """Which candidates a time allows, and are not read often enough by those chosen, (c,).

        What more readings in one place would average away is less than what all of them share.
        """
        runs = {id(c.root): 0 for c in chosen}
        for one in chosen:
            runs[id(one.root)] += one.setup.runs
        most = max(self.runs)
        room = [runs.get(id(self.roots[i]), 0) + n <= most for i, n in self.index]
        return np.asarray(room, dtype=np.bool_) & (self.seconds <= seconds)

    def chosen(self, number: int) -> Chosen:
        """One of them."""
        i, runs = self.index[number]
        return Chosen(replace(self.setups[i], runs=runs), self.roots[i])


@dataclass(frozen=True, eq=False)
class Chosen:
    """A set-up of a plan, and what one run of it adds."""

    setup: PlannedSetup
    root: F64


def inverse(precision: F64) -> F64:
    """The inverse of a positive definite matrix, symmetric."""
    size = 1.0 / np.sqrt(np.diag(precision))
    half = np.linalg.inv(np.linalg.cholesky(precision * np.outer(size, size)))
    found = (half.T @ half) * np.outer(size, size)
    return np.asarray(0.5 * (found + found.T))


def choose(
    candidates: Candidates,
    start: Knowledge,
    seconds: float,
    *,
    required: Sequence[Chosen] = (),
    progress: Callable[[str], None] | None = None,
) -> list[Chosen]:
    """The set-ups that make the machine surest within a time.

    Parameters
    ----------
    start
        What is known beforehand.
    seconds
        The time there is.
    required
        Set-ups that are in the plan in any case; their time counts.
    """
    tell = progress or (lambda _: None)
    for one in required:
        start, seconds = start.with_(one.root, one.setup.runs), seconds - one.setup.seconds
    best: tuple[float, list[Chosen]] = (start.variance, [])
    for logarithmic in (False, True):
        tell("choosing set-ups")
        chosen, known = _greedy(candidates, [], start, seconds, logarithmic)
        tell("exchanging set-ups")
        chosen, known = _exchanged(candidates, chosen, known, seconds)
        chosen, known = _worth_their_time(chosen, known)
        if known.variance < best[0]:
            best = (known.variance, chosen)
    return [*required, *best[1]]


def _greedy(
    candidates: Candidates,
    chosen: Sequence[Chosen],
    known: Knowledge,
    seconds: float,
    logarithmic: bool,
) -> tuple[list[Chosen], Knowledge]:
    """Set-ups more, beside those chosen, and what is then known."""
    more: list[Chosen] = []
    while (allowed := candidates.open([*chosen, *more], seconds)).any():
        falls = np.minimum(candidates.falls(known), known.variance * (1.0 - 1e-12))
        falls[~allowed] = 0.0
        if falls.max() <= _LEAST * known.variance:
            break
        gain = -np.log1p(-falls / known.variance) if logarithmic else falls
        best = candidates.chosen(int(np.argmax(gain / candidates.seconds)))
        more.append(best)
        known = known.with_(best.root, best.setup.runs)
        seconds -= best.setup.seconds
    return more, known


def _exchanged(
    candidates: Candidates, chosen: list[Chosen], known: Knowledge, seconds: float
) -> tuple[list[Chosen], Knowledge]:
    for _ in range(_PASSES):
        better = False
        for i, old in enumerate(chosen):
            others = [c for j, c in enumerate(chosen) if j != i]
            free = seconds - sum(c.setup.seconds for c in others)
            without = known.without(old.root, old.setup.runs)
            falls = np.where(candidates.open(others, free), candidates.falls(without), 0.0)
            best = int(np.argmax(falls))
            if without.variance - falls[best] < known.variance * (1.0 - _WORTH):
                chosen[i] = candidates.chosen(best)
                known = without.with_(chosen[i].root, chosen[i].setup.runs)
                better = True
        chosen = _in_one_placing(chosen)
        left = seconds - sum(c.setup.seconds for c in chosen)
        more, known = _greedy(candidates, chosen, known, left, False)
        chosen += more
        if not better and not more:
            break
    return _in_one_placing(chosen), known


def _worth_their_time(chosen: Sequence[Chosen], known: Knowledge) -> tuple[list[Chosen], Knowledge]:
    """Without set-ups that take hardly anything away beside the others, the idlest first."""
    kept = list(chosen)
    while len(kept) > 1:
        without = [known.without(one.root, one.setup.runs) for one in kept]
        idlest = min(range(len(kept)), key=lambda i: without[i].variance)
        if without[idlest].variance * (1.0 - _WORTH) >= known.variance:
            break
        known = without[idlest]
        del kept[idlest]
    return kept, known


def _in_one_placing(chosen: Sequence[Chosen]) -> list[Chosen]:
    """A set-up that was chosen again, once with all its runs: it tells the same sooner."""
    found: dict[int, Chosen] = {}
    for one in chosen:
        known = found.get(id(one.root))
        runs = one.setup.runs + (0 if known is None else known.setup.runs)
        found[id(one.root)] = replace(one, setup=replace(one.setup, runs=runs))
    return list(found.values())
