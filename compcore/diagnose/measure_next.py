"""What to measure next: which practicable set-up would tell two causes apart, or sharpen the model.

Each set-up on a list of practicable ones (lines along axes at other offsets and with other tools,
straightness, angles, diagonals; a line repeated with one sensor's place warmed) is imagined, and
its rows are added to the normal equations. Two figures come out:

* the χ² by which the campaign with it would tell the winner from its alias: with v the winner's
  signature, ``λ = min over (θ, γ) of ‖v − Jθ − Dγ‖²`` over old and new rows, D the alias's columns;
* by how much the mean standard deviation of the predicted error in the volume would fall.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from compcore.campaign import Campaign, Kind, Setup
from compcore.conditions import Conditions
from compcore.design_matrix import Problem
from compcore.diagnose.search import Found
from compcore.effects.base import Effect
from compcore.fit import FitResult
from compcore.machine import Machine

F64 = NDArray[np.float64]

_POINTS = 13
_WARMER = 3.0
_RIDGE = 1e-9
_TOLD = 14.0


@dataclass(frozen=True, eq=False)
class Proposal:
    """A set-up that could be measured.

    Attributes
    ----------
    what
        For people: what to measure, where, with which tool.
    rows
        The rows it would give (values unknown, 0).
    effort
        Rough effort, in units of a plain line.
    """

    what: str
    rows: Campaign
    effort: float = 1.0


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
        rows = [_campaign(campaign, machine, positions, u) for u in np.eye(3)]
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


def practicable(machine: Machine, campaign: Campaign) -> Iterator[Proposal]:
    """Set-ups that a service engineer can do: lines, straightness, angles, diagonals, warming."""
    axes = machine.structure.linear
    letters = {"X": 0, "Y": 1, "Z": 2}
    tools = {"the usual tool": np.median(campaign.conditions.tool, axis=0)}
    tools["a tool 150 mm to the side"] = tools["the usual tool"] + np.array([150.0, 0.0, 0.0])
    tools["a tool 150 mm longer"] = tools["the usual tool"] + np.array([0.0, 0.0, -150.0])
    for axis in axes:
        others = [a for a in axes if a != axis]
        for parts in ((0.1, 0.1), (0.9, 0.1), (0.1, 0.9), (0.9, 0.9), (0.5, 0.5)):
            where = dict(zip(others, parts, strict=False))
            place = ", ".join(f"{a} = {_at(machine, a, p):.0f} mm" for a, p in where.items())
            for name, tool in tools.items():
                ends = {axis: (0.02, 0.98)} | {a: (p, p) for a, p in where.items()}
                if axis in letters:
                    yield Proposal(
                        f"positioning of {axis} along the line {place}, with {name}",
                        _line(campaign, machine, ends, np.eye(3)[letters[axis]], tool),
                    )
            for across in others:
                if across in letters:
                    yield Proposal(
                        f"straightness of {axis} in {across} along the line {place}",
                        _line(
                            campaign,
                            machine,
                            {axis: (0.02, 0.98)} | {a: (p, p) for a, p in where.items()},
                            np.eye(3)[letters[across]],
                            tools["the usual tool"],
                            free=("zero", "slope"),
                        ),
                        effort=1.5,
                    )
        for about in "XYZ":
            ends = {axis: (0.02, 0.98)} | dict.fromkeys(others, (0.5, 0.5))
            yield Proposal(
                f"angle of {axis} about {about} (level or autocollimator) along its travel",
                _line(
                    campaign,
                    machine,
                    ends,
                    np.eye(3)["XYZ".index(about)],
                    tools["the usual tool"],
                    kind=Kind.ROTATION,
                ),
                effort=1.5,
            )
    yield from _diagonals(machine, campaign, axes, tools["the usual tool"])
    yield from _warmed(machine, campaign, axes, tools["the usual tool"])


def _diagonals(
    machine: Machine, campaign: Campaign, axes: Sequence[str], tool: F64
) -> Iterator[Proposal]:
    if set(axes) < {"X", "Y", "Z"}:
        return
    for signs in product((1, -1), repeat=2):
        parts = {"X": (0.04, 0.96)}
        for a, s in zip(("Y", "Z"), signs, strict=True):
            parts[a] = (0.04, 0.96) if s > 0 else (0.96, 0.04)
        u = np.array([_at(machine, a, parts[a][1]) - _at(machine, a, parts[a][0]) for a in "XYZ"])
        u /= np.linalg.norm(u)
        yield Proposal(
            "body diagonal, X+ Y"
            + ("+" if signs[0] > 0 else "−")
            + " Z"
            + ("+" if signs[1] > 0 else "−"),
            _line(campaign, machine, parts, u, tool),
            effort=2.0,
        )


def _warmed(
    machine: Machine, campaign: Campaign, axes: Sequence[str], tool: F64
) -> Iterator[Proposal]:
    """A positioning line and the middle of the volume, with the place of one sensor warmed."""
    letters = {"X": 0, "Y": 1, "Z": 2}
    for name in campaign.conditions.signals:
        signal = machine.signals.get(name)
        if signal is None or not signal.temperature:
            continue
        for axis in axes:
            if axis not in letters:
                continue
            others = [a for a in axes if a != axis]
            for u_axis in "XYZ":
                ends = {axis: (0.02, 0.98)} | dict.fromkeys(others, (0.85, 0.85))
                u = np.eye(3)[letters[u_axis]]
                line = _line(campaign, machine, ends, u, tool)
                c = line.conditions
                course = np.where(np.arange(c.n) < c.n // 2, 0.0, _WARMER)
                signals = {**c.signals, name: c.signals[name] + course}
                what = (
                    f"the error in {u_axis} along {axis}, there with {name} as it is and back "
                    f"with its place {_WARMER:.0f} K warmer (heat only there, others steady)"
                )
                yield Proposal(
                    what, replace(line, conditions=replace(c, signals=signals)), effort=4.0
                )


def _at(machine: Machine, axis: str, part: float) -> float:
    low, high = machine.axes[axis].travel
    return low + part * (high - low)


def _line(
    campaign: Campaign,
    machine: Machine,
    ends: Mapping[str, tuple[float, float]],
    u: F64,
    tool: F64,
    *,
    kind: Kind = Kind.DISPLACEMENT,
    free: tuple[str, ...] = ("zero",),
) -> Campaign:
    way = np.linspace(0.0, 1.0, _POINTS)
    way = np.concatenate([way, way[::-1]])
    going = np.repeat([1.0, -1.0], _POINTS)
    positions = {
        a: _at(machine, a, p0) + way * (_at(machine, a, p1) - _at(machine, a, p0))
        for a, (p0, p1) in ends.items()
    }
    directions = {
        a: going * np.sign(p1 - p0) if p1 != p0 else np.ones(2 * _POINTS)
        for a, (p0, p1) in ends.items()
    }
    return _campaign(campaign, machine, positions, u, directions, tool, kind, free)


def _campaign(
    like: Campaign,
    machine: Machine,
    positions: Mapping[str, F64],
    u: F64,
    directions: Mapping[str, F64] | None = None,
    tool: F64 | None = None,
    kind: Kind = Kind.DISPLACEMENT,
    free: tuple[str, ...] = ("zero",),
) -> Campaign:
    """Rows as one set-up would give them, under the campaign's mean conditions."""
    c = like.conditions
    n = len(next(iter(positions.values())))
    middle = {a: np.full(n, machine.axes[a].middle) for a in machine.structure.axes}
    same = like.kind == kind
    sd = like.sd[same] if same.any() else like.sd
    typical = (
        float(np.nanmedian(sd))
        if np.isfinite(sd).any()
        else (1e-6 if kind == Kind.ROTATION else 5e-4)
    )
    conditions = Conditions(
        positions={**middle, **positions},
        directions=dict(directions or {}),
        tool=np.broadcast_to(np.zeros(3) if tool is None else tool, (n, 3)).copy(),
        time=np.asarray(float(np.mean(c.time)) + 12.0 * np.arange(n), dtype=np.float64),
        signals={name: np.full(n, float(np.mean(v))) for name, v in c.signals.items()},
        setup=np.full(n, "new"),
        u=np.broadcast_to(u, (n, 3)).copy(),
    )
    empty = np.full(n, "", dtype="<U1")
    return Campaign(
        "proposed",
        conditions,
        np.full(n, kind, dtype=np.int8),
        np.zeros(n),
        np.full(n, typical),
        empty,
        empty,
        np.arange(n),
        {"new": Setup("new", free)},
    )


def separable(effect: Effect) -> bool:
    """Whether any practicable set-up shows an effect: one tied to a past set-up none can."""
    return getattr(effect, "setup", None) is None
