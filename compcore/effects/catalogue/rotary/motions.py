"""Error motions of rotary axes: positioning, radial, axial, tilt (ISO 230-7)."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from functools import partial
from typing import TypeVar

import numpy as np
from pydantic import model_validator

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import (
    ABOUT,
    F64,
    AxisLetter,
    Component,
    Effect,
    ErrorMotion,
    Motion,
    Parameter,
)
from abbe.compcore.effects.keys import Harmonics, Numbers
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.shapes import Shape
from abbe.compcore.effects.targets import TRANSLATIONS, require_rotary, turned_about
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import WHOLE_TURN, Axis, Machine, own_component

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


@register
class RotaryPositioning(RotaryMotion):
    """Angular positioning error of a rotary axis, E_CC (ISO 230-2 for rotary axes).

    Formula
        ``E_CC = Σ A_h·cos(hθ) + B_h·sin(hθ)``, h = 1 … ``harmonics`` (default 2), θ the axis's
        angle; or a ``shape`` over the travel (spline:N; table with ``positions`` in degrees) where
        the error does not repeat after a turn. The mean is the zero angle of `rotary_location`.
    Parameters
    ----------
        A1, B1, … in rad (coefficients of the shape likewise), within ±500 µrad: an eccentric
        encoder ring gives one harmonic of eccentricity/radius (5 µm on 100 mm: 50 µrad), a worm one
        at its number of teeth.
    Signals
        None beyond the angle.
    Typical causes
        Eccentric or distorted encoder ring, errors of worm wheel or gear, a coupling at an angle.
    Cure
        Two reading heads opposite each other; table of angular positions (R-POS).
    Source
        ISO 230-2 (rotary axes); ISO 230-7:2015; ISO/TR 16907:2015, 6 and 8.2 (R-POS).
    """

    kind = "rotary_positioning"

    def component(self) -> Component:
        """About the axis itself."""
        return own_component(self.axis)  # type: ignore[return-value]

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[RotaryPositioning]:
        """Each rotary axis that moved, also once a turn; where it does not turn around, a curve.

        Within part of a turn waves imitate one another, with amplitudes that no ring has.
        """
        moving = [a for a in machine.structure.rotary if a in coverage.moving]
        yield from _held((cls(axis=a) for a in moving), machine, coverage)
        for axis in (machine.axis(a) for a in moving):
            if 2.0 * axis.half_travel < WHOLE_TURN:
                yield cls(axis=axis.name, shape="spline:4").held_beyond(*_of(axis, coverage))
            else:
                yield cls(axis=axis.name, harmonics=1).held_beyond(*_of(axis, coverage))


@register
class RotaryRadial(RotaryMotion):
    """Radial error motion of a rotary axis: its line wanders sideways while it turns, E_XC, E_YC.

    Formula
        ``E_dC = Σ A_h·cos(hθ) + B_h·sin(hθ)``, h = 1 … ``harmonics`` (default 2), d a direction
        across the axis; or a ``shape`` over the travel.
        On the workpiece side it is the tool's motion relative to the table: an indicator or R-test
        on the table itself shows the opposite sign.
    Parameters
    ----------
        A1, B1, … in mm, within ±50 µm; rolling bearings 1 to 5 µm, hydrostatic below 0.5 µm. The
        first harmonic of both directions together, a point that circles with the axis, is the same
        as an artefact or tool that is mounted off its centre.
    Signals
        None beyond the angle.
    Typical causes
        Out-of-round bearing seats, bearings without preload, unbalance, wear.
    Cure
        New bearings, preload; compensation R-RAX where linear axes can follow.
    Source
        ISO 230-7:2015 (radial error motion); ISO/TR 16907:2015, 6 and 8.2 (R-RAX).
    """

    kind = "rotary_radial"
    direction: AxisLetter

    def component(self) -> Component:
        """Across the axis."""
        return self.direction

    def check(self, machine: Machine) -> None:
        """A direction across the axis."""
        super().check(machine)
        _across(self.axis, self.direction, "radial error motion")

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[RotaryRadial]:
        """Two for each rotary axis that moved."""
        for axis in (a for a in machine.structure.rotary if a in coverage.moving):
            for direction in TRANSLATIONS:
                if direction != turned_about(axis):
                    at = _of(machine.axis(axis), coverage)
                    yield cls(axis=axis, direction=direction).held_beyond(*at)


@register
class RotaryAxial(RotaryMotion):
    """Axial error motion of a rotary axis: it moves along its own line while it turns, E_ZC.

    Formula
        ``E_ZC = Σ A_h·cos(hθ) + B_h·sin(hθ)``, h = 1 … ``harmonics`` (default 2); or a ``shape``
        over the travel. ``direction`` may be left out; it is the axis's own.
        On the workpiece side an indicator on the table itself shows the opposite sign.
    Parameters
    ----------
        A1, B1, … in mm, within ±50 µm; good tables 1 to 3 µm.
    Signals
        None beyond the angle.
    Typical causes
        Thrust bearing faces not square or not flat, chips under the table, wear.
    Cure
        Re-grind or exchange the thrust bearing; compensation R-RAX.
    Source
        ISO 230-7:2015 (axial error motion); ISO/TR 16907:2015, 6 and 8.2 (R-RAX).
    """

    kind = "rotary_axial"
    direction: AxisLetter | None = None

    def component(self) -> Component:
        """Along the axis."""
        return turned_about(self.axis)

    def check(self, machine: Machine) -> None:
        """The axis's own direction, if any is given."""
        super().check(machine)
        if self.direction not in (None, self.component()):
            raise InputError(
                "axial error motion is along the axis; across it the effect is 'rotary_radial'",
                field="direction",
                found=self.direction,
                expected=self.component(),
            )

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[RotaryAxial]:
        """Each rotary axis that moved."""
        moving = (a for a in machine.structure.rotary if a in coverage.moving)
        return _held((cls(axis=a) for a in moving), machine, coverage)


