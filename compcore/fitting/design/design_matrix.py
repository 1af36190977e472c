"""The design matrix: what each unknown of a model does to each measured row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect, ErrorMotion, Motion
from abbe.compcore.fitting.design.find_frames import turned_frames
from abbe.compcore.fitting.design.nuisance import SetupNuisances, setup_blocks
from abbe.compcore.fitting.design.observation import Observation
from abbe.compcore.fitting.design.prepared_rows import PreparedRows
from abbe.compcore.fitting.design.row_blocks import rows_at_once
from abbe.compcore.fitting.design.turned_frames import Seen, TurnedFrames

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_NEVER = 1e-9
"""Part of a believable beginning that is none."""

FURTHEST = 2.0
"""Likely distances from its signal beyond which no body is, however much the rows ask for it."""


class Problem(PreparedRows):
    """The least-squares problem of a model and a campaign, for fit, comparison and diagnosis.

    What it is made of, and its unknowns θ: `PreparedRows`.
    """

    def start_columns(self, term: int, nonlinear: Mapping[str, float], theta: F64) -> F64:
        """Weighted columns of where a term's bodies began, run by run, (n, unknowns)."""
        starts = self.layout.starts_of(term)
        if not starts:
            return np.zeros((self.n, 0))
        each = self.stacked(self.settling(term, nonlinear), self.layout.linear_counts[term], theta)
        conditions = self.campaign.conditions
        return np.hstack([each[:, : s.count] * s.rows(conditions)[:, None] for s in starts])

    def expect_starts(self, theta: F64) -> None:
        """Expect bodies to begin as near to their signals as warmth lets them, by θ's parameters.

        A campaign that is compared must not turn any drift into a body that nobody knows.
        """
        for start in self.layout.starts:
            own = theta[self.layout.linear_of(start.term)][: start.count]
            felt = np.abs(own) * start.span
            least = _NEVER * self.layout.scale[start.where]
            self.prior_sd[start.where] = np.maximum(felt, least)

    def believable(self, theta: F64) -> tuple[F64, Index]:
        """θ with what is expected near 0 no further away than it can be, and what was beyond."""
        limit = FURTHEST * self.prior_sd
        held = np.clip(theta, -limit, limit)
        return held, np.flatnonzero(np.abs(theta) >= limit)

    def start_index(self, term: int) -> Index:
        """Where `start_columns` stand in θ."""
        parts = [np.arange(s.where.start, s.where.stop) for s in self.layout.starts_of(term)]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)

    def effect_columns(
        self, effect: Effect, nonlinear: Mapping[str, float], theta: F64 | None = None
    ) -> F64:
        """Weighted columns of any effect, in the model or not, shape (n, k).

        Parameters
        ----------
        effect
            The effect; `nonlinear` its non-linear parameters by name.
        theta
            Where base points and tools stand, and the values of the model's effects for an effect
            that acts through them; default: start.
        """
        theta = self.start() if theta is None else theta
        found = self.effect_motions(effect, nonlinear, theta)
        return self.stacked(found, len(effect.linear(self.model.machine)), theta)

    def stacked(self, motions: tuple[Motion, ...], count: int, theta: F64) -> F64:
        """Weighted columns of error motions moved by `count` parameters, (n, count)."""
        return self._stack(self.tangent(theta), motions, count)

    def tangent(self, theta: F64) -> Observation:
        """The measurement equations at θ, for derivatives; `observation` where errors add up."""
        observation = self.observation(theta)
        if self.model.composition == "first-order":
            return observation
        key = theta.tobytes()
        if self._tangent is None or self._tangent[0] != key:
            motions, frames = self.error_motions(theta), self.frames(theta)
            self._tangent = (key, observation.tangent(motions, frames))
        return self._tangent[1]

    def frames(self, theta: F64) -> TurnedFrames | None:
        """How set-ups' instruments stand in full; None where errors add up, or none is free."""
        if self.model.composition == "first-order" or not self.framed:
            return None
        key = theta.tobytes()
        if self._frames is None or self._frames[0] != key:
            self._frames = (key, self._stand(theta))
        return self._frames[1]

    def _stand(self, theta: F64) -> TurnedFrames | None:
        blocks = super().setups(theta)
        step = 1 + self.n // rows_at_once(self.layout.size + 1)
        if step == 1:
            near = None if self._frames is None else self._frames[1]
            return turned_frames(self.campaign, self.weight, blocks, self._sights(theta), near)
        few = super().part(np.arange(0, self.n, step), theta).frames(theta)
        return None if few is None else few.on([(b.setup, b.rows) for b in blocks], self.n)

    def _sights(self, theta: F64) -> Seen:
        return self.observation(theta).seen(self.error_motions(theta), self.campaign.value)

    def part(self, rows: Index, theta: F64) -> Self:
        """The problem of some of the rows with the same unknowns; keeps nothing of this one."""
        other = super().part(rows, theta)
        frames = self.frames(theta)
        if frames is not None:
            other._frames = (theta.tobytes(), frames.rows(rows))
        return other

    def setups(self, theta: F64) -> list[SetupNuisances]:
        """The nuisance columns of each set-up, unweighted, where its instrument stands."""
        frames = self.frames(theta)
        if frames is None:
            return super().setups(theta)
        if self._turned is None or self._turned[0] is not frames:
            placed = frames.placed(self._sights(theta).actual)
            rows = [(b.setup, b.rows) for b in super().setups(theta)]
            found = setup_blocks(self.campaign, self.observation(theta), rows, placed)
            self._turned = (frames, found)
        return self._turned[1]

    def _stack(self, observation: Observation, motions: tuple[Motion, ...], count: int) -> F64:
        if len(motions) == 1 and motions[0].columns.shape[1] == count:
            seen = observation.sensitivity(motions[0].error_motion) * self.weight
            return np.asarray(seen[:, None] * motions[0].columns)
        out = np.zeros((self.n, count))
        for motion in motions:
            seen = observation.sensitivity(motion.error_motion) * self.weight
            where = slice(motion.first, motion.first + motion.columns.shape[1])
            out[:, where] += seen[:, None] * motion.columns
        return out

    def start(self) -> F64:
        """Start values of θ, shape (m,)."""
        return self.layout.start(self.campaign)

    def columns(self, theta: F64) -> F64:
        """∂(weighted value)/∂θ without the set-ups' nuisances, shape (n, layout.size)."""
        layout = self.layout
        observation = self.tangent(theta)
        out = np.zeros((self.n, layout.size), order="F")
        for i in range(len(self.model.effects)):
            linear = layout.linear_of(i)
            own = self._stack(observation, self.motions(i, theta), layout.linear_counts[i])
            out[:, linear] = own
            for k in layout.nonlinear_of(i):
                if layout.searched[k].smooth:
                    out[:, k] = self._slope(i, k, theta)
            if layout.starts:
                nonlinear = layout.nonlinear_values(i, theta)
                out[:, self.start_index(i)] = self.start_columns(i, nonlinear, theta)
        if layout.bases or layout.tools:
            self._place_columns(out, theta, observation)
        return out

    def _slope(self, term: int, k: int, theta: F64) -> F64:
        """∂(weighted value)/∂θ_k of a non-linear parameter by central differences, (n,)."""
        effect, parameter = self.model.effects[term], self.layout.searched[k]
        low, high = parameter.bounds
        step = min(1e-4 * (high - low), 1e-4 * max(abs(theta[k]), 1.0))
        here = min(max(theta[k], low), high)
        ends, places = [], []
        for sign in (1.0, -1.0):
            moved = theta.copy()
            moved[k] = min(max(here + sign * step, low), high)
            nonlinear = self.layout.nonlinear_values(term, moved)
            end = self.effect_columns(effect, nonlinear, theta) @ theta[self.layout.linear_of(term)]
            began = self.start_columns(term, nonlinear, theta) @ theta[self.start_index(term)]
            ends.append(end + began)
            places.append(moved[k])
        return np.asarray((ends[0] - ends[1]) / (places[0] - places[1]))

    def _place_columns(self, out: F64, theta: F64, observation: Observation) -> None:
        campaign, layout = self.campaign, self.layout
        weighted = observation.between * self.weight[:, None]
        for name, where in layout.bases.items():
            sign = observation.base_sign(campaign, name)
            out[:, where] = weighted * sign[:, None]
        if layout.tools:
            motions = self.error_motions(theta)
            is_distance = np.zeros(self.n, dtype=np.bool_)
            is_distance[observation.distance] = True
            for name, (where, free) in layout.tools.items():
                used = campaign.tool_name == name
                for column, k in zip(range(where.start, where.stop), free, strict=True):
                    if k not in self._tool_directions:
                        self._tool_directions[k] = observation.tool_direction(k)
                    nominal = self._tool_directions[k] * used[:, None]
                    moved = observation.turned(nominal, motions) + nominal * is_distance[:, None]
                    seen = np.einsum("ni,ni->n", observation.toward, moved)
                    out[:, column] = seen * self.weight

    def nuisances(self, theta: F64, weighted: F64) -> dict[str, dict[str, tuple[float, str]]]:
        """What is found of set-ups' nuisances: set-up → name → (value, unit).

        `weighted` are the weighted residuals at θ, (n,), with the nuisances' part still in them.
        """
        found = self.eliminator(theta).values(weighted)
        frames = self.frames(theta)
        for setup, stands in ({} if frames is None else frames.values).items():
            found[setup].update(stands)
        return found

    def jacobian(self, theta: F64) -> F64:
        """Weighted ∂value/∂(θ, nuisances), dense, shape (n, layout.size + q)."""
        blocks = self.setups(theta)
        nuisances = np.zeros((self.n, sum(len(b.names) for b in blocks)))
        at = 0
        for block in blocks:
            k = len(block.names)
            nuisances[block.rows, at : at + k] = block.columns * self.weight[block.rows, None]
            at += k
        return np.hstack([self.columns(theta), nuisances])

    def error_motions(self, theta: F64) -> dict[ErrorMotion, F64]:
        """Every error motion that θ's effects move, instrument's included, each (n,) mm or rad."""
        key = theta.tobytes()
        if self._moved is None or self._moved[0] != key:
            self._moved = (key, self._sums(theta))
        return dict(self._moved[1])

    def _sums(self, theta: F64) -> dict[ErrorMotion, F64]:
        sums: dict[ErrorMotion, F64] = {}
        for i, effect in enumerate(self.model.effects):
            if effect.reads_model:
                continue  # it acts through the amended conditions
            coefficients = theta[self.layout.linear_of(i)]
            for motion in self.motions(i, theta):
                value = motion.amount(coefficients)
                old = sums.get(motion.error_motion)
                sums[motion.error_motion] = value if old is None else old + value
        for i in {start.term: None for start in self.layout.starts}:
            for motion in self.settling(i, self.layout.nonlinear_values(i, theta)):
                for start in self.layout.starts_of(i):
                    began = np.zeros(self.layout.linear_counts[i])
                    began[: start.count] = theta[start.where]
                    value = motion.amount(began)
                    value = value * start.rows(self.campaign.conditions)
                    sums[motion.error_motion] = sums.get(motion.error_motion, 0.0) + value
        return sums

    def predicted(self, theta: F64) -> F64:
        """Predicted readings of the rows without set-ups' nuisances, shape (n,), mm or rad.

        Of the last θ they are kept: a search looks at a place, and then begins from there.
        """
        key = theta.tobytes()
        if self._read is None or self._read[0] != key:
            values = self._predicted(theta)
            values.flags.writeable = False
            self._read = (key, values)
        return self._read[1]

    def _predicted(self, theta: F64) -> F64:
        if self.large:
            out = np.empty(self.n)
            most = rows_at_once(self.layout.size + 1)
            for at in range(0, self.n, most):
                rows = np.arange(at, min(at + most, self.n))
                part = self.part(rows, theta)
                out[rows] = part._values(theta)
            return out
        return self._values(theta)

    def _values(self, theta: F64) -> F64:
        motions = self.error_motions(theta)
        return self.observation(theta).values(motions, self.model.composition, self.frames(theta))

    def residual(self, theta: F64) -> F64:
        """Weighted measured − predicted, set-ups' nuisances not yet taken out, shape (n,)."""
        return (self.campaign.value - self.predicted(theta)) * self.weight
