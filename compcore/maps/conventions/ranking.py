"""Judging hypotheses exactly, each once: how well they fit, which fit alike, what would tell."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.conventions.hypotheses import Hypothesis
from abbe.compcore.maps.conventions.point_fit import fit_rotation_point
from abbe.compcore.maps.conventions.subject import Predictor, Subject
from abbe.compcore.maps.conventions.switched import SwitchedPoints

F64 = NDArray[np.float64]

_CLEAR = 12.0
"""Difference in χ² from which two hypotheses are told apart (p ≈ 5e-4 for one degree)."""
_NEAR = 3.0
"""Standard deviations from a named place within which an estimated coordinate is taken as it."""
_DECIMALS = 2
"""Of an estimated rotation point, mm: finer than it ever matters (10 µm × 100 µrad = 1 nm)."""
FLOOR = 1e-6
"""mm: conventions whose predictions differ by less are the same in practice."""
_TELLING = 1e-4
"""mm: a pose must tell two hypotheses apart by more than a display's last digit."""


@dataclass(frozen=True)
class Judged:
    """A hypothesis and how well it reproduces the points.

    Attributes
    ----------
    rms, worst
        Over all components of all points, mm.
    """

    hypothesis: Hypothesis
    rms: float
    worst: float


@dataclass(frozen=True)
class Telling:
    """A pose at which two hypotheses differ, and by how much (mm); positions and tool in mm."""

    positions: dict[str, float]
    tool: tuple[float, float, float]
    difference: float


@dataclass(frozen=True)
class Tie:
    """A hypothesis that reproduces the points as well as the best.

    `telling` is a pose that would tell the two apart, without a tool offset if there is one; None
    where no pose in the volume would.
    """

    judged: Judged
    telling: Telling | None


class Ranking:
    """The hypotheses judged so far, each once, and how they rank."""

    def __init__(self, subject: Subject, points: SwitchedPoints, stated: Structure) -> None:
        self._subject, self._points, self._stated = subject, points, stated
        self._at_points = subject.at(points.conditions)
        self._probes = probes(subject, points, stated)
        self._at_probes = subject.at(self._probes)
        self._judged: dict[tuple[object, ...], Judged] = {}

    def refined(self, h: Hypothesis) -> Hypothesis:
        """An estimated rotation point estimated exactly; coordinates at a named place put there."""
        if not h.fitted_point:
            return h
        subject, points, predictor = self._subject, self._points, self._at_points
        fitted = fit_rotation_point(subject, points, h, predictor)
        held = {}
        for axis, sd in fitted.sd.items():
            places = (0.0, *subject.machine(h.structure).axis(axis).travel)
            estimate = fitted.position[axis]
            near = min(places, key=lambda p: abs(p - estimate))
            if abs(near - estimate) < _NEAR * sd:
                held[axis] = near
        if held:
            fitted = fit_rotation_point(subject, points, h, predictor, held)
        rounded = {a: round(p, _DECIMALS) for a, p in fitted.position.items()}
        position = {a: p for a, p in rounded.items() if p != 0.0}
        convention = replace(h.convention, rotation_point=position)
        return replace(h, convention=convention, fitted_point=bool(fitted.sd))

    def judge(self, h: Hypothesis) -> Judged:
        """How well a hypothesis reproduces the points."""
        key = h.key()
        if key not in self._judged:
            left = self._points.difference - _signed(self._at_points, h)
            rms, worst = float(np.sqrt(np.mean(left**2))), float(np.abs(left).max())
            self._judged[key] = Judged(h, rms, worst)
        return self._judged[key]

    def ranking(self) -> list[Judged]:
        """Best first; among those that the points cannot tell apart, the simplest first."""
        judged = sorted(self._judged.values(), key=lambda j: j.rms)
        limit = self._tied_below(judged[0])
        tied = [j for j in judged if j.rms <= limit]
        tied.sort(key=lambda j: (j.hypothesis.deviations(self._stated), j.rms))
        return tied + judged[len(tied) :]

    def best(self) -> Judged:
        """The simplest of those that fit best."""
        return self.ranking()[0]

    def ties(self, best: Judged) -> list[Tie]:
        """All that fit as well as the best, with a pose that would tell."""
        limit = self._tied_below(min(self._judged.values(), key=lambda j: j.rms))
        h = best.hypothesis
        others = [
            j
            for j in self.ranking()
            if j.rms <= limit
            and j is not best
            and j.hypothesis.artefact == h.artefact
            and (h.fitted_point or not j.hypothesis.fitted_point)
        ]
        return [Tie(j, self._telling(best.hypothesis, j.hypothesis)) for j in others]

    def gain(self, h: Hypothesis) -> float:
        """The factor by which a convention's correction fits the points best, unit-free."""
        predicted = self._at_points.correction(h.structure, h.convention)
        size = float((predicted**2).sum())
        return float((predicted * self._points.difference).sum()) / size if size else 0.0

    def _tied_below(self, best: Judged) -> float:
        sigma = max(best.rms, self._points.sigma, FLOOR)
        count = 3 * self._points.n
        return float(np.sqrt(best.rms**2 + _CLEAR * sigma**2 / count))

    def _telling(self, one: Hypothesis, other: Hypothesis) -> Telling | None:
        """The pose at which two hypotheses differ most; None where nowhere by a visible amount."""
        at = self._probes
        difference = _signed(self._at_probes, one) - _signed(self._at_probes, other)
        gap = np.linalg.norm(difference, axis=1)
        bare = np.where(at.tool.any(axis=1), 0.0, gap)
        i = int((bare if bare.max() >= _TELLING else gap).argmax())
        if gap[i] < _TELLING:
            return None
        x, y, z = at.tool[i].tolist()
        return Telling({a: float(q[i]) for a, q in at.positions.items()}, (x, y, z), float(gap[i]))


def _signed(predictor: Predictor, h: Hypothesis) -> F64:
    """The differences that a hypothesis predicts, shape (n, 3), mm."""
    predicted = predictor.correction(h.structure, h.convention)
    return -predicted if h.artefact else predicted


def probes(subject: Subject, points: SwitchedPoints, structure: Structure) -> Conditions:
    """Poses all over the volume, with and without tool offsets; signals as at the points."""
    machine = subject.machine(structure)
    ends = [np.linspace(*machine.axis(a).travel, 3) for a in structure.linear]
    grid = [g.reshape(-1) for g in np.meshgrid(*ends, indexing="ij")]
    tools = np.array([[0, 0, 0], [0, 0, -150], [150, 0, 0], [0, 150, 0]], dtype=np.float64)
    n = len(grid[0])
    return Conditions.at(
        {a: np.tile(g, len(tools)) for a, g in zip(structure.linear, grid, strict=True)},
        tool=np.repeat(tools, n, axis=0),
        signals={k: float(v.mean()) for k, v in points.conditions.signals.items()},
    )
