"""What if: one cause with any values of its parameters, and what would be left of the residuals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.parameters import Estimate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.effects.base import Effect

F64 = NDArray[np.float64]

Columns = Callable[[Mapping[str, float]], F64]


@dataclass(frozen=True, eq=False)
class WhatIf:
    """One cause beside a fitted model, to be tried by hand.

    The rest of the model and the placing of the instruments are fitted again to whatever is tried
    (to first order): with C the cause's weighted columns and v its values, ``r − C⊥ v`` is left, as
    in `screening`. At the values that the data say it is what a refit leaves.

    Attributes
    ----------
    effect
        The cause.
    best
        Its parameters as they would be fitted, linear ones first.
    columns
        Non-linear parameters → weighted columns (n, k).
    basis
        What the model explains, and what it leaves.
    weight
        Shape (n,): 1/sd of each row.
    """

    effect: Effect
    best: tuple[Estimate, ...]
    columns: Columns = field(repr=False)
    basis: Basis = field(repr=False)
    weight: F64 = field(repr=False)
    linear: int = 0
    _seen: dict[tuple[tuple[str, float], ...], F64] = field(default_factory=dict, repr=False)

    def _projected(self, nonlinear: Mapping[str, float]) -> F64:
        key = tuple(sorted(nonlinear.items()))
        if key not in self._seen:
            # a slider that rests, or goes back, costs nothing; no more than one choice is kept
            self._seen.clear()
            self._seen[key] = self.basis.project(self.columns(nonlinear))
        return self._seen[key]

    def left(self, values: Mapping[str, float]) -> F64:
        """What would be left of each row, (n,), mm or rad; NaN where a row is not used.

        Parameters
        ----------
        values
            Of all parameters by name, in the units inside the code.
        """
        names = [e.name for e in self.best]
        coefficients = np.array([values[name] for name in names[: self.linear]])
        nonlinear = {name: values[name] for name in names[self.linear :]}
        weighted = self.basis.residual - self._projected(nonlinear) @ coefficients
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(self.weight > 0.0, weighted / self.weight, np.nan))
