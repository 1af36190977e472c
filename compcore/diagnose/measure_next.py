"""What to measure next: which practicable set-up would tell two causes apart, or sharpen the model.

Each set-up on a list of practicable ones (lines along axes at other offsets and with other tools,
straightness, angles, diagonals; a line repeated with one sensor's place warmed) is imagined, and
its rows are added to the normal equations. Two figures come out:

* the χ² by which the campaign with it would tell the winner from its alias: with v the winner's
  signature, ``λ = min over (θ, γ) of ‖v − Jθ − Dγ‖²`` over old and new rows, D the alias's columns;
* by how much the mean standard deviation of the predicted error in the volume would fall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from compcore.campaign import Campaign
from compcore.design_matrix import Problem
from compcore.diagnose.pool import Found
from compcore.diagnose.practicable import practicable, rows_at
from compcore.effects.base import Effect
from compcore.fit import FitResult

F64 = NDArray[np.float64]

_RIDGE = 1e-9
_TOLD = 14.0


@dataclass(frozen=True)
class Advice:
    """What one proposal would bring.

    Attributes
    ----------
    what
        What to measure.
    separates
        Spec of the candidate that it would tell from the winner, or None.
    separation, separation_now
        χ² by which the two would be, and are, told apart.
    uncertainty_falls_by
        Part of the prediction's mean standard deviation that it would take away.
    """

    what: str
    separates: str | None
    separation: float
    separation_now: float
    uncertainty_falls_by: float


def advise(
    result: FitResult, winner: Found | None, rivals: Sequence[Found], most: int = 4
) -> list[Advice]:
    """The most useful set-ups, best first.

    Parameters
    ----------
    result
        The fit of the model as it is.
    winner
        The leading cause, or None where nothing is missing.
    rivals
        Its aliases, closest first; the first two are looked at.
    """
    machine = result.problem.model.machine
    proposals = list(practicable(machine, result.problem.campaign))
    known = _Known(result, winner)
    news = [known.rows(p.rows) for p in proposals]
    falls = [known.falls_by(new) for new in news]
    advice: list[Advice] = []
    for rival in rivals[:2] if winner is not None else ():
        now = known.separation(rival, None)
        spec = rival.candidate.effect.spec
        advice += [
            Advice(proposal.what, spec, known.separation(rival, new), now, fall)
            for proposal, new, fall in zip(proposals, news, falls, strict=True)
        ]
    if advice:
        effort = {p.what: p.effort for p in proposals}
        advice.sort(
            key=lambda a: -(min(a.separation, 10 * _TOLD) - a.separation_now) / effort[a.what]
        )
        return _first_of_each(advice, most)
    plain = [Advice(p.what, None, 0.0, 0.0, fall) for p, fall in zip(proposals, falls, strict=True)]
    plain.sort(key=lambda a: -a.uncertainty_falls_by)
    return plain[:most]


def _first_of_each(advice: Sequence[Advice], most: int) -> list[Advice]:
    seen: set[str] = set()
    out = []
    for a in advice:
        if a.what not in seen:
            seen.add(a.what)
            out.append(a)
    return out[:most]


class _Known:
    """What the campaign says already, as normal equations over model and winner."""

    def __init__(self, result: FitResult, winner: Found | None) -> None:
        self._result = result
        self._winner = winner
        problem = result.problem
        self._scale = problem.layout.scale
        self._model = problem.columns(result.theta) * self._scale
        self._model = result.eliminator.project(self._model)
        self._signature: F64 | None = None
        self._strength: F64 = np.zeros(0)
        if winner is not None:
            own = result.eliminator.project(self._columns(problem, winner))
            together = np.hstack([self._model, own])
            beta = np.linalg.lstsq(together, result.weighted, rcond=1e-9)[0][-own.shape[1] :]
            self._strength = np.asarray(beta, dtype=np.float64)
            self._signature = own @ beta
        self._information = self._model.T @ self._model
        self._grid = self._volume()

    def _columns(self, problem: Problem, found: Found) -> F64:
        return problem.effect_columns(
            found.candidate.effect, found.screened.nonlinear, self._result.theta
        )

    def rows(self, campaign: Campaign) -> Problem:
        """New rows as a problem of the same model."""
        return Problem(self._result.problem.model, campaign)

    def _new(self, problem: Problem) -> tuple[F64, F64]:
        """Model columns and winner's signature on new rows, their zero taken out."""
        theta = self._result.theta
        eliminator = problem.eliminator(theta)
        model = eliminator.project(problem.columns(theta) * self._scale)
        if self._winner is None:
            return model, np.zeros(problem.n)
        own = eliminator.project(self._columns(problem, self._winner))
        return model, own @ self._strength

    def separation(self, rival: Found, new: Problem | None) -> float:
        """χ² by which winner and rival are told apart, with new rows or without."""
        if self._signature is None:
            return 0.0
        other = self._result.eliminator.project(self._columns(self._result.problem, rival))
        size = np.linalg.norm(other, axis=0)
        size[size == 0.0] = 1.0
        columns = np.hstack([self._model, other / size])
        moment = columns.T @ self._signature
        information = columns.T @ columns
        total = float(self._signature @ self._signature)
        if new is not None:
            model, signature = self._new(new)
            eliminator = new.eliminator(self._result.theta)
            more = np.hstack([model, eliminator.project(self._columns(new, rival)) / size])
            information = information + more.T @ more
            moment = moment + more.T @ signature
            total += float(signature @ signature)
        imitated = _solve(information, moment)
        return max(0.0, total - float(moment @ imitated))

    def falls_by(self, new: Problem) -> float:
        """Part of the prediction's mean standard deviation that new rows take away."""
        more, _ = self._new(new)
        before = _spread(self._information, self._grid)
        after = _spread(self._information + more.T @ more, self._grid)
        return 1.0 - after / before if before > 0.0 else 0.0

    def _volume(self) -> F64:
        """Rows that predict the error at corners, edges and middle, relative to the middle."""
        campaign = self._result.problem.campaign
        machine = self._result.problem.model.machine
        axes = machine.structure.linear
        places = np.array(list(product(*[np.linspace(*machine.axes[a].travel, 3) for a in axes])))
        positions = dict(zip(axes, places.T, strict=True))
        rows = [rows_at(campaign, machine, positions, u) for u in np.eye(3)]
        grids = []
        for part in rows:
            problem = Problem(self._result.problem.model, part)
            columns = problem.columns(self._result.theta) * self._scale * part.sd[:, None]
            grids.append(columns - columns[len(columns) // 2])
        return np.vstack(grids)


def _solve(information: F64, moment: F64) -> F64:
    values, vectors = np.linalg.eigh(information)
    keep = values > _RIDGE * values[-1]
    return np.asarray(vectors[:, keep] @ ((vectors[:, keep].T @ moment) / values[keep]))


def _spread(information: F64, grid: F64) -> float:
    """Mean standard deviation of predictions, determined combinations only."""
    values, vectors = np.linalg.eigh(information)
    keep = values > 1e-7 * values[-1]
    seen = grid @ vectors[:, keep]
    return float(np.sqrt(np.mean((seen**2 / values[keep]).sum(axis=1))))


def separable(effect: Effect) -> bool:
    """Whether any practicable set-up shows an effect: one tied to a past set-up none can."""
    return getattr(effect, "setup", None) is None
