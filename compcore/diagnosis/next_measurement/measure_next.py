"""What to measure next: which practicable set-up would tell two causes apart, or sharpen the model.

Each set-up on a list of practicable ones (lines along axes at other offsets and with other tools,
straightness, angles, diagonals; a line repeated with one sensor's place warmed) is imagined, and
its rows are added to the normal equations. Two figures come out:

* the χ² by which the campaign with it would tell the winner from its alias: with v the winner's
  signature, ``λ = min over (θ, γ) of ‖v − Jθ − Dγ‖²`` over old and new rows, D the alias's columns;
* by how much the mean standard deviation of the predicted error in the volume would fall.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.join import join_campaigns
from abbe.compcore.diagnosis.next_measurement.practicable import Proposal, practicable, rows_at
from abbe.compcore.diagnosis.screening.pool import WeighedCandidate
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.linalg import svd
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

_RIDGE = 1e-9
_ROUNDING = 1e-10
"""Part of a signature's square below which what is left of it is rounding."""
_APART = 14.0
_TELLS = 1.0
"""χ² that a measurement must add to what tells two causes apart: a standard deviation of it."""


@dataclass(frozen=True)
class Advice:
    """What one proposal would bring.

    Attributes
    ----------
    what
        What to measure.
    cause, separates
        Spec of the winner, and of the candidate that it would tell from it; or None both.
    separation, separation_now
        χ² by which the two would be, and are, told apart.
    uncertainty_falls_by
        Part of the prediction's mean standard deviation that it would take away.
    """

    what: str
    cause: str | None
    separates: str | None
    separation: float
    separation_now: float
    uncertainty_falls_by: float


def advise(
    result: FitResult,
    winner: WeighedCandidate | None,
    rivals: Sequence[WeighedCandidate],
    most: int = 4,
    *,
    beside: Sequence[WeighedCandidate] = (),
    variance: float = 1.0,
    share: float = 1.0,
) -> list[Advice]:
    """The most useful set-ups, best first.

    Parameters
    ----------
    result
        The fit of the model as it is.
    winner
        The leading cause, or None where nothing is missing.
    rivals
        Its aliases, likeliest first; the first two are looked at.
    beside
        The other causes: whatever their coefficients are, they tell the two not apart.
    variance
        Noise variance in units of the weights: χ² per degree of freedom once all is explained.
    share
        Part of the campaign's rows that `result` was fitted to.
    """
    machine = result.problem.model.machine
    proposals = list(practicable(machine, result.problem.campaign))
    known = _Known(result, winner, beside)
    new = _New(result, winner, known, proposals, beside)
    advice: list[Advice] = []
    for rival in rivals[:2] if winner is not None else ():
        now, separated = known.separations(rival, new)
        # rows that were not looked at tell as much as those that were
        separated = [now / share + (apart - now) for apart in separated]
        now, separated = now / (share * variance), [apart / variance for apart in separated]
        spec = rival.candidate.effect.spec
        cause = winner.candidate.effect.spec if winner is not None else None
        advice += [
            Advice(proposal.what, cause, spec, apart, now, 0.0)
            for proposal, apart in zip(proposals, separated, strict=True)
        ]
    turning = {axis for e in (winner, *rivals[:2]) if e for axis in _turns_of(e, machine)}
    turned = {p.what for p in proposals if turning <= _moving(p.rows)}
    advice = [
        a
        for a in advice
        if a.separation > a.separation_now + _TELLS
        and a.separation_now < _APART
        and a.what in turned
    ]
    at_hand = _at_hand(result.problem.campaign, proposals)
    advice = [a for a in advice if a.what in at_hand] or advice
    line = {p.what: p.line or p.what for p in proposals}
    if advice:
        effort = {p.what: p.effort for p in proposals}
        # of the same line with several tools the usual one comes first where it says as much
        advice.sort(
            key=lambda a: (
                -round((min(a.separation, 10 * _APART) - a.separation_now) / effort[a.what], 1)
            )
        )
        rows = {p.what: rows for p, rows in zip(proposals, new.slices, strict=True)}
        return [
            replace(a, uncertainty_falls_by=known.falls_by(new.model[rows[a.what]]))
            for a in _first_of_each(advice, line)[:most]
        ]
    if not result.problem.model.terms:
        return []  # nothing yet to be sharpened
    bounds = np.array([known.falls_at_most(new.model[rows]) for rows in new.slices])
    own = np.array([p.what in at_hand for p in proposals])
    bounds = np.where(own, bounds, -1.0)
    plain: list[Advice] = []
    for i in np.argsort(-np.round(bounds, 3), kind="stable")[: int(own.sum())]:
        if len(plain) >= most and plain[most - 1].uncertainty_falls_by >= bounds[i]:
            break
        fall = known.falls_by(new.model[new.slices[i]])
        plain.append(Advice(proposals[i].what, None, None, 0.0, 0.0, fall))
        plain.sort(key=lambda a: -round(a.uncertainty_falls_by, 3))
        plain = _first_of_each(plain, line)
    return plain[:most]


