"""An error motion of a rotary axis over its angle, held beyond the arc that it was made of."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from functools import partial
from typing import TypeVar

import numpy as np
from pydantic import model_validator

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import F64, Component, Effect, ErrorMotion, Motion, Parameter
from abbe.compcore.effects.keys import Harmonics, Numbers
from abbe.compcore.effects.shapes import Shape
from abbe.compcore.effects.targets import require_rotary
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine

M = TypeVar("M", bound="RotaryMotion")

_NEARLY = 0.01
"""Part of its travel up to which an axis was read to its end."""
_STEP = 1e-3
"""Degrees to which the ends of an arc are written down."""


class RotaryMotion(Effect):
    """An error motion of a rotary axis over its angle: harmonics, or a shape.

    Beyond `within` it holds the value of that end: what part of a turn shows of a wave or a curve
    says nothing of the rest.
    """

    axis: str
    harmonics: Harmonics | None = None
    shape: str | None = None
    positions: Numbers = ()
    within: Numbers = ()

    @model_validator(mode="after")
    def _harmonics_or_shape(self) -> RotaryMotion:
        if self.shape is not None:
            if self.harmonics is not None:
                raise InputError("harmonics or a shape, not both", field="shape", found=self.shape)
            Shape.parse(self.shape, self.positions)
        elif self.positions:
            raise InputError(
                "positions belong to shapes 'table' and 'spline:auto' only", field="positions",
                expected="shape=table or spline:auto",
            )  # fmt: skip
        if self.within and not (len(self.within) == 2 and self.within[0] < self.within[1]):
            raise InputError(
                "not the ends of an arc", field="within", found=list(self.within),
                expected="two angles, degrees, the lesser first",
            )  # fmt: skip
        return self

    def component(self) -> Component:
        """The component of the error motion."""
        raise NotImplementedError

    def check(self, machine: Machine) -> None:
        """Rotary axes only."""
        super().check(machine)
        require_rotary(machine, self.axis, self.kind)
        if shape := self._shape():
            shape.check(machine.axis(self.axis))

    @property
    def waves(self) -> int:
        """The highest wave in a turn, where there is no shape."""
        return self.harmonics or 2

    def _shape(self) -> Shape | None:
        if self.shape is None:
            return None
        return Shape.parse(self.shape, tuple(float(np.deg2rad(p)) for p in self.positions))

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """Cosine and sine amplitude of each harmonic, or the shape's coefficients."""
        error_motion = ErrorMotion(self.axis, self.component())
        most = 5e-4 if error_motion.rotation else 0.05
        if shape := self._shape():
            names = shape.names
        else:
            names = tuple(f"{k}{h}" for h in range(1, self.waves + 1) for k in "AB")
        return tuple(
            Parameter(name, error_motion.unit, (-most, most), f"{error_motion}, {name}")
            for name in names
        )

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``cos hθ``, ``sin hθ`` or the shape's basis functions on the one error motion."""
        angle, axis, shape = conditions.position(self.axis), machine.axis(self.axis), self._shape()
        of: Hashable = (axis, shape) if shape is not None else (self.axis, self.waves)
        columns = conditions.cached(
            ("rotary", of, self.within), angle, partial(self._columns, angle, axis, shape)
        )
        return (Motion(ErrorMotion(self.axis, self.component()), columns),)

    def _columns(self, angle: F64, axis: Axis, shape: Shape | None) -> F64:
        if self.within:
            low, high = np.deg2rad(self.within)
            if shape is None:  # a wave comes again after a turn
                middle = 0.5 * (low + high)
                angle = middle + np.remainder(angle - middle + np.pi, 2.0 * np.pi) - np.pi
            angle = np.clip(angle, low, high)
        return _harmonics(angle, self.waves) if shape is None else shape.basis(angle, axis)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """The axis itself, unless its shape is constant."""
        return () if self.shape == "constant" else (self.axis,)

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """None for harmonics; a table's positions, or the ends of the travel; those of `within`."""
        shape, ends = self._shape(), tuple(float(e) for e in np.deg2rad(self.within))
        if shape is not None and shape.family != "constant":
            ends = tuple(sorted({*ends, *shape.kinks(machine.axis(self.axis))}))
        return {self.axis: ends} if ends else {}

    def held_beyond(self: M, axis: Axis, ends: tuple[float, float] | None) -> M:
        """The same, held beyond where the axis was read, rad, if it was made of part of a turn.

        A curve is made of what was read; of a wave of a turn less than a quarter is a parabola. A
        table holds its ends by itself.
        """
        none = self.model_copy(update={"within": ()}) if self.within else self
        if ends is None or not ends[0] < ends[1] or self.shape in ("constant", "table"):
            return none
        if self.shape is None and ends[1] - ends[0] >= 0.5 * np.pi:
            return none
        slack = _NEARLY * 2.0 * axis.half_travel
        if self.shape and ends[0] <= axis.travel[0] + slack and ends[1] >= axis.travel[1] - slack:
            return none
        low, high = np.rad2deg(ends) / _STEP
        within = (round(float(np.floor(low)) * _STEP, 3), round(float(np.ceil(high)) * _STEP, 3))
        return self.model_copy(update={"within": within})


def read_of(axis: Axis, coverage: Coverage) -> tuple[Axis, tuple[float, float] | None]:
    """An axis and between which of its places it was read, as `held_beyond` takes them."""
    return axis, coverage.ends.get(axis.name)


def held(effects: Iterable[M], machine: Machine, coverage: Coverage) -> Iterable[M]:
    """Error motions, each held beyond where its axis was read."""
    return (e.held_beyond(*read_of(machine.axis(e.axis), coverage)) for e in effects)


def _harmonics(angle: F64, waves: int) -> F64:
    """Cosine and sine of each wave of a turn, (n, 2 · waves)."""
    phase = np.outer(angle, np.arange(1, waves + 1))
    return np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(len(angle), -1)
