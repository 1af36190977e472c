"""Axis average lines as they physically are, and error motions as measured on a rotary table.

An error is of the tool relative to the workpiece (docs/conventions.md). On the tool side of the
bed that is what an indicator on the bed shows of the axis. On the workpiece side it is the
opposite: a table whose line lies at +10 µm has E_X0C = −10 µm. Whoever enters a centre in a
controller, or lays a level on a table, needs what is there, and this module says it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects import RotaryLocation, Squareness
from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.model.model import Model, Term
from abbe.compcore.sentences import joined, listed, said
from abbe.compcore.units import in_digits, with_uncertainty

F64 = NDArray[np.float64]
Side = Literal["tool", "workpiece"]

_LETTERS = "XYZABC"
_UNSEEN = 5e-10
"""mm and rad below which a line is not said to be elsewhere."""


def side_of(machine: Machine, axis: str) -> Side:
    """The side of the bed on which an axis is: workpiece or tool."""
    return "workpiece" if axis in machine.structure.workpiece_side else "tool"


def seen_factor(machine: Machine, effect: Effect) -> float:
    """The factor, 1 or −1, from an effect's linear parameters to what the part itself shows.

    −1 where all error motions that it moves are those of axes on the workpiece side: a level,
    an indicator or an R-test on the table itself shows the opposite of the error. 1 otherwise;
    also for a squareness, which is the angle between two moves, whoever makes them.
    """
    if effect.scope != "machine" or isinstance(effect, Squareness):
        return 1.0
    at = Conditions.at(
        {a: machine.axis(a).middle for a in machine.structure.axes},
        signals=dict.fromkeys(machine.signals, machine.reference_temperature),
    )
    nonlinear = {p.name: p.starts[0] for p in effect.nonlinear(machine)}
    places = {m.error_motion.place for m in effect.motions(machine, at, nonlinear)}
    return -1.0 if places and places <= set(machine.structure.workpiece_side) else 1.0


ON_THE_TABLE = said(
    "axes on the workpiece side: a level, an indicator or an R-test on the table itself shows the "
    "opposite sign of these errors of the tool relative to the workpiece"
)


SURE = 2.0
"""Standard uncertainties from which on a place is known well enough to be entered."""


@dataclass(frozen=True, eq=False)
class AverageLine:
    """The position and orientation of a rotary axis's average line, all axes at zero.

    Attributes
    ----------
    axis, side
        The axis, and on which side of the bed it is.
    configured
        ``location`` of the model, shape (3,), mm.
    offset, offset_sd
        From there to where the line is, across the axis, shape (3,), mm, machine axes; the sum over
        the rotary axes that carry it. NaN where the uncertainty is not known.
    lean, lean_sd
        Rotation that turns the configured direction into the real one, shape (3,), rad.
    zero, zero_sd
        Where the axis stands when it shows 0, counted as the axis counts, rad.
    direction
        Direction of the line as it is, shape (3,), a unit vector.
    carrier
        The rotary axis that carries it, if any.
    beside_carrier
        The part of `offset` that is not the carrier's: what to enter where a controller counts from
        the carrier's line; shape (3,), mm.
    measured
        Of each machine direction whether the campaigns show where the line lies, by their design.
    """

    axis: str
    side: Side
    configured: F64
    offset: F64
    offset_sd: F64
    lean: F64
    lean_sd: F64
    zero: float
    zero_sd: float
    direction: F64
    carrier: str | None
    beside_carrier: F64
    measured: tuple[bool, bool, bool]

    @property
    def across(self) -> tuple[int, int]:
        """The two machine directions across the axis, 0 to 2."""
        own = "ABC".index(own_component(self.axis))
        first, second = (k for k in range(3) if k != own)
        return first, second

    @property
    def place_measured(self) -> bool:
        """Whether the campaigns show where it lies, or somebody has stated it."""
        return any(self.measured[k] for k in self.across)

    def _elsewhere(self, k: int) -> bool:
        return self.measured[k] and abs(self.offset[k]) > _UNSEEN

    @property
    def place(self) -> F64:
        """A point of the line, shape (3,), mm: what to enter for `configured`."""
        return self.configured + self.offset

    def words(self, *, entering: bool = True) -> Iterator[str]:
        """Sentences for people: where the line is, and what to enter (unless not `entering`)."""
        yield self._place_words(entering=entering)
        if lean := self._lean_words():
            yield lean
        if abs(self.zero) > _UNSEEN:
            stands = said(
                "{axis} stands at {angle} where it shows 0",
                axis=self.axis, angle=_amount(self.zero, self.zero_sd, 1e6, "µrad"),
            )  # fmt: skip
            if self.side == "workpiece":
                letter = "XYZ"["ABC".index(own_component(self.axis))]
                turn = f"{in_digits(-self.zero * 1e6, 4, sign=True)} µrad"
                stands = said(
                    "{stands} (the table itself is turned by {turn} about {axis}, right-handed)",
                    stands=stands, turn=turn, axis=letter,
                )  # fmt: skip
            yield stands

    def _known(self, k: int) -> bool:
        """Whether it is sure enough which way it lies, in a direction, to be entered."""
        return bool(np.isnan(self.offset_sd[k]) or abs(self.offset[k]) > SURE * self.offset_sd[k])

    def _place_words(self, *, entering: bool) -> str:
        if not self.place_measured:
            return said(
                "where the line of {axis} lies was not measured: it is taken where it is "
                "configured",
                axis=self.axis,
            )
        parts = [
            _towards(self.offset[k], self.offset_sd[k], k, 1e3, "µm")
            for k in self.across
            if self._elsewhere(k)
        ]
        if not parts:
            return said("the line of {axis} lies where it is configured", axis=self.axis)
        entered = [
            said(
                "{axis} {place} instead of {configured} mm",
                axis="XYZ"[k], place=f"{self.place[k]:.4f}", configured=f"{self.configured[k]:.4f}",
            )
            for k in self.across
            if self._elsewhere(k) and self._known(k)
        ]  # fmt: skip
        text = said(
            "the line of {axis} lies {where} of the configured place",
            axis=self.axis, where=listed(parts),
        )  # fmt: skip
        if not entering:
            return text
        if not entered:
            return said("{lies}: not known well enough to be entered; measure more", lies=text)
        text = said("{lies}: enter {what}", lies=text, what=joined(entered, ", "))
        if self.carrier is not None:
            apart = ", ".join(
                f"{'XYZ'[k]} {in_digits(self.beside_carrier[k] * 1e3, 4, sign=True)} µm"
                for k in self.across
            )
            text = said(
                "{lies} (all axes at zero; from where {carrier} carries it: {apart})",
                lies=text, carrier=self.carrier, apart=apart,
            )  # fmt: skip
        return text

    def _lean_words(self) -> str:
        tip = np.cross(self.lean, self.direction)
        sd = np.abs(np.cross(np.eye(3), self.direction)).T @ np.nan_to_num(self.lean_sd)
        sd = np.where(np.isnan(self.lean_sd).all(), np.nan, sd)
        parts = [
            _towards(tip[k], sd[k], k, 1e6, "µrad") for k in self.across if abs(tip[k]) > _UNSEEN
        ]
        if not parts:
            return ""
        vector = ", ".join(f"{v:.7f}" for v in self.direction + 0.0)
        end = "XYZ"["ABC".index(own_component(self.axis))]
        return said(
            "the line of {axis} leans, its +{end} end {where}: its direction is ({vector})",
            axis=self.axis, end=end, where=listed(parts), vector=vector,
        )  # fmt: skip


def average_lines(model: Model) -> tuple[AverageLine, ...]:
    """The average lines of all rotary axes with a fitted `rotary_location`.

    In the order of the structure. An axis that is carried by another lies where the other's line
    puts it: the place is the sum over all that stand between it and the bed.
    """
    fitted = {
        t.effect.axis: i
        for i, t in enumerate(model.terms)
        if isinstance(t.effect, RotaryLocation) and t.fitted
    }
    return tuple(
        _line(model, axis, fitted) for axis in model.machine.structure.axes if axis in fitted
    )


def _line(model: Model, axis: str, fitted: dict[str, int]) -> AverageLine:
    machine = model.machine
    side = side_of(machine, axis)
    where = np.asarray(machine.axis(axis).location, dtype=np.float64)
    own = "ABC".index(own_component(axis))
    carriers = [a for a in _from_the_bed(machine, axis) if a in fitted and a != axis]
    theta = np.array([v.value for t in model.terms for v in t.values.values()])
    place = np.zeros((6, len(theta)))
    beside = np.zeros((6, len(theta)))
    for other in (*carriers, axis):
        point = np.asarray(machine.axis(other).location)
        block = line_pose(model, fitted[other], where - point, len(theta))
        place += block
        if other == axis:
            beside += block
    factor = -1.0 if side == "workpiece" else 1.0
    value, covariance = factor * (place @ theta), model.covariance
    sd = np.full(6, np.nan)
    if covariance is not None:
        sd = np.sqrt(np.maximum(np.einsum("ip,pq,iq->i", place, covariance, place), 0.0))
    else:
        sd = np.sqrt(place**2 @ stated_variance(model))
        sd = np.where(np.isnan(_stated_sd(model.terms[fitted[axis]])), np.nan, sd)
    lean, offset = value[3:].copy(), value[:3].copy()
    zero_name = f"E_{'ABC'[own]}0{axis}"
    zero = model.terms[fitted[axis]].values[zero_name]
    lean[own] = offset[own] = 0.0
    nominal = np.asarray(machine.axis(axis).direction)
    direction = nominal + np.cross(lean, nominal)
    return AverageLine(
        axis,
        side,
        where,
        offset,
        sd[:3],
        lean,
        sd[3:],
        zero.value,
        np.nan if zero.sd is None else zero.sd,
        direction / np.linalg.norm(direction),
        carriers[-1] if carriers else None,
        factor * (beside @ theta)[:3],
        _measured(model.terms[fitted[axis]], offset),
    )


def _measured(term: Term, offset: F64) -> tuple[bool, bool, bool]:
    """In which directions a line was found; a stated 0 without an uncertainty says nothing."""
    found = [False, False, False]
    for name, value in term.values.items():
        k = _LETTERS.index(name[2])
        if k < 3:
            found[k] = value.measured and (value.sd is not None or abs(offset[k]) > _UNSEEN)
    return found[0], found[1], found[2]


def _from_the_bed(machine: Machine, axis: str) -> list[str]:
    """The rotary axes from the bed to an axis, itself last."""
    structure = machine.structure
    side = structure.workpiece_side
    order = list(side[::-1]) if axis in side else list(structure.tool_side)
    return [a for a in order[: order.index(axis) + 1] if machine.axis(a).rotary]


def line_pose(model: Model, term: int, reach: F64, size: int) -> F64:
    """What a location's parameters do to a frame at `reach` from its origin, shape (6, size)."""
    at = sum(len(t.values) for t in model.terms[:term])
    names = list(model.terms[term].values)
    block = np.zeros((6, size))
    for i, name in enumerate(names):
        k = _LETTERS.index(name[2])
        block[k, at + i] += 1.0
        if k >= 3:
            block[:3, at + i] += np.cross(np.eye(3)[k - 3], reach)
    return block


def stated_variance(model: Model) -> F64:
    """Each parameter's own variance, shape (m,), 0 where none is stated."""
    every = [v.sd for t in model.terms for v in t.values.values()]
    return np.array([0.0 if sd is None else sd**2 for sd in every])


def _stated_sd(term: Term) -> F64:
    sd = np.full(6, np.nan)
    for name, value in term.values.items():
        if value.sd is not None:
            sd[_LETTERS.index(name[2])] = value.sd
    return sd


def _towards(value: float, sd: float, direction: int, factor: float, unit: str) -> str:
    sign = "+" if value > 0.0 else "−"
    size = _amount(abs(value), sd, factor, unit)
    return said("{size} towards {way}", size=size, way=f"{sign}{'XYZ'[direction]}")


def _amount(value: float, sd: float, factor: float, unit: str) -> str:
    return f"{with_uncertainty(value * factor, sd * factor)} {unit}"


def reversed_parameters(machine: Machine, effect: Effect) -> frozenset[str]:
    """An effect's parameters whose sign is reversed when measured on the table itself."""
    if seen_factor(machine, effect) > 0.0:
        return frozenset()
    return frozenset(p.name for p in effect.linear(machine))