def _turns_of(found: WeighedCandidate, machine: Machine) -> set[str]:
    """The rotary axes on whose position a cause depends: at rest they tell nothing of it."""
    used = found.candidate.effect.positions_used(machine)
    return {axis for axis in used if machine.axes[axis].rotary}


def _moving(rows: Campaign) -> set[str]:
    """The axes that a set-up moves."""
    return {a for a, q in rows.conditions.positions.items() if float(np.ptp(q)) > 0.0}


def _at_hand(campaign: Campaign, proposals: Sequence[Proposal]) -> set[str]:
    """The proposals for which the campaign's own instruments do.

    Who measured with levels or an autocollimator alone has these; a laser has optics for angles.
    """
    angles = bool((campaign.kind == Kind.ROTATION).all())
    own = {p.what for p in proposals if not angles or (p.rows.kind == Kind.ROTATION).all()}
    return own or {p.what for p in proposals}


def _first_of_each(advice: Sequence[Advice], line: Mapping[str, str]) -> list[Advice]:
    """The first of each line: with another tool it is the same once more."""
    seen: set[str] = set()
    out = []
    for a in advice:
        if line[a.what] not in seen:
            seen.add(line[a.what])
            out.append(a)
    return out


def _columns(problem: Problem, found: WeighedCandidate, theta: F64) -> F64:
    effect, nonlinear = found.candidate.effect, found.screened.nonlinear
    return problem.effect_columns(effect, nonlinear, found.candidate.at(theta))


def _sizes(columns: F64) -> F64:
    """The norms of columns, 1 where that is 0."""
    size = np.linalg.norm(columns, axis=0)
    return np.where(size > 0.0, size, 1.0)


def _model_columns(problem: Problem, theta: F64, scale: F64) -> F64:
    """Columns of rows that have no base points, in units of the scales of all unknowns."""
    size = problem.layout.size
    out = np.zeros((problem.n, len(scale)))
    out[:, :size] = problem.columns(theta[:size]) * scale[:size]
    return out


