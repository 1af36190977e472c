"""How a fit foretells blocks of its campaign that are left out of it, each in its turn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Kind
from abbe.compcore.diagnosis.screening.left_out.blocks import Blocks, passes
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import LeftOut
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.linalg import threads_for


@dataclass(frozen=True, eq=False)
class LeftOutErrors:
    """How a fit predicts the blocks of its campaign that were left out, each in its turn.

    Attributes
    ----------
    left
        What the fit without each block leaves of it, in mm or rad.
    lengths, rotations
        Root mean squares, mm and rad; NaN without such rows.
    """

    left: LeftOut
    lengths: float
    rotations: float

    @classmethod
    def of(
        cls,
        result: FitResult,
        judged: Sequence[Effect] | None = None,
        *,
        along: Sequence[str] = (),
        rows: Sequence[NDArray[np.int64]] = (),
    ) -> LeftOutErrors:
        """Leave out every block of a fit; exact for what is linear, non-linear values kept.

        Parameters
        ----------
        result
            The fit.
        judged
            The effects that the blocks must be narrow enough for; default all of the model's.
        along
            Axes of whose passes each is to be left out, where there are several (`passes`).
        rows
            The blocks, where they are known.
        """
        thin = result.as_weighed.thin
        campaign = thin.problem.campaign
        effects = thin.model.effects if judged is None else judged
        conditions = campaign.conditions
        of_passes = (conditions.kept(("passes", a), partial(passes, conditions, a)) for a in along)
        blocks = rows or next(filter(None, of_passes), [])
        blocks = blocks or Blocks.of(conditions, thin.model.machine).for_effects(effects)
        with threads_for(thin.problem.n * thin.problem.layout.size):
            left = LeftOut.of(_basis(thin), blocks)
        used = thin.problem.weight > 0.0
        sd = np.where(used, thin.problem.sd, 0.0)
        left = replace(left, residual=left.residual * sd)

        def rms(*kinds: Kind) -> float:
            rows = np.isin(campaign.kind, kinds) & used
            return float(np.sqrt(np.mean(left.residual[rows] ** 2))) if rows.any() else math.nan

        return cls(left, rms(*LENGTHS), rms(Kind.ROTATION))

    @classmethod
    def beside(
        cls, one: FitResult, other: FitResult, changed: Sequence[Effect]
    ) -> tuple[LeftOutErrors, LeftOutErrors]:
        """How two fits to the same rows, with and without some effects, predict the same blocks."""
        found = cls.of(one, changed), cls.of(other, changed)
        thin = one.thin
        blocks = Blocks.of(thin.problem.campaign.conditions, thin.model.machine)
        cut = blocks.cut_for(changed, found[0].left, found[1].left)
        return (cls.of(one, rows=cut), cls.of(other, rows=cut)) if cut else found

    def falls_to(self, fuller: LeftOutErrors, result: FitResult, *, bound: bool) -> float:
        """The part of the left-out χ² that another fit to the same rows leaves.

        Parameters
        ----------
        fuller
            How the other fit predicts.
        result
            That fit, in the uncertainties of which both are judged.
        bound
            Whether what was added belongs to the placing of an instrument (`gain`).
        """
        weight = result.thin.problem.weight
        after = fuller.left.residual if bound else self.left.with_what_it_foretells(fuller.left)
        before = float(np.sum((self.left.residual * weight) ** 2))
        return float(np.sum((after * weight) ** 2)) / before if before > 0.0 else 1.0


@lru_cache(maxsize=2)
def _basis(thin: FitResult) -> Basis:
    """The basis of a fit: of a model as it is, many are asked beside it."""
    return Basis.of(thin)
