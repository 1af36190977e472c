"""Measurement equations: displacement, rotation and distance as functions of error motions."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.effects.base import INSTRUMENT, ErrorMotion
from abbe.compcore.fitting.design.turned_frames import Seen, TurnedFrames
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.exact_slopes import ExactSlopes
from abbe.compcore.machine.kinematics import Chain, exact, first_order
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Composition

F64 = NDArray[np.float64]


class Observation:
    """The measurement equations of a campaign's rows, for given base points and tools.

    A displacement is ``u·e`` with e the error of the functional point, a rotation ``u·ω``, a
    distance ``|P + e − b|`` from base point b to the functional point, a base distance
    ``|b − b2|``.

    Parameters
    ----------
    machine, campaign, conditions
        `conditions` are the campaign's, with the tools' offsets in place.
    bases
        Name → coordinates, mm, workpiece frame.
    chain
        The machine at these conditions, where it is known.
    """

    def __init__(
        self,
        machine: Machine,
        campaign: Campaign,
        conditions: Conditions,
        bases: Mapping[str, F64],
        chain: Chain | None = None,
    ) -> None:
        self.chain = Chain(machine, conditions) if chain is None else chain
        kind = campaign.kind
        n = conditions.n
        u = np.zeros((n, 3)) if conditions.u is None else conditions.u
        displacement = kind == Kind.DISPLACEMENT
        rotation = kind == Kind.ROTATION
        self.distance = np.flatnonzero(kind == Kind.DISTANCE)
        self.base_distance = np.flatnonzero(kind == Kind.BASE_DISTANCE)
        self._toward = u if displacement.all() else np.where(displacement[:, None], u, 0.0)
        self._about = np.where(rotation[:, None], u, 0.0) if rotation.any() else None
        self._seen: dict[ErrorMotion, F64] = {}
        self._slopes: ExactSlopes | None = None
        self._exact: tuple[Mapping[ErrorMotion, F64], F64, F64] | None = None
        self.between = np.zeros((n, 3))
        """Row → unit vector base → point (or base2 → base), workpiece frame; 0 on other rows."""
        self._vector = np.zeros((n, 3))
        if self.distance.size or self.base_distance.size:
            self._see_bases(conditions, campaign.base2, bases)

    def _see_bases(
        self, conditions: Conditions, second: NDArray[np.str_], bases: Mapping[str, F64]
    ) -> None:
        first = conditions.base
        if first is None:
            raise ValueError("distances need the column of base points")
        one, two = _coordinates(first, bases), _coordinates(second, bases)
        i, j = self.distance, self.base_distance
        self._vector[i] = self.chain.point[i] - one[i]
        self._vector[j] = one[j] - two[j]
        used = np.concatenate([i, j])
        lengths = np.linalg.norm(self._vector[used], axis=1, keepdims=True)
        self.between[used] = self._vector[used] / np.maximum(lengths, 1e-300)
        toward = np.zeros_like(self._toward)
        toward[i] = self.between[i]
        self._toward = self._toward + self.chain.to_machine_axes(toward)

    def tangent(
        self, motions: Mapping[ErrorMotion, F64], frames: TurnedFrames | None = None
    ) -> Observation:
        """The same equations, whose derivatives are those of the exact error where motions stand.

        Each of the motions is (n,), mm or rad. A turn of a degree turns the levers behind it, so by
        the lever rule alone a search for the least squares would go astray. So does an instrument
        that is turned, which `frames` say.
        """
        other = copy.copy(self)
        other._seen = {}
        other._slopes = ExactSlopes(self.chain, motions)
        if frames is not None:
            toward = frames.back(self.chain.to_workpiece(self._toward))
            other._toward = self.chain.to_machine_axes(toward)
        return other

    @property
    def toward(self) -> F64:
        """The direction in which each row measures displacement, (n, 3), machine axes."""
        return self._toward

    @property
    def about(self) -> F64:
        """The direction about which each row measures rotation, (n, 3)."""
        return np.zeros_like(self._toward) if self._about is None else self._about

    def sensitivity(self, error_motion: ErrorMotion) -> F64:
        """The derivative of the measured values by one error motion, shape (n,).

        mm or rad of value per mm or rad of motion: by the lever rule, or of a `tangent`.
        """
        if error_motion not in self._seen:
            if error_motion.place == INSTRUMENT:
                self._seen[error_motion] = np.ones(self._toward.shape[0])
            else:
                slopes = self.chain if self._slopes is None else self._slopes
                moved, turned = slopes.influence(error_motion)
                seen = np.einsum("ni,ni->n", self._toward, moved)
                if error_motion.rotation and self._about is not None:
                    seen += np.einsum("ni,ni->n", self._about, turned)
                self._seen[error_motion] = seen
        return self._seen[error_motion]

    def values(
        self,
        motions: Mapping[ErrorMotion, F64],
        composition: Composition,
        frames: TurnedFrames | None = None,
    ) -> F64:
        """The measured values for given error motions (each (n,), mm or rad), shape (n,).

        mm, or rad for rotations; distances in full, not to first order. `frames` say how the
        set-ups' instruments stand, where they are turned in full.
        """
        if composition == "first-order" and not self.distance.size and not self.base_distance.size:
            return self._first_order_sum(motions)
        return self._read(motions, *self.errors(motions, composition), frames)

    def errors(
        self, motions: Mapping[ErrorMotion, F64], composition: Composition
    ) -> tuple[F64, F64]:
        """Error of the functional point, mm, and of its orientation, rad; (n, 3), machine axes."""
        machine = {c: v for c, v in motions.items() if c.place != INSTRUMENT}
        if composition == "first-order":
            return first_order(self.chain, machine)
        kept = self._exact
        if (
            kept is None
            or kept[0].keys() != machine.keys()
            or any(kept[0][c] is not v for c, v in machine.items())
        ):
            error, orientation = exact(self.chain, machine)
            skew = orientation - np.swapaxes(orientation, 1, 2)
            turn = 0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
            kept = self._exact = (machine, error, turn)
        return kept[1], kept[2]

    def _read(
        self,
        motions: Mapping[ErrorMotion, F64],
        error: F64,
        turn: F64,
        frames: TurnedFrames | None = None,
    ) -> F64:
        total: F64 = np.einsum("ni,ni->n", self._toward, error)
        if self._about is not None:
            total += np.einsum("ni,ni->n", self._about, turn)
        if frames is not None:
            total += self._by_frames(error, frames)
        reached = self._vector + self.chain.to_workpiece(error)
        total[self.distance] = np.linalg.norm(reached[self.distance], axis=1)
        total[self.base_distance] = np.linalg.norm(self._vector[self.base_distance], axis=1)
        for error_motion, value in motions.items():
            if error_motion.place == INSTRUMENT:
                total += value
        return total

    def seen(self, motions: Mapping[ErrorMotion, F64], value: F64) -> Seen:
        """What the rows see of errors composed in full, for how their instruments stand.

        `value` is what they read, (n,), mm or rad.
        """
        chain = self.chain
        error, turn = self.errors(motions, "exact")
        left = value - self._read(motions, error, turn)
        toward, about = (chain.to_workpiece(v) for v in (self._toward, self.about))
        actual = chain.point + chain.to_workpiece(error)
        return Seen(chain.point, actual, toward, about, left)

    def _by_frames(self, error: F64, frames: TurnedFrames) -> F64:
        """What instruments that are turned see more, (n,); error (n, 3) mm, machine axes."""
        chain = self.chain
        actual = chain.point + chain.to_workpiece(error)
        moved = chain.to_machine_axes(frames.placed(actual) - actual)
        more: F64 = np.einsum("ni,ni->n", self._toward, moved)
        if self._about is not None:
            more += frames.turned(chain.to_workpiece(self._about))
        return more

    def _first_order_sum(self, motions: Mapping[ErrorMotion, F64]) -> F64:
        total = np.zeros(self._toward.shape[0])
        for error_motion, value in motions.items():
            total += self.sensitivity(error_motion) * value
        return total

    def base_sign(self, campaign: Campaign, name: str) -> F64:
        """The derivative of each row by a base point's move along `between`: −1, 1 or 0, (n,)."""
        sign = np.zeros(campaign.n)
        i, j = self.distance, self.base_distance
        if campaign.conditions.base is not None:
            first = campaign.conditions.base == name
            sign[i] -= first[i]
            sign[j] += first[j]
        sign[j] -= (campaign.base2 == name)[j]
        return sign

    def tool_direction(self, k: int) -> F64:
        """The displacement of the functional point by 1 mm of tool offset component k, (n, 3).

        Machine axes; turns with rotary axes and with the spindle.
        """
        unit = np.zeros((self.chain.conditions.n, 3))
        unit[:, k] = 1.0
        ends = [self.chain.with_tool(tool).point for tool in (unit, np.zeros_like(unit))]
        return self.chain.to_machine_axes(ends[0] - ends[1])

    def turned(self, vector: F64, motions: Mapping[ErrorMotion, F64]) -> F64:
        """By how much the errors turn a vector that is fixed to the tool, (n, 3), machine axes."""
        if self._slopes is not None:
            turned: F64 = np.einsum("nij,nj->ni", self._slopes.orientation, vector)
            return turned - vector
        return np.cross(self.rotation_error(motions), vector)

    def rotation_error(self, motions: Mapping[ErrorMotion, F64]) -> F64:
        """Error of the functional orientation, (n, 3) rad, machine axes, to first order."""
        machine = {c: v for c, v in motions.items() if c.rotation}
        return first_order(self.chain, machine)[1]


def with_tools(
    conditions: Conditions, tool_name: NDArray[np.str_], offsets: Mapping[str, F64]
) -> Conditions:
    """Conditions in which the rows of named tools have those tools' offsets (mm)."""
    if not offsets:
        return conditions
    tool = conditions.tool.copy()
    for name, offset in offsets.items():
        tool[tool_name == name] = offset
    return replace(conditions, tool=tool)


def _coordinates(names: NDArray[np.str_], bases: Mapping[str, F64]) -> F64:
    out = np.zeros((names.shape[0], 3))
    for name, position in bases.items():
        out[names == name] = position
    return out
