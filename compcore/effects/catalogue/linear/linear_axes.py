"""Geometry of linear axes: positioning, scale, straightness, angles, squareness (ISO 230-1)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import (
    ABOUT,
    AxisLetter,
    Component,
    Effect,
    ErrorMotion,
    Motion,
    Parameter,
)
from abbe.compcore.effects.catalogue.shaped import ShapedEffect
from abbe.compcore.effects.keys import Pair
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.targets import TRANSLATIONS, along, require_linear
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.machine.structure import is_rotary


@register
class Positioning(ShapedEffect):
    """Positioning error of a linear axis, of X: E_XX (ISO 230-1, 3.4.3; ISO 230-2).

    The axis arrives short of, or beyond, the place that its scale shows, by an amount that depends
    on where along its travel it stands.

    Formula
        ``E_aa(q_a) = Σ c_i·B_i(q_a)``, B the basis functions of the shape.
    Parameters
        Coefficients in mm. On a sound machine within ±0.2 mm: larger values are a wrong unit, a
        wrong scale factor or a lost reference.
    Signals
        None beyond the axis's position.
    Typical causes
        Division errors of a glass scale, pitch errors of a ball screw, a scale strained by its
        case.
    Cure
        Compensation table of positioning (L-POS); a new scale or screw when it grows.
    Source
        ISO 230-1:2012, 3.4.3; ISO/TR 16907:2015, 6.
    """

    kind = "positioning"

    def component(self) -> Component:
        """Along the axis itself."""
        return own_component(self.axis)  # type: ignore[return-value]

    def check(self, machine: Machine) -> None:
        """Linear axes only."""
        super().check(machine)
        require_linear(machine, self.axis, self.kind)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Positioning]:
        """One for each linear axis that moved."""
        return (cls(axis=a) for a in machine.structure.linear if a in coverage.moving)


@register
class Scale(Effect):
    """Scale factor of a linear axis: a positioning error that grows evenly along the travel.

    Formula
        ``E_aa = k·q_a``, q_a counted from the axis's zero.
    Parameters
        k, unit-free (shown in ppm). Within ±1000 ppm; beyond that the counts per millimetre or the
        lead of the screw are entered wrongly.
    Signals
        None beyond the axis's position.
    Typical causes
        Scale or screw at another temperature than when it was calibrated; a laser whose
        environmental compensation was off; a strained scale.
    Cure
        Scale factor in the controller, or a positioning table.
    Source
        ISO 230-1:2012, 3.4.3; Zhang et al., CIRP Annals 34/1 (1985).
    """

    kind = "scale"
    carries = True
    axis: str

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The factor k."""
        return (Parameter("k", "1", (-1e-3, 1e-3), f"scale factor of {self.axis}"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``q_a`` on E_aa; held at the ends of the travel."""
        position = machine.axis(self.axis).clamp(conditions.position(self.axis))
        return (Motion(along(self.axis), position[:, None]),)

    def check(self, machine: Machine) -> None:
        """Linear axes only."""
        super().check(machine)
        require_linear(machine, self.axis, self.kind)

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The ends of the travel."""
        return {self.axis: machine.axis(self.axis).travel}

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Scale]:
        """One for each linear axis that moved."""
        return (cls(axis=a) for a in machine.structure.linear if a in coverage.moving)


@register
class Straightness(ShapedEffect):
    """Straightness error of a linear axis, E_YX, E_ZX, … (ISO 230-1, 3.4.8).

    The carriage leaves the straight line sideways while it travels.

    Formula
        ``E_da(q_a) = Σ c_i·B_i(q_a)``, d the direction of the error, a the moving axis.
    Parameters
        Coefficients in mm, within ±0.2 mm.
    Signals
        None beyond the axis's position.
    Typical causes
        Guideways not straight, distorted by their mounting or by temperature gradients; worn
        bearings.
    Cure
        Compensation table of straightness (L-STR); re-scraping or re-aligning the guideway.
    Source
        ISO 230-1:2012, 3.4.8; ISO/TR 16907:2015, 6.
    """

    kind = "straightness"
    direction: AxisLetter

    def component(self) -> Component:
        """Across the axis."""
        return self.direction

    def check(self, machine: Machine) -> None:
        """Linear axes only, and a direction across the axis."""
        super().check(machine)
        require_linear(machine, self.axis, self.kind)
        if self.direction == own_component(self.axis):
            raise InputError(
                "straightness is across the axis; along it the effect is 'positioning'",
                field="direction",
                found=self.direction,
                expected="one of " + ", ".join(d for d in "XYZ" if d != own_component(self.axis)),
            )

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Straightness]:
        """Both directions of each linear axis that moved."""
        for axis in machine.structure.linear:
            if axis in coverage.moving:
                for direction in ("X", "Y", "Z"):
                    if direction != own_component(axis):
                        yield cls(axis=axis, direction=direction)