class _Known:
    """What the campaign says already, as normal equations over model and winner.

    Attributes
    ----------
    strength
        The winner's linear parameters as they would be fitted; empty without a winner.
    largest, by
        The norm of the model's largest column, and factors that bring the columns of the other
        causes to it, an array (k,) for each.
    """

    def __init__(
        self,
        result: FitResult,
        winner: WeighedCandidate | None,
        beside: Sequence[WeighedCandidate] = (),
    ) -> None:
        self._result = result
        problem = result.problem
        self._scale = problem.layout.scale
        self._model = result.eliminator.project(problem.columns(result.theta) * self._scale)
        # as large as the model's largest: what is far smaller passes for what nobody sees
        self.largest = float(np.linalg.norm(self._model, axis=0).max(initial=0.0)) or 1.0
        others = [result.eliminator.project(_columns(problem, f, result.theta)) for f in beside]
        self.by = [self.largest / _sizes(columns) for columns in others]
        self._with_others = np.hstack(
            [self._model, *(c * by for c, by in zip(others, self.by, strict=True))]
        )
        self._signature: F64 | None = None
        self.strength: F64 = np.zeros(0)
        if winner is not None:
            own = result.eliminator.project(_columns(problem, winner, result.theta))
            together = np.hstack([self._with_others, own])
            beta = np.linalg.lstsq(together, result.weighted, rcond=1e-9)[0][-own.shape[1] :]
            self.strength = np.asarray(beta, dtype=np.float64)
            self._signature = own @ beta
        self._information = self._model.T @ self._model
        self._grid = self._volume()
        self._half = _determined(self._information)
        self._seen = self._grid @ self._half
        self._spread = _spread(self._information, self._grid)

    def separations(self, rival: WeighedCandidate, new: _New) -> tuple[float, list[float]]:
        """χ² by which winner and rival are told apart: now, and with each of the new set-ups."""
        if self._signature is None:
            return 0.0, [0.0] * len(new.slices)
        theta = self._result.theta
        whole = _columns(self._result.problem, rival, theta)
        other = self._result.eliminator.project(whole)
        own_new = new.columns(rival)
        size = np.linalg.norm(other, axis=0)
        usual = np.maximum(np.linalg.norm(whole, axis=0), np.linalg.norm(own_new, axis=0))
        # what is 0 at every target, or goes into the instruments' placing, is left as rounding
        hidden = size <= _ROUNDING * usual
        other[:, hidden] = 0.0
        size[hidden] = np.where(usual[hidden] > 0.0, usual[hidden], 1.0)
        size /= self.largest
        columns = np.hstack([self._with_others, other / size])
        information, moment = columns.T @ columns, columns.T @ self._signature
        values, vectors = np.linalg.eigh(information)
        keep = values > _RIDGE * values[-1]
        seen, unseen = vectors[:, keep] / np.sqrt(values[keep]), vectors[:, ~keep]
        imitated = seen.T @ moment
        total = float(self._signature @ self._signature)
        nothing = _ROUNDING * total
        now = total - float(imitated @ imitated)
        every = np.hstack([new.with_others, own_new / size])
        by_seen, by_unseen = every @ seen, every @ unseen
        missed = new.signature - by_seen @ imitated
        found = []
        for rows in new.slices:
            own, left = by_seen[rows], missed[rows]
            if unseen.shape[1]:
                # what the campaign cannot see at all is free to follow the new rows
                u, s, _ = svd(by_unseen[rows])
                free = u[:, s**2 > _RIDGE * values[-1]]
                own, left = own - free @ (free.T @ own), left - free @ (free.T @ left)
            further = float(left @ np.linalg.solve(np.eye(len(left)) + own @ own.T, left))
            found.append(now + further if now + further > nothing else 0.0)
        return (now if now > nothing else 0.0), found

    def falls_by(self, more: F64) -> float:
        """Part of the prediction's mean standard deviation that new rows take away."""
        after = _spread(self._information + more.T @ more, self._grid)
        return 1.0 - after / self._spread if self._spread > 0.0 else 0.0

    def falls_at_most(self, more: F64) -> float:
        """The same were nothing determined beyond what the campaign determines: never less."""
        mixed = more @ self._half
        inner = np.linalg.cholesky(np.eye(len(mixed)) + mixed @ mixed.T)
        taken = np.linalg.solve(inner, mixed @ self._seen.T)
        before = float(np.mean((self._seen**2).sum(axis=1)))
        after = before - float(np.mean((taken**2).sum(axis=0)))
        return 1.0 - float(np.sqrt(max(after, 0.0) / before)) if before > 0.0 else 0.0

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
            problem = Problem(self._result.problem.model, part, bodies="none")
            columns = _model_columns(problem, self._result.theta, self._scale) * part.sd[:, None]
            grids.append(columns - columns[len(columns) // 2])
        return np.vstack(grids)


class _New:
    """The rows of all proposals, evaluated together.

    Attributes
    ----------
    slices
        The rows of each proposal.
    model, signature
        The model's columns in units of the unknowns' scales, and the winner's signature, with each
        set-up's zero taken out.
    with_others
        The model's columns and those of the other causes.
    """

    def __init__(
        self,
        result: FitResult,
        winner: WeighedCandidate | None,
        known: _Known,
        proposals: Sequence[Proposal],
        beside: Sequence[WeighedCandidate] = (),
    ) -> None:
        planned = join_campaigns([p.rows for p in proposals])
        self._problem = Problem(result.problem.model, planned, bodies="none")
        self._theta = result.theta
        self._eliminator = self._problem.eliminator(self._theta)
        ends = np.cumsum([p.rows.n for p in proposals])
        self.slices = [
            slice(end - p.rows.n, end) for p, end in zip(proposals, ends.tolist(), strict=True)
        ]
        scale = result.problem.layout.scale
        self.model = self._eliminator.project(_model_columns(self._problem, self._theta, scale))
        self.with_others = np.hstack(
            [self.model, *(self.columns(f) * by for f, by in zip(beside, known.by, strict=True))]
        )
        self.signature = np.zeros(self._problem.n)
        if winner is not None:
            self.signature = self.columns(winner) @ known.strength

    def columns(self, found: WeighedCandidate) -> F64:
        """A candidate's columns on all rows, each set-up's zero taken out."""
        return self._eliminator.project(_columns(self._problem, found, self._theta))


def _determined(information: F64) -> F64:
    """Combinations of unknowns that are determined, at one standard deviation, as columns."""
    values, vectors = np.linalg.eigh(information)
    keep = values > 1e-7 * values.max(initial=0.0)
    return np.asarray(vectors[:, keep] / np.sqrt(values[keep]))


def _spread(information: F64, grid: F64) -> float:
    """Mean standard deviation of predictions, determined combinations only."""
    return float(np.sqrt(np.mean(((grid @ _determined(information)) ** 2).sum(axis=1))))


def separable(effect: Effect) -> bool:
    """Whether any practicable set-up shows an effect: one tied to a past set-up none can."""
    return getattr(effect, "setup", None) is None
