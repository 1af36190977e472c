"""Residuals by approach direction and component: play that a mean would hide.

Residuals of rows that were approached upwards hold, mixed, whatever was measured there: play of Z
shows in rows that measure Z, and in a diagonal with the part that the diagonal has in Z. So each
axis and each component has its own number: by how much the residual in that component is greater
when the axis came from below. They are found together, within set-ups, the strongest first.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.machine.machine import own_component
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.sentences import Sentence, said

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

COMPONENTS = "XYZ"
CERTAIN = 8.0
"""Standard deviations from which a difference is reported; a bad fit shows many small ones."""
_SHARE = 0.05
"""Least part of the residuals' variance that a difference must hold to be reported."""
_SEEN = 1e-3


@dataclass(frozen=True, slots=True)
class SideDifference:
    """What differs in a measured component between the two sides from which an axis came.

    Attributes
    ----------
    axis, component
        Which axis was approached from either side; X, Y or Z as measured.
    difference, sd
        Residual after an approach upwards less that after one downwards, mm.
    share
        Part of the residuals' variance that it holds.
    upright
        The direction that stands upright (`Structure.upright`).
    """

    axis: str
    component: str
    difference: float
    sd: float
    share: float
    upright: str

    @property
    def words(self) -> Sentence:
        """In the shop's words, ISO 230's name in brackets."""
        values = {"sd": f"{self.sd * 1e3:.1f}", "way": "minus" if self.difference > 0.0 else "plus"}
        if self.axis == self.component:
            return said(
                "{axis} stands {size} ± {sd} µm elsewhere, towards {way}, when it comes {side} "
                "(reversal error, ISO 230-1, measured in {component})",
                **self._values(),
                **values,
            )
        return said(
            "{component} is {size} ± {sd} µm elsewhere, towards {way}, when {axis} comes {side} "
            "(reversal error, ISO 230-1, measured in {component})",
            **self._values(),
            **values,
        )

    @property
    def short(self) -> Sentence:
        """The same as a headline."""
        if self.axis == self.component:
            return said("{axis} stands {size} µm elsewhere when it comes {side}", **self._values())
        return said("{component} is {size} µm elsewhere when {axis} comes {side}", **self._values())

    def _values(self) -> dict[str, str]:
        return {
            "axis": self.axis,
            "component": self.component,
            "size": f"{abs(self.difference) * 1e3:.1f}",
            "side": said("from above") if self.axis == self.upright else said("from the plus side"),
        }


def by_side_and_component(
    campaign: Campaign, rows: Mask
) -> Iterator[tuple[Mapping[str, object], Mask]]:
    """Rows by axis, side of approach and measured component; those that occur."""
    component = campaign.measured_components()
    for axis, direction in campaign.conditions.directions.items():
        if not ((direction[rows] > 0).any() and (direction[rows] < 0).any()):
            continue
        for measured in (*COMPONENTS, "oblique"):
            for sign in (1, -1):
                mask = rows & (direction == sign) & (component == measured)
                if mask.any():
                    yield {"axis": axis, "direction": sign, "measured": measured}, mask


def side_differences(
    campaign: Campaign, residual: F64, weight: F64, upright: str
) -> list[SideDifference]:
    """The differences that the residuals of displacements establish, the largest share first.

    Parameters
    ----------
    residual
        Shape (n,), mm.
    weight
        Shape (n,): 1/sd of each row.
    upright
        The direction that stands upright (`Structure.upright`).
    """
    c = campaign.conditions
    rows = np.flatnonzero((campaign.kind == Kind.DISPLACEMENT) & (weight > 0.0))
    if c.u is None or len(rows) < 8:
        return []
    setup = np.zeros(len(rows), dtype=np.int64)
    if c.setup is not None:
        setup = np.unique(c.setup[rows], return_inverse=True)[1].reshape(-1)
    left = _within(residual[rows] * weight[rows], setup)
    names, columns = [], []
    for axis, direction in c.directions.items():
        for k, component in enumerate(COMPONENTS):
            column = _within(0.5 * direction[rows] * c.u[rows, k] * weight[rows], setup)
            if np.linalg.norm(column) > _SEEN * np.linalg.norm(weight[rows]):
                # play of a linear axis in its own component is much the commonest
                own = not is_rotary(axis) and own_component(axis) == component
                names.append((axis, component, own))
                columns.append(column)
    total = float(left @ left)
    freedom = max(1, len(rows) - len(np.unique(setup)))
    chosen: list[int] = []
    found: list[SideDifference] = []
    while columns and total > 0.0:
        falls = [_fall(columns, [*chosen, i], left) for i in range(len(columns))]
        before = _fall(columns, chosen, left)
        best = max(falls)
        alike = [i for i, f in enumerate(falls) if f - before > 0.9 * (best - before)]
        i = next((i for i in alike if names[i][2]), int(np.argmax(falls)))
        gained = falls[i] - before
        noise = (total - falls[i]) / freedom
        if i in chosen or gained < CERTAIN**2 * noise or gained < _SHARE * total:
            break
        chosen.append(i)
        together = np.stack([columns[j] for j in chosen], axis=1)
        values = np.linalg.lstsq(together, left, rcond=None)[0]
        sd = np.sqrt(np.diag(np.linalg.pinv(together.T @ together)) * noise)
        shares = [_alone(columns, chosen, j, left) / total for j in chosen]
        found = [
            SideDifference(*names[j][:2], float(v), float(s), share, upright)
            for j, v, s, share in zip(chosen, values, sd, shares, strict=True)
        ]
    return sorted(found, key=lambda f: -f.share)


def _alone(columns: list[F64], chosen: list[int], i: int, left: F64) -> float:
    return _fall(columns, chosen, left) - _fall(columns, [j for j in chosen if j != i], left)


def _fall(columns: list[F64], chosen: list[int], left: F64) -> float:
    """Square of what some columns explain."""
    if not chosen:
        return 0.0
    own = np.stack([columns[j] for j in chosen], axis=1)
    fitted = own @ np.linalg.lstsq(own, left, rcond=1e-8)[0]
    return float(fitted @ left)


def _within(values: F64, setup: NDArray[np.int64]) -> F64:
    """Values less their set-up's mean."""
    count = np.maximum(np.bincount(setup), 1)
    return np.asarray(values - (np.bincount(setup, values) / count)[setup])