@register
class Angular(ShapedEffect):
    """Angular error motion of a linear axis: roll, pitch, yaw (ISO 230-1, 3.4.16).

    The carriage turns a little while it travels; through the lever to the functional point (Abbe's
    principle) the turn becomes a displacement.

    Formula
        ``E_Aa, E_Ba or E_Ca (q_a) = Σ c_i·B_i(q_a)``, about X, Y or Z; right-handed.
    Parameters
        Coefficients in rad, within ±500 µrad (about 100 arc-seconds).
    Signals
        None beyond the axis's position.
    Typical causes
        Guideways not straight over the carriage's own length, uneven preload, a drive that pushes
        beside the centre of gravity.
    Cure
        Angular compensation (L-ANG, L-VOL), which needs the tool length; re-working the guideway.
    Source
        ISO 230-1:2012, 3.4.16; ISO/TR 16907:2015, 6.
    """

    kind = "angular"
    about: AxisLetter

    def component(self) -> Component:
        """About the stated direction."""
        return ABOUT[self.about]

    def check(self, machine: Machine) -> None:
        """Linear axes only."""
        super().check(machine)
        require_linear(machine, self.axis, self.kind)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Angular]:
        """Three for each linear axis that moved."""
        for axis in machine.structure.linear:
            if axis in coverage.moving:
                for about in ("X", "Y", "Z"):
                    yield cls(axis=axis, about=about)


@register
class Squareness(Effect):
    """Squareness error between two linear axes, E_C(0X)Y and the like (ISO 230-1, 3.6).

    The two axes are not at right angles. Written as a constant right-handed rotation about the
    third direction of all that stands behind the move of the first of the two axes (in the
    structure's order from workpiece to tool): on the tool side a constant added to that axis's
    angular errors, the preferred way of applying a map.

    Formula
        ``E_·a = angle`` with a = axes[0], about the direction that neither axis has. Where a's own
        move is in its lever (workpiece side) it is taken out again, ``t_a = −ω × q_a·u_a``: without
        this the workpiece would turn as a whole and no two axes would be out of square.
    Parameters
        angle in rad, right-handed; within ±2000 µrad. A value that grows from test to test points
        to a collision or a moving foundation.
    Signals
        None.
    Typical causes
        Alignment, settling of the foundation, a collision, a column bent by temperature.
    Cure
        Compensation of squareness (L-SQU), re-alignment of the guideway.
    Source
        ISO 230-1:2012, 3.6; ISO/TR 16907:2015, 6 and 8.2 (L-SQU).
    """

    kind = "squareness"
    carries = True
    axes: Pair

    def component(self) -> Component:
        """The rotation about the direction that neither axis has."""
        (third,) = set("XYZ") - {own_component(a) for a in self.axes}
        return ABOUT[third]

    def check(self, machine: Machine) -> None:
        """Two different linear directions, in the structure's order."""
        super().check(machine)
        for axis in self.axes:
            machine.axis(axis, "axes")
            if is_rotary(axis):
                raise InputError("squareness is between linear axes", field="axes", found=axis)
        if own_component(self.axes[0]) == own_component(self.axes[1]):
            raise InputError("squareness needs two directions", field="axes", found=self.axes)
        order = [a for a in machine.structure.axes if a in self.axes]
        if list(self.axes) != order:
            raise InputError(
                "the two axes stand in the structure's order, workpiece to tool",
                field="axes",
                found=",".join(self.axes),
                expected=",".join(order),
            )

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The angle."""
        return (
            Parameter(
                "angle", "rad", (-2e-3, 2e-3), f"squareness of {self.axes[0]} and {self.axes[1]}"
            ),
        )

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """A constant on the first axis's rotation, its own move not turned along."""
        first = self.axes[0]
        turn = Motion(ErrorMotion(first, self.component()), np.ones((conditions.n, 1)))
        if not machine.own_move_in_lever(first):
            return (turn,)
        about = np.zeros(3)
        about["ABC".index(self.component())] = 1.0
        back = -np.cross(about, machine.axis(first).direction)
        position = conditions.position(first)
        own = [
            Motion(ErrorMotion(first, letter), (position * back[k])[:, None])
            for k, letter in enumerate(TRANSLATIONS)
            if back[k] != 0.0
        ]
        return (turn, *own)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """The first axis where its own move is taken out of its lever."""
        return (self.axes[0],) if machine.own_move_in_lever(self.axes[0]) else ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Squareness]:
        """Every pair of linear axes that are nominally square."""
        linear = [a for a in machine.structure.linear if a in coverage.moving]
        for i, first in enumerate(linear):
            for second in linear[i + 1 :]:
                if own_component(first) != own_component(second):
                    yield cls(axes=(first, second))
