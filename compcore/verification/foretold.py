"""What a model foretells of a line, with its uncertainty, and whether the readings agree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.comparison.compare import Comparison
from abbe.compcore.distributions import chi2_beyond
from abbe.compcore.fitting.design.superposition import observation_of, predicted_rows
from abbe.compcore.iso230.evaluate import evaluate_iso230
from abbe.compcore.iso230.positioning import PositioningResult
from abbe.compcore.linalg import svd
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model
from abbe.compcore.model.sensitivity import covariance_root, sensitivities
from abbe.compcore.verification.budget import combined
from abbe.compcore.verification.line_test import LineTest

F64 = NDArray[np.float64]

SYSTEMATIC = ("E", "M", "B")
"""What a model foretells: of the scatter, in A and R, it says nothing."""
_FELT, _TURNED = 1e-5, 1e-8
"""mm, rad below which a part of the covariance moves no figure that anybody reads."""
_COMMON = 0.1
"""Of a row's own uncertainty, all rows together, from which what is common is a way by itself."""
BY_CHANCE = 1e-3
"""Chance of so large a misfit from which on a line contradicts the model."""


@dataclass(frozen=True, eq=False)
class ForetoldFigure:
    """One figure of a line as a model foretells it, mm or rad.

    Attributes
    ----------
    value
        What the model's error motions make of it.
    sd
        Standard uncertainty by the model's covariance; None where it has none.
    """

    value: float
    sd: float | None


@dataclass(frozen=True, eq=False)
class ForetoldLine:
    """A line without compensation as a model foretells it, beside what was measured.

    Attributes
    ----------
    figures
        ``E``, ``M``, ``B`` → what is foretold, as far as the rows give them.
    left
        Measured less foretold, root of the mean square, mm or rad.
    expected
        What readings, instrument, expansion and the model's own uncertainty would leave, mm or rad.
    chance
        Of so large a misfit, if the model holds; None where nobody states how sure a reading is.
    """

    figures: Mapping[str, ForetoldFigure]
    left: float
    expected: float
    chance: float | None

    @property
    def agrees(self) -> bool | None:
        """Whether measured and foretold agree within their uncertainties; None: not known."""
        return None if self.chance is None else self.chance > BY_CHANCE


def foretold_line(model: Model, comparison: Comparison, line: LineTest) -> ForetoldLine:
    """What a model foretells of a line of a campaign beside which it was laid, and how they agree.

    The readings' own scatter, what is common to the whole line (instrument, expansion, set-up), and
    the model's covariance are one covariance of the rows; what the placing leaves unknown is taken
    out.
    """
    problem = comparison.problem
    whole = problem.campaign
    rows = np.flatnonzero(whole.conditions.setup == line.setup)
    campaign = whole.rows(rows)
    value = predicted_rows(campaign, model)
    parts = uncertain_parts(model, campaign)
    figures = _foretold(campaign, value, parts, model)
    weight = 1.0 / problem.sd[rows]
    common = np.column_stack([parts, _common(campaign, line)])
    placed = _placed(campaign, line) * weight[:, None]
    left = svd(placed).u if placed.shape[1] else placed
    seen = common * weight[:, None]
    seen = seen - left @ (left.T @ seen)
    misfit = comparison.residual[rows] * weight
    freedom = len(rows) - left.shape[1]
    variance = (1.0 - (left**2).sum(axis=1) + (seen**2).sum(axis=1)) / weight**2
    stated = not comparison.uncertainty.open and model.covariance is not None
    return ForetoldLine(
        figures,
        float(np.sqrt(np.mean(comparison.residual[rows] ** 2))),
        float(np.sqrt(np.mean(variance))),
        misfit_chance(misfit, seen, freedom) if stated and freedom > 0 else None,
    )


def misfit_chance(misfit: F64, seen: F64, freedom: int) -> float:
    """The probability of a misfit that is as great by chance.

    What the uncertainties that are common to the line can make, and the rest of the rows, are
    looked at each by itself: a wrong scale is one number, and would be lost among a hundred quiet
    readings.

    Parameters
    ----------
    misfit
        In units of the rows' own standard uncertainty, what the placing leaves unknown taken out.
    seen
        What is common, a cause a column, likewise.
    freedom
        Of all rows.
    """
    ways, size, _ = svd(seen)
    felt = size > _COMMON
    along = ways[:, felt].T @ misfit
    common = float(np.sum(along**2 / (1.0 + size[felt] ** 2)))
    rest, left = float(misfit @ misfit - along @ along), freedom - int(felt.sum())
    chances = [chi2_beyond(common, int(felt.sum()))] if felt.any() else []
    chances += [chi2_beyond(rest, left)] if left > 0 else []
    return min(1.0, len(chances) * min(chances))


def _foretold(rows: Campaign, value: F64, parts: F64, model: Model) -> dict[str, ForetoldFigure]:
    base = _figures(rows, value, model.machine)
    square = dict.fromkeys(base, 0.0)
    for part in parts.T:
        for sign in (1.0, -1.0):
            moved = _figures(rows, value + sign * part, model.machine)
            for name in base:
                square[name] += 0.5 * (moved[name] - base[name]) ** 2
    known = model.covariance is not None
    return {
        name: ForetoldFigure(v, float(np.sqrt(square[name])) if known else None)
        for name, v in base.items()
    }


def uncertain_parts(model: Model, rows: Campaign) -> F64:
    """Independent parts of the prediction's uncertainty, one a column, mm or rad."""
    if model.covariance is None:
        return np.zeros((rows.n, 0))
    seen = observation_of(rows, model)
    moved, turned = sensitivities(model, rows.conditions)
    columns = np.einsum("ni,nip->np", seen.toward, moved)
    columns += np.einsum("ni,nip->np", seen.about, turned)
    left, size, _ = svd(columns @ covariance_root(model.covariance))
    felt = size > (_TURNED if (rows.kind == Kind.ROTATION).all() else _FELT)
    return np.asarray(left[:, felt] * size[felt])


def _common(campaign: Campaign, line: LineTest) -> F64:
    """What instrument, expansion and set-up may do to all rows of a line, (n, 1), mm or rad."""
    along = _along(campaign, line)
    return (combined(line.causes) * along / (np.ptp(along) or 1.0))[:, None]


def _along(campaign: Campaign, line: LineTest) -> F64:
    if line.rotary:
        return campaign.conditions.position(line.name)
    at = campaign.functional_moves()
    u = campaign.conditions.u
    return np.asarray(np.einsum("ni,ni->n", at - at[0], np.zeros_like(at) if u is None else u))


def _placed(campaign: Campaign, line: LineTest) -> F64:
    """What the instrument's placing leaves unknown, (n, k)."""
    free = campaign.setups[line.setup].free
    columns = [np.ones(campaign.n)] if "zero" in free else []
    columns += [_along(campaign, line)] if "slope" in free else []
    return np.stack(columns, axis=1) if columns else np.zeros((campaign.n, 0))


def _figures(rows: Campaign, value: F64, machine: Machine) -> dict[str, float]:
    """The systematic figures of one line with other values."""
    found = evaluate_iso230(replace(rows, value=value), machine)
    results: list[PositioningResult] = list(found.positioning)
    results += [d.result for d in found.diagonals.diagonals]
    figures = {name: getattr(results[0], name) for name in SYSTEMATIC}
    return {name: float(v) for name, v in figures.items() if v is not None}
