"""Frames: the few rows, or places of an axis, that can determine a candidate's columns at all.

An error motion is seen by some rows only: a line along X is blind to errors in Y. And what depends
on an axis's position alone has one value at each position at which the axis stood, however many
rows were measured there. So columns are made and tested in coordinates of a frame: the rows that
see an error motion, or these rows' sums by position. Orthonormal directions of the rows' space
give the same inner products as the rows themselves, at a fraction of the work.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.candidates import Candidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.screening.projection.frame import Frame, Placed
from abbe.compcore.effects.base import Motion
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.model.reads import reads_of

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_MANY_CHOICES = 8
"""Choices of non-linear parameters from which on it pays to ask whether positions are enough."""

_FEWER = 0.5
"""Part of the rows below which an axis's positions are few."""


@dataclass(frozen=True, eq=False)
class Places:
    """The rows by what some quantities were there: an axis's positions, two axes' directions.

    Attributes
    ----------
    number
        Each row's place, shape (n,).
    first
        One row of each place, (places,).
    """

    number: Index
    first: Index

    @classmethod
    def of(cls, quantities: Sequence[F64]) -> Places:
        """The places at which quantities, (n,) each, have the same values."""
        number = np.zeros(len(quantities[0]), dtype=np.int64)
        for value in quantities:
            own = np.unique(value, return_inverse=True)[1].reshape(-1)
            joint = number * (int(own.max(initial=0)) + 1) + own
            number = np.unique(joint, return_inverse=True)[1].reshape(-1)
        return cls(number, np.unique(number, return_index=True)[1])

    @property
    def few(self) -> bool:
        """Whether they are so few that it pays to look at places instead of rows."""
        return len(self.first) <= _FEWER * len(self.number)


class Frames:
    """Candidates' columns beside a fitted model, each in the smallest frame that holds it.

    Parameters
    ----------
    problem, theta
        The model and campaign, and where base points, tools and effects' values stand.
    fitted
        The basis of the fitted model.
    """

    def __init__(self, problem: Problem, theta: F64, fitted: Basis) -> None:
        self._problem, self._theta, self._fitted = problem, theta, fitted
        self._by_rows: dict[bytes, Frame] = {}
        self._seen: dict[ErrorMotion, tuple[Frame, F64]] = {}
        self._at_places: dict[tuple[ErrorMotion, Places], tuple[Frame, F64]] = {}
        self._enough: dict[int, tuple[Places, Conditions] | None] = {}
        self._by_names: dict[frozenset[str], tuple[Places, Conditions]] = {}

    @property
    def weight(self) -> F64:
        """1/sd of each row, shape (n,)."""
        return self._problem.weight

    def seen(self, error_motion: ErrorMotion) -> tuple[Frame, F64]:
        """The rows that see an error motion, and its weighted part in each of them."""
        if error_motion not in self._seen:
            part = self._weighted(error_motion)
            rows = np.flatnonzero(part)
            key = rows.tobytes()
            if key not in self._by_rows:
                self._by_rows[key] = Frame.of_rows(self._fitted, rows)
            self._seen[error_motion] = (self._by_rows[key], part[rows])
        return self._seen[error_motion]

    def _weighted(self, error_motion: ErrorMotion) -> F64:
        seen = self._problem.tangent(self._theta).sensitivity(error_motion)
        return np.asarray(seen * self._problem.weight)

    def columns(self, candidate: Candidate, nonlinear: Mapping[str, float]) -> F64 | Placed:
        """A candidate's weighted columns, (n, k), or what a frame holds of them."""
        effect, problem = candidate.effect, self._problem
        if effect.scope == "instrument":
            return problem.effect_columns(effect, nonlinear, candidate.at(self._theta))
        enough = self._places_for(candidate)
        if enough is not None:
            places, few = enough
            motions = effect.motions(problem.model.machine, few, nonlinear)
            if len(motions) == 1:
                frame, size = self.at(motions[0].error_motion, places)
                return Placed(frame, size[:, None] * motions[0].columns)
        motions = problem.effect_motions(effect, nonlinear, self._theta)
        if len(motions) != 1:
            return problem.stacked(motions, len(effect.linear(problem.model.machine)), self._theta)
        return self._one(motions[0])

    def _one(self, motion: Motion) -> Placed:
        frame, part = self.seen(motion.error_motion)
        return Placed(frame, part[:, None] * motion.columns[frame.rows])

    def _places_for(self, candidate: Candidate) -> tuple[Places, Conditions] | None:
        """Places that are few and all that a candidate of many choices asks for."""
        key = id(candidate)
        if key not in self._enough:
            names = self._read_by(candidate)
            found = None if names is None else self._named(names)
            self._enough[key] = found if found is not None and found[0].few else None
        return self._enough[key]

    def _read_by(self, candidate: Candidate) -> frozenset[str] | None:
        """Axes whose positions, and with a sign directions, a candidate reads; None if more."""
        effect = candidate.effect
        many = len(candidate.choices) >= _MANY_CHOICES
        if not many or effect.signals_needed() or effect.reads_model:
            return None
        machine, conditions = self._problem.model.machine, self._problem.campaign.conditions
        first = conditions.rows(np.arange(min(2, conditions.n)))
        read = reads_of(lambda c: effect.motions(machine, c, candidate.choices[0]), first)
        if read.slow or not (read.positions or read.directions):
            return None
        return frozenset(read.positions | {f"±{a}" for a in read.directions})

    def _named(self, names: frozenset[str]) -> tuple[Places, Conditions]:
        if names not in self._by_names:
            conditions = self._problem.conditions(self._theta)
            quantities = [
                conditions.direction(name[1:]) if name[0] == "±" else conditions.position(name)
                for name in sorted(names)
            ]
            places = Places.of(quantities)
            self._by_names[names] = places, conditions.rows(places.first)
        return self._by_names[names]

    def at(self, error_motion: ErrorMotion, places: Places) -> tuple[Frame, F64]:
        """The frame of an error motion's sums at places, and each direction's length, (places,)."""
        key = (error_motion, places)
        if key not in self._at_places:
            part = self._weighted(error_motion)
            count = len(places.first)
            size = np.sqrt(np.bincount(places.number, weights=part * part, minlength=count))
            rows = np.flatnonzero(part)
            rows = rows[np.argsort(places.number[rows], kind="stable")]
            number = places.number[rows]
            unit = part[rows] / size[number]
            frame = Frame.of_places(self._fitted, rows, number, unit, count)
            self._at_places[key] = (frame, size)
        return self._at_places[key]
