"""Standard uncertainties of the rows: stated, from repeats, or from the residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.noise import KINDS, noise_floor
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

_FIRST = {
    Kind.DISPLACEMENT: 1e-3,
    Kind.ROTATION: 1e-6,
    Kind.DISTANCE: 1e-3,
    Kind.BASE_DISTANCE: 1e-3,
}
"""mm or rad: where nothing is known yet, µm and µrad weigh alike."""
_ENOUGH = 10.0
"""With fewer degrees of freedom repeats say too little about the noise to weigh by it."""


def _name(kind: Kind) -> str:
    return next(name for name, kinds in KINDS.items() if kind in kinds)


@dataclass(frozen=True)
class Uncertainty:
    """The standard uncertainties of all rows, mm or rad, and where they come from.

    Attributes
    ----------
    sd
        Shape (n,), mm or rad, all positive.
    source
        Kind → ``stated``, ``replicates`` or ``residuals``, for kinds that occur.
    unknown
        Shape (n,): rows whose uncertainty is estimated from what the fit leaves over.
    """

    sd: F64
    source: dict[Kind, str]
    unknown: NDArray[np.bool_]

    @classmethod
    def of(cls, campaign: Campaign, machine: Machine) -> Uncertainty:
        """The uncertainties that a campaign states, or that its repeated measurements give.

        Where neither does, the rows begin at 1 µm, 1 µrad, to be `updated`.
        """
        stated = np.isfinite(campaign.sd)
        sd = campaign.sd.copy()
        source = {}
        floor = None if stated.all() else noise_floor(campaign, machine)
        for value in np.unique(campaign.kind):
            kind = Kind(value)
            missing = (campaign.kind == value) & ~stated
            source[kind] = "stated"
            if floor is not None and missing.any():
                level = floor.levels[_name(kind)]
                known = level.value is not None and level.degrees_of_freedom >= _ENOUGH
                sd[missing] = level.value if known else _FIRST[kind]
                source[kind] = "replicates" if known else "residuals"
        return cls(sd, source, ~stated)

    @property
    def open(self) -> bool:
        """Whether any uncertainty is still to be estimated from residuals."""
        return "residuals" in self.source.values()

    def without(self, sd: F64) -> Uncertainty:
        """The uncertainties with some rows set aside: `sd` (n,) is infinite there."""
        return Uncertainty(sd, self.source, self.unknown & np.isfinite(sd))

    def updated(self, campaign: Campaign, residual: F64, leverage: F64) -> Uncertainty:
        """Unknown uncertainties from residuals (n,) mm or rad and leverages (n,), kind by kind."""
        sd = self.sd.copy()
        for kind, source in self.source.items():
            rows = (campaign.kind == kind) & self.unknown
            if source != "residuals" or not rows.any():
                continue
            freedom = float((1.0 - leverage[rows]).sum())
            if freedom > 0.5:
                spread = float(np.sqrt((residual[rows] ** 2).sum() / freedom))
                if spread > 0.0:
                    sd[rows] = spread
        return Uncertainty(sd, self.source, self.unknown)
