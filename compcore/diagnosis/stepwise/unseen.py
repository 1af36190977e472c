"""Campaigns that are never fitted: how models predict them, and which surely worse."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.judging.foretelling import WORTH
from abbe.compcore.diagnosis.screening.left_out.blocks import Blocks
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]

_FEWEST = 3
"""Blocks from which on their scatter says how sure a rise is."""


class Beside(Protocol):
    """A model beside measurements, as `abbe.compcore.comparison.compare` lays it."""

    @property
    def problem(self) -> Problem:
        """The rows and their weights."""

    @property
    def residual(self) -> F64:
        """What the model leaves of each row, mm or rad, (n,)."""


class UnseenCampaign:
    """A campaign that was held out, and how models predict it.

    It chooses nothing. It says where a model predicts it *worse* than another one by as much as a
    cause has to be worth, and surely: the mean rise over its blocks (set-ups, stretches of time,
    places) is larger than the standard error of that mean.
    """

    def __init__(self, campaign: Campaign, compare: Callable[[Model, Campaign], Beside]) -> None:
        self.campaign = campaign
        self._compare = compare
        self._weight: F64 | None = None
        self._last: tuple[Model, F64] | None = None

    def squares(self, model: Model) -> F64:
        """What a model leaves of each row in units of its standard uncertainty, squared, (n,).

        The uncertainties are those beside the first model that was asked for.

        Raises
        ------
        FitError
            As the comparison.
        """
        if self._last is None or self._last[0] is not model:
            compared = self._compare(model, self.campaign)
            if self._weight is None:
                self._weight = compared.problem.weight
            self._last = (model, (compared.residual * self._weight) ** 2)
        return self._last[1]

    def spoilt(self, before: Model, after: Model) -> bool:
        """Whether one model predicts the campaign surely worse than another one."""
        was = self.squares(before)
        rise = self.squares(after) - was
        self._last = (before, was)
        if not float(rise.sum()) > WORTH * float(was.sum()):
            return False
        blocks = Blocks(self.campaign.conditions, before.machine).usual
        each = np.array([float(rise[rows].sum()) for rows in blocks])
        if len(each) < _FEWEST:
            return True
        return float(each.sum()) > math.sqrt(len(each)) * float(each.std(ddof=1))

    def best(self, models: Sequence[Model]) -> int:
        """Which of some models predicts the campaign best."""
        return int(np.argmin([float(self.squares(m).sum()) for m in models]))
