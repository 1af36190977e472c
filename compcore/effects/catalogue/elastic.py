"""Elastic effects: bodies that bend under their own weight, a load, or a carriage's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

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
from abbe.compcore.effects.catalogue.shaped import ShapedEffect
from abbe.compcore.effects.keys import Finite
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.signals import per, recorded
from abbe.compcore.effects.targets import ROTATIONS, TRANSLATIONS, require_linear
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine, own_component
from abbe.compcore.machine.typical import typical


@register
class CrossAngular(Effect):
    """An axis's angle that depends on where another axis stands (ISO/TR 16907, 7.4.2).

    No machine is rigid: a heavy carriage that moves along a bridge or cross table twists and tilts
    what carries it. The angle then is no function of its own axis alone, and 21 tables cannot hold
    it.

    Formula
        ``E_·a = κ·(q_b − q_b0)``, about X, Y or Z, b another axis, q_b0 the middle of b's travel;
        with ``product = true`` times q_a: ``E_·a = κ·(q_b − q_b0)·q_a``.
    Parameters
    ----------
        kappa in rad/mm (product: rad/mm²), so small that the angle stays within ±200 µrad over b's
        travel. A bridge with a 100 kg carriage reaches 5 to 20 µrad from end to end, a light gantry
        or long cross table more.
    Signals
        None beyond the two positions.
    Typical causes
        Weight of a carriage that moves across a guideway, bed or foundation that is too soft, three
        feet where six are needed, a gantry whose drives share the load unequally.
    Cure
        Stiffer bed and supports, a counterweight; a spatial error table (ISO/TR 16907, 9.3) or
        Abbe's live correction; where the controller holds a rigid model only, tables that minimise
        what is left.
    Source
        ISO/TR 16907:2015, 7.4.2 and 9.3; the test for it: Zhang et al., CIRP Annals 34/1 (1985),
        who measured the table's flatness for nine positions of bridge and carriage.
    """

    kind = "cross_angular"
    axis: str
    about: AxisLetter
    by: str
    product: bool = False

    def check(self, machine: Machine) -> None:
        """Two different axes."""
        super().check(machine)
        if self.by == self.axis:
            raise InputError(
                "the angle depends on another axis; on its own position the effect is 'angular'",
                field="by",
                found=self.by,
                expected="one of " + ", ".join(a for a in machine.structure.axes if a != self.axis),
            )

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The change of angle by position."""
        by, own = machine.axis(self.by, "by"), machine.axis(self.axis)
        reach = by.half_travel
        unit = "rad/rad" if by.rotary else "rad/mm"
        if self.product:
            reach *= max(abs(q) for q in own.travel)
            unit = {0: "rad/mm²", 1: "rad/(rad·mm)", 2: "rad/rad²"}[by.rotary + own.rotary]
        text = f"turn of {self.axis} about {self.about} by {self.by}"
        return (Parameter("kappa", unit, (-2e-4 / reach, 2e-4 / reach), text),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``q_b − q_b0``, times q_a where asked; held at the ends of the travels."""
        by = machine.axis(self.by, "by")
        column = by.clamp(conditions.position(self.by)) - by.middle
        if self.product:
            column = column * machine.axis(self.axis).clamp(conditions.position(self.axis))
        return (Motion(ErrorMotion(self.axis, ABOUT[self.about]), column[:, None]),)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """The other axis, and the axis itself for a product."""
        return (self.axis, self.by) if self.product else (self.by,)

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The ends of the travels."""
        return {a: machine.axis(a).travel for a in self.positions_used(machine)}

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[CrossAngular]:
        """Every pair of axes that moved, three turns each; then the products."""
        moving = [a for a in machine.structure.axes if a in coverage.moving]
        for product in (False, True):
            for axis in moving:
                for by in (b for b in moving if b != axis):
                    for about in ("X", "Y", "Z"):
                        yield cls(axis=axis, about=about, by=by, product=product)


@register
class OverhangSag(Effect):
    """Sag of a ram, arm or cross slide that reaches out: a cantilever with its load at the end.

    A beam that is clamped at one end and carries a load F at the distance L deflects there by
    F·L³/(3EI) and slopes by F·L²/(2EI): the two belong together, one cause, one parameter.

    Formula
        Deflection ``E_da = s·(L/L_max)³`` and slope ``3/2·s·L²/L_max³``, a turn about the direction
        square to the reach and to d, right-handed such that the beam points where it deflects. L is
        the overhang of axis b, from ``root`` (mm; default: the end of b's travel that lies nearer
        to its zero) outwards, L_max its greatest; b is usually a itself. Where b moves behind a
        (its move is in a's lever), what the slope alone would do over that move is taken out again,
        so that the end of the beam always deflects by s·(L/L_max)³. For an axis on the workpiece
        side the slope has the other sign, since there the reach is that of the table.
    Parameters
    ----------
        sag s in mm, the deflection at full reach, signed along d. Within ±0.2 mm: a horizontal arm
        of 1 m sags by 20 to 100 µm, a bridge machine's ram by 1 to 5 µm.
    Signals
        None beyond b's position. What changes with the tool's mass is `load_bending`.
    Typical causes
        Weight of ram, head and tool at the end of an arm, of a carriage on a cantilevered beam, of
        a table that travels beyond its bed; a counterweight that is too light; probing or drive
        force on a thin ram.
    Cure
        Counterweight or hydraulic support, a ram shaped against its sag; tables of straightness and
        angle over the reach (L-STR, L-ANG), or Abbe's live correction.
    Source
        Timoshenko, Strength of Materials: the cantilever with end load; ISO/TR 16907:2015, 7.4.2.
    """

    kind = "overhang_sag"
    axis: str
    direction: AxisLetter
    by: str
    root: Finite | None = None

    def check(self, machine: Machine) -> None:
        """Linear axes, a deflection across the reach, a root outside the travel."""
        super().check(machine)
        require_linear(machine, self.axis, self.kind)
        require_linear(machine, self.by, self.kind, "by")
        by = machine.axis(self.by, "by")
        if np.linalg.norm(self._turn(by)) < 1e-6:
            raise InputError(
                "a beam deflects across its reach, not along it",
                field="direction",
                found=self.direction,
                expected="one of " + ", ".join(d for d in "XYZ" if d != own_component(self.by)),
            )
        if self.root is not None and by.travel[0] < self.root < by.travel[1]:
            raise InputError(
                "the root of a beam lies at or beyond an end of the travel",
                field="root",
                found=self.root,
                expected=f"≤ {by.travel[0]:g} or ≥ {by.travel[1]:g} mm",
            )

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The deflection at full reach."""
        text = f"sag in {self.direction} at full reach of {self.by}"
        return (Parameter("sag", "mm", (-0.2, 0.2), text),)

    def _reach(self, by: Axis) -> tuple[float, float, float]:
        """Root (mm), the sense in which the reach grows, and the greatest reach (mm)."""
        root = self.root
        if root is None:
            root = min(by.travel, key=abs)
        sense = 1.0 if root <= by.travel[0] else -1.0
        return root, sense, max(abs(q - root) for q in by.travel)

    def _turn(self, by: Axis) -> F64:
        """Turn by which a beam along b's positive direction comes to point along d, shape (3,)."""
        unit = np.eye(3)["XYZ".index(self.direction)]
        return np.asarray(np.cross(by.direction, unit))

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """Deflection and slope of the one parameter; held at the ends of the travel."""
        by = machine.axis(self.by, "by")
        root, sense, most = self._reach(by)
        position = by.clamp(conditions.position(self.by))
        reach = sense * (position - root)
        deflection = (reach / most) ** 3
        slope = 1.5 * reach**2 / most**3 * sense
        order = machine.structure.axes
        on_table = self.by in machine.structure.workpiece_side
        behind = order.index(self.by) > order.index(self.axis) or (
            self.by == self.axis and machine.own_move_in_lever(self.axis)
        )
        if on_table:
            slope = -slope
        elif behind:
            deflection = deflection - slope * position
        found = [Motion(ErrorMotion(self.axis, self.direction), deflection[:, None])]
        found += [
            Motion(ErrorMotion(self.axis, ROTATIONS[k]), (part * slope)[:, None])
            for k, part in enumerate(self._turn(by))
            if abs(part) > 1e-12
        ]
        return tuple(found)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """The axis that reaches out."""
        return (self.by,)

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The ends of the reaching axis's travel."""
        return {self.by: machine.axis(self.by, "by").travel}

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[OverhangSag]:
        """Each linear axis that moved as its own beam, then at the other axes of its side.

        Of the latter none in X: it lies level (ISO 841, 5.3.1), and what bends under weight bends
        downwards. Which of Z and Y is upright is not known, but where a ram reaches along Y it is
        Z. What stands on the bed and carries other axes, a column or a gantry, rolls along its
        rails: as it moves nothing reaches further out.
        """
        structure = machine.structure
        tool_side = [a for a in structure.tool_side if a in structure.linear]
        stands = tool_side[0] if len(tool_side) > 1 else None
        level = "XY" if tool_side and own_component(tool_side[-1]) == "Y" else ""
        moving = [a for a in structure.linear if a in coverage.moving and a != stands]
        sides = (structure.workpiece_side, structure.tool_side)
        pairs = [(a, a) for a in moving]
        pairs += [
            (a, b)
            for b in moving
            for a in structure.linear
            for s in sides
            if a in s and b in s
            if a != b
        ]
        for axis, by in pairs:
            for direction in TRANSLATIONS:
                if direction == own_component(by) or direction in level:
                    continue
                if axis == by or direction != "X":
                    yield cls(axis=axis, direction=direction, by=by)


@register
class LoadBending(ShapedEffect):
    """A machine that bends under a recorded load: the workpiece on the table, the tool in the head.

    Formula
        ``E_da = load·Σ c_i·B_i(q_a)`` for a ``direction`` d, or the angle E_·a for ``about``; B the
        basis functions of the shape (default: a parabola, the bending line of a table that travels
        between its supports).
    Parameters
    ----------
        c0, c1, c2 in mm (rad) per unit of the load: within ±0.2 mm (500 µrad) at 1000 kg. A bed of
        a medium mill gives 5 to 20 µm per tonne.
    Signals
        One load, in kg or N, of role ``load``: the mass of the workpiece, pallet or tool. It may be
        constant within a run; it must differ between runs to be found.
    Typical causes
        Heavy workpieces on a travelling table, heavy heads and tools on a ram, a bed on too few or
        loose feet, hydrostatic guides whose gap changes with the load.
    Cure
        Re-levelling under load, more supports; live compensation by the recorded mass.
    Source
        ISO/TR 16907:2015, 8.6 (workpiece and tool mass) and 7.4.2; ISO 230-1 on finite stiffness.
    """

    kind = "load_bending"
    signal: str
    direction: AxisLetter | None = None
    about: AxisLetter | None = None
    shape: str = "polynomial:2"

    @model_validator(mode="after")
    def _one_of_the_two(self) -> LoadBending:
        if (self.direction is None) == (self.about is None):
            raise InputError(
                "load_bending needs a direction or an about, not both", expected="direction=Z"
            )
        return self

    def component(self) -> Component:
        """The translation or rotation that the load causes."""
        return self.direction if self.about is None else ABOUT[self.about]  # type: ignore[return-value]

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """One coefficient a basis function, per unit of load."""
        error_motion = ErrorMotion(self.axis, self.component())
        load = machine.signals[self.signal]
        most = (5e-4 if error_motion.rotation else 0.2) / typical(load).change
        return tuple(
            Parameter(
                name,
                per(error_motion.unit, load),
                (-most, most),
                f"{error_motion} by {self.signal}, {name}",
            )
            for name in self.parsed_shape(machine).names
        )

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """The load times the shape's basis functions."""
        load = conditions.signal(self.signal)[:, None]
        error_motion = ErrorMotion(self.axis, self.component())
        return (Motion(error_motion, self.basis(machine, conditions) * load),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[LoadBending]:
        """Each recorded load on each axis: six error motions, parabola first, then constant."""
        loads = [s for s in recorded(machine, coverage, temperature=False) if s.role == "load"]
        for shape in ("polynomial:2", "constant"):
            for load in loads:
                for axis in machine.structure.axes:
                    moved = axis in coverage.moving
                    if not moved and shape != "constant":
                        continue
                    for letter in ("Z", "X", "Y"):
                        yield cls(axis=axis, signal=load.name, direction=letter, shape=shape)
                    for letter in ("X", "Y", "Z"):
                        yield cls(axis=axis, signal=load.name, about=letter, shape=shape)
