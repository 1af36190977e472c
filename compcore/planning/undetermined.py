"""What a plan leaves undetermined: combinations of unknowns that its rows do not feel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.linalg import svd
from abbe.compcore.planning.choice import Knowledge
from abbe.compcore.planning.knowledge import unknowns
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.sentences import said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_FELT = 1e-4
"""mm in the volume below which nobody misses a combination."""
_MOST = 6
_SHARE = 0.15
"""Part of a combination from which an effect is named."""


@dataclass(frozen=True, slots=True)
class Undecided:
    """A combination of unknowns that stays as it was believed.

    Attributes
    ----------
    effects
        The effects that take part, those with most of it first.
    size
        What a believable amount of it does over the volume, root of the mean square, mm.
    """

    effects: tuple[str, ...]
    size: float

    def __str__(self) -> str:
        what: str = self.effects[0]
        for other in self.effects[1:]:
            what = said("{one} with {other}", one=what, other=other)
        size = f"{in_digits(self.size * 1e3)} µm"
        return said("{what}: {size} over the volume", what=what, size=size)


def undecided(task: SurveyTask, known: Knowledge, start: Knowledge) -> Iterator[Undecided]:
    """Combinations that the rows say less of than was known before, largest in the volume first."""
    gained = known.precision - start.precision
    half = np.linalg.cholesky(start.covariance)
    values, vectors = np.linalg.eigh(half.T @ gained @ half)
    left = half @ vectors[:, values < 1.0]
    if not left.shape[1]:
        return
    felt = known.volume.field @ left
    _, size, turned = svd(felt)
    points = max(len(felt) // 3, 1)
    owner = unknowns(task.model)
    for k in range(min(_MOST, len(size))):
        amount = float(size[k] / np.sqrt(points))
        if amount < _FELT:
            return
        share = (left @ turned[k]) ** 2
        parts = np.bincount(owner, share, minlength=len(task.model.effects))
        order = [int(i) for i in np.argsort(-parts)]
        # of many that take part alike none has much
        most = [i for i in order if parts[i] > _SHARE * parts.sum()] or order
        names = tuple(task.model.effects[i].spec for i in most[:3])
        yield Undecided(names, amount)
