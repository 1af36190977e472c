"""Ranking of hypotheses by exact residuals, ties, and the pose that would decide."""

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
class RankedHypothesis:
    """A hypothesis with its residuals at the points: root mean square and largest, mm.

    Attributes
    ----------
    rms, worst
        Over all components of all points, mm.
    """

    hypothesis: Hypothesis
    rms: float
    worst: float


@dataclass(frozen=True)
class DistinguishingPose:
    """A pose at which two hypotheses differ, and by how much; positions, tool, difference: mm."""

    positions: dict[str, float]
    tool: tuple[float, float, float]
    difference: float


@dataclass(frozen=True)
class Tie:
    """A hypothesis that reproduces the points as well as the best one.

    `telling` is a pose that would tell the two apart, without a tool offset if there is one; None
    where no pose in the volume would.
    """

    judged: RankedHypothesis
    telling: DistinguishingPose | None


class Ranking:
    """The hypotheses whose exact residuals are known, each once, in order."""

    def __init__(self, subject: Subject, points: SwitchedPoints, stated: Structure) -> None:
        self._subject, self._points, self._stated = subject, points, stated
        self._at_points = subject.at(points.conditions)
        self._probes = probes(subject, points, stated)
        self._at_probes = subject.at(self._probes)
        self._judged: dict[tuple[object, ...], RankedHypothesis] = {}

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

    def judge(self, h: Hypothesis) -> RankedHypothesis:
        """The exact residuals of a hypothesis at the points."""
        key = h.key()
        if key not in self._judged:
            left = self._points.difference - _signed(self._at_points, h)
            rms, worst = float(np.sqrt(np.mean(left**2))), float(np.abs(left).max())
            self._judged[key] = RankedHypothesis(h, rms, worst)
        return self._judged[key]

    def ranking(self) -> list[RankedHypothesis]:
        """Hypotheses by residual; of those that the points cannot tell apart the simplest first."""
        judged = sorted(self._judged.values(), key=lambda j: j.rms)
        limit = self._tied_below(judged[0])
        tied = [j for j in judged if j.rms <= limit]
        tied.sort(key=lambda j: (j.hypothesis.deviations(self._stated), j.rms))
        return tied + judged[len(tied) :]

    def best(self) -> RankedHypothesis:
        """The simplest of the hypotheses with the least residual."""
        return self.ranking()[0]

    def ties(self, best: RankedHypothesis) -> list[Tie]:
        """All hypotheses with as small a residual, each with a pose that would decide."""
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
        """The factor by which a convention's correction fits the points best; −1: opposite sign."""
        predicted = self._at_points.correction(h.structure, h.convention)
        size = float((predicted**2).sum())
        return float((predicted * self._points.difference).sum()) / size if size else 0.0

    def _tied_below(self, best: RankedHypothesis) -> float:
        sigma = max(best.rms, self._points.sigma, FLOOR)
        count = 3 * self._points.n
        return float(np.sqrt(best.rms**2 + _CLEAR * sigma**2 / count))

    def _telling(self, one: Hypothesis, other: Hypothesis) -> DistinguishingPose | None:
        """The pose at which two hypotheses differ most; None where nowhere by a visible amount."""
        at = self._probes
        difference = _signed(self._at_probes, one) - _signed(self._at_probes, other)
        gap = np.linalg.norm(difference, axis=1)
        bare = np.where(at.tool.any(axis=1), 0.0, gap)
        i = int((bare if bare.max() >= _TELLING else gap).argmax())
        if gap[i] < _TELLING:
            return None
        x, y, z = at.tool[i].tolist()
        return DistinguishingPose(
            {a: float(q[i]) for a, q in at.positions.items()}, (x, y, z), float(gap[i])
        )


def _signed(predictor: Predictor, h: Hypothesis) -> F64:
    """The differences that a hypothesis predicts, shape (n, 3), mm."""
    predicted = predictor.correction(h.structure, h.convention)
    return -predicted if h.artefact else predicted


def probes(subject: Subject, points: SwitchedPoints, structure: Structure) -> Conditions:
    """Poses over the whole volume, with and without tool offset; signals as at the points."""
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