@register
class RotaryTilt(RotaryMotion):
    """Tilt error motion of a rotary axis: its line wobbles while it turns, E_AC, E_BC.

    Formula
        ``E_AC`` (direction X) or ``E_BC`` (direction Y) ``= Σ A_h·cos(hθ) + B_h·sin(hθ)``, a turn
        about the ``direction``, right-handed, h = 1 … ``harmonics`` (default 2); or a ``shape``
        over the travel.
        On the workpiece side a level on the table itself shows the opposite sign.
    Parameters
    ----------
        A1, B1, … in rad, within ±500 µrad; good tables 2 to 20 µrad. At the functional point it
        grows with the height above the table.
    Signals
        None beyond the angle.
    Typical causes
        Bearing planes not flat, a table bolted down unevenly, unbalance of the workpiece.
    Cure
        Scraping of the seat, preload; compensation R-ANG.
    Source
        ISO 230-7:2015 (tilt error motion); ISO/TR 16907:2015, 6 and 8.2 (R-ANG).
    """

    kind = "rotary_tilt"
    direction: AxisLetter

    def component(self) -> Component:
        """About the direction."""
        return ABOUT[self.direction]

    def check(self, machine: Machine) -> None:
        """A direction across the axis."""
        super().check(machine)
        _across(self.axis, self.direction, "tilt error motion")

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[RotaryTilt]:
        """Two for each rotary axis that moved."""
        for axis in (a for a in machine.structure.rotary if a in coverage.moving):
            for direction in TRANSLATIONS:
                if direction != turned_about(axis):
                    at = _of(machine.axis(axis), coverage)
                    yield cls(axis=axis, direction=direction).held_beyond(*at)


def _of(axis: Axis, coverage: Coverage) -> tuple[Axis, tuple[float, float] | None]:
    return axis, coverage.ends.get(axis.name)


def _held(effects: Iterable[M], machine: Machine, coverage: Coverage) -> Iterable[M]:
    return (e.held_beyond(*_of(machine.axis(e.axis), coverage)) for e in effects)


def _harmonics(angle: F64, waves: int) -> F64:
    """Cosine and sine of each wave of a turn, (n, 2 · waves)."""
    phase = np.outer(angle, np.arange(1, waves + 1))
    return np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(len(angle), -1)


def _across(axis: str, direction: str, what: str) -> None:
    own = turned_about(axis)
    if direction == own:
        raise InputError(
            f"a {what} is across the axis",
            field="direction",
            found=direction,
            expected="one of " + ", ".join(d for d in "XYZ" if d != own),
        )
