"""Nuisances of set-ups (zero, slope, frame of the instrument), eliminated set-up by set-up.

The columns of one set-up are zero on the rows of all others. So each set-up's own few columns are
projected out of its own rows, and the effects' columns that are left contain all that the set-ups
together know: the same solution as with one large matrix, at a cost that does not grow with the
number of set-ups.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.effects.catalogue.instruments.setup import frame_columns, path_coordinate
from abbe.compcore.fitting.design.common_errors import CommonErrors, Whitening
from abbe.compcore.fitting.design.observation import Observation
from abbe.compcore.linalg import svd

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_RANK = 1e-9
"""Singular values below this part of the largest belong to columns that say nothing new."""

_NO_COLUMN = 1e-12
"""A column below this part of the largest is rounding: it is not made of length 1."""


@dataclass(frozen=True, eq=False)
class SetupNuisances:
    """The nuisances of one set-up: its rows and their columns.

    Attributes
    ----------
    setup
        Its name.
    rows
        Indices of its rows, ascending.
    names
        ``zero``, ``slope``, ``frame x`` …; one for each column.
    units
        ``mm`` or ``rad`` of each.
    columns
        Shape (m, k): what one unit of each adds to the value of the rows, unweighted.
    """

    setup: str
    rows: Index
    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: F64


def rows_of_setups(campaign: Campaign) -> list[tuple[str, Index]]:
    """Each set-up's name and its rows, in the order in which they begin; one without a name."""
    setup = campaign.conditions.setup
    if setup is None:
        return [("", np.arange(campaign.n))]
    names, first, inverse = np.unique(setup, return_index=True, return_inverse=True)
    order = np.argsort(inverse.reshape(-1), kind="stable")
    ends = np.cumsum(np.bincount(inverse.reshape(-1), minlength=len(names)))
    return [(str(names[i]), order[(ends[i - 1] if i else 0) : ends[i]]) for i in np.argsort(first)]


def setup_blocks(
    campaign: Campaign,
    observation: Observation | None,
    rows: Sequence[tuple[str, Index]] | None = None,
    placed: F64 | None = None,
) -> list[SetupNuisances]:
    """One block for each set-up of a campaign, also those that leave nothing unknown.

    `observation` (all rows) is needed where a set-up leaves its frame unknown; `rows` are those of
    `rows_of_setups`, where they are known; `placed` (n, 3) are the points as the instruments see
    them, mm, where these are turned (`turned_frames`), else the machine's own.
    """
    if campaign.conditions.setup is None:
        return [SetupNuisances("", np.arange(campaign.n), (), (), np.zeros((campaign.n, 0)))]
    rows = rows_of_setups(campaign) if rows is None else rows
    return [_block(campaign, observation, name, own, placed) for name, own in rows]


def _block(
    campaign: Campaign,
    observation: Observation | None,
    name: str,
    rows: Index,
    placed: F64 | None,
) -> SetupNuisances:
    free = campaign.setups[name].free if name in campaign.setups else ()
    kinds = campaign.kind[rows]
    columns: list[F64] = []
    names: list[str] = []
    units: list[str] = []
    path = None
    if "slope" in free:
        positions = campaign.conditions.positions.values()
        path = path_coordinate(np.stack([q[rows] for q in positions], axis=1))
    for kind in np.unique(kinds):
        of_kind = (kinds == kind).astype(np.float64)
        unit = "rad" if kind == Kind.ROTATION else "mm"
        suffix = f" ({Kind(kind).name.lower()})" if np.ptp(kinds) else ""
        if "zero" in free:
            columns.append(of_kind)
            names.append("zero" + suffix)
            units.append(unit)
        if path is not None:
            columns.append(of_kind * path)
            names.append("slope" + suffix)
            units.append(unit)
    if "frame" in free and observation is not None:
        chain = observation.chain
        toward, about = (
            chain.to_workpiece(v)[rows] for v in (observation.toward, observation.about)
        )
        point = chain.point if placed is None else placed
        frame = frame_columns(point[rows], toward, about)
        columns += list(frame.T)
        names += [f"frame {k}" for k in "xyzabc"]
        units += ["mm"] * 3 + ["rad"] * 3
    stacked = np.stack(columns, axis=1) if columns else np.zeros((len(rows), 0))
    return SetupNuisances(name, rows, tuple(names), tuple(units), stacked)


class Eliminator:
    """The projection of set-ups' nuisances out of weighted columns; gauges' common errors whitened.

    Parameters
    ----------
    blocks
        From `setup_blocks`.
    weight
        Shape (n,): 1/sd of each row.
    common
        Errors that rows of one gauge share; None where there are none.

    Attributes
    ----------
    whitening
        What `project` does beside taking the nuisances out; None where no rows share an error.
    """

    def __init__(
        self, blocks: Sequence[SetupNuisances], weight: F64, common: CommonErrors | None = None
    ) -> None:
        self.blocks = tuple(blocks)
        self._basis: list[F64] = []
        self._solve: list[F64] = []
        for block in self.blocks:
            columns = block.columns * weight[block.rows, None]
            size = np.linalg.norm(columns, axis=0)
            size[size <= _NO_COLUMN * size.max(initial=0.0)] = 1.0
            u, s, vt = svd(columns / size)
            keep = s > _RANK * (s[0] if s.size else 0.0)
            u, s, vt = u[:, keep], s[keep], vt[keep]
            self._basis.append(u)
            self._solve.append((vt.T / s) / size[:, None])
        self.whitening = None if common is None else Whitening.of(common, self.bases())

    @property
    def rank(self) -> int:
        """Number of independent nuisances of all set-ups."""
        return sum(basis.shape[1] for basis in self._basis)

    def bases(self) -> Iterator[tuple[Index, F64]]:
        """Each set-up's rows and orthonormal basis (m, k) of its weighted columns."""
        for block, basis in zip(self.blocks, self._basis, strict=True):
            if basis.shape[1]:
                yield block.rows, basis

    def all_bases(self) -> Iterator[tuple[Index, F64]]:
        """As `bases`, also of set-ups without nuisances (k = 0)."""
        yield from zip((block.rows for block in self.blocks), self._basis, strict=True)

    def project(self, columns: F64) -> F64:
        """Weighted columns, (n,) or (n, k), less what the nuisances can imitate; a copy.

        Where rows share a gauge's error they are whitened besides: least squares on the result is
        least squares with the covariance of the rows.
        """
        out = self._eliminated(columns)
        if self.whitening is not None:
            common = self.whitening.common
            shared = common.times(self.whitening.root @ common.sums(out))
            out -= self._eliminated(shared)
        return out

    def _eliminated(self, columns: F64) -> F64:
        out = columns.copy()
        for rows, basis in self.bases():
            part = out[rows]
            out[rows] = part - basis @ (basis.T @ part)
        return out

    def common_basis(self) -> F64:
        """A matrix M, (n, gauges): whitened, a column c is shorter by ``‖Mᵀc‖²``, squared."""
        if self.whitening is None:
            return np.zeros((0, 0))
        return self._eliminated(self.whitening.common.times(self.whitening.half))

    def gauges(self, weighted: F64) -> dict[str, float]:
        """The error of each gauge that explains weighted residuals (n,) best, in its sds."""
        if self.whitening is None:
            return {}
        amounts = self.whitening.amounts(self._eliminated(weighted))
        return dict(zip(self.whitening.common.names, amounts.tolist(), strict=True))

    def _without_gauges(self, weighted: F64) -> F64:
        """Weighted residuals (n,) less the gauges' errors that explain them best."""
        if self.whitening is None:
            return weighted
        amounts = self.whitening.amounts(self._eliminated(weighted))
        return weighted - self.whitening.common.times(amounts)

    def values(self, weighted: F64) -> dict[str, dict[str, tuple[float, str]]]:
        """The nuisances that fit weighted residuals (n,) best: set-up → name → (value, unit)."""
        found: dict[str, dict[str, tuple[float, str]]] = {}
        weighted = self._without_gauges(weighted)
        for block, basis, solve in zip(self.blocks, self._basis, self._solve, strict=True):
            if block.names:
                values = solve @ (basis.T @ weighted[block.rows])
                found[block.setup] = {
                    name: (float(v), unit)
                    for name, v, unit in zip(block.names, values, block.units, strict=True)
                }
        return found

    def share(self, weighted: F64) -> F64:
        """The part of nuisances and gauges in weighted residuals (n,), by least squares, (n,)."""
        out = np.zeros(weighted.shape[0])
        if self.whitening is not None:
            amounts = self.whitening.amounts(self._eliminated(weighted))
            out += self.whitening.common.unweighted(amounts)
            weighted = weighted - self.whitening.common.times(amounts)
        for block, basis, solve in zip(self.blocks, self._basis, self._solve, strict=True):
            if block.names:
                out[block.rows] += block.columns @ (solve @ (basis.T @ weighted[block.rows]))
        return out

    def leverage(self, n: int) -> F64:
        """The leverage of each row in its own set-up's nuisances, 0 … 1, shape (n,)."""
        out = np.zeros(n)
        for rows, basis in self.bases():
            out[rows] = np.einsum("ij,ij->i", basis, basis)
        return out
