"""A vendor's convention for applying a CMM's compensation map: signs, rotation point, levers.

Makers differ in the signs of a map's columns, in the point from which the levers of angular errors
count, in whether an axis's own travel is part of its lever, and in the form of squareness.
docs/maps.md tells the user's side of it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.maps.squareness import Form
from abbe.compcore.maps.table import COLUMNS, COMPONENTS

OwnTravel = Literal["structure", "never", "always"]
Acts = Literal["before", "after"]
SquarenessForm = Literal["as written", "angle", "gradient"]

_SELECTOR = re.compile(
    r"(?P<axis>[XYZUVW][0-9]?|R[0-9]|R(?=\.))(?:\.(?P<of_axis>[LR][xyz]?))?|(?P<of_all>[LR][xyz]?)"
)
_SIGN_EXPECTED = "L, R, Lx … Rz, an axis, or AXIS.COLUMN, then =1 or =-1 (R=-1, Z.L=-1)"


@dataclass(frozen=True)
class Convention:
    """How a controller applies a compensation map; the defaults are Abbe's own conventions.

    Attributes
    ----------
    reversed
        Columns whose sign is opposite to Abbe's, as (axis, ISO letter of the component): X Y Z for
        linear errors, A B C for rotations.
    rotation_point
        Axis → position, mm, from which that axis's travel counts as a lever of the angular errors
        of the axes before it. The map's zero for axes that are not named. None: whatever the
        machine's axes already say.
    own_travel
        Whether an axis's own travel is in the lever of its own angular errors. ``structure``: for
        axes on the workpiece side only.
    squareness
        The squareness that the map's own columns hold. ``as written``: each column as it stands.
        ``angle`` and ``gradient``: the controller applies it in that form, whichever form the map
        was written in.
    stated
        How a squareness that stands beside the map is applied, the map's columns untouched:
        ``angle``, a constant of an angular column, or ``gradient``, a slope of a straightness
        column.
    """

    reversed: frozenset[tuple[str, str]] = frozenset()
    rotation_point: Mapping[str, float] | None = field(default_factory=dict)
    own_travel: OwnTravel = "structure"
    squareness: SquarenessForm = "as written"
    stated: Form = "angle"

    def sign(self, axis: str, component: str) -> float:
        """+1 where the column has Abbe's sign, else −1; `component` is one of X Y Z A B C."""
        return -1.0 if (axis, component) in self.reversed else 1.0

    def check(self, machine: Machine) -> None:
        """Check that the machine has every axis that the convention names.

        Raises
        ------
        InputError
            When a sign or a rotation point names an axis that is not a linear axis of the machine.
        """
        linear = machine.structure.linear
        for what, names in (
            ("sign", [axis for axis, _ in self.reversed]),
            ("rotation point", list(self.rotation_point or {})),
        ):
            for name in names:
                if name not in linear:
                    raise InputError(
                        "the machine has no such linear axis",
                        field=what,
                        found=name,
                        expected="one of " + ", ".join(linear),
                    )

    def on(self, machine: Machine) -> Machine:
        """The machine with this convention's rotation points and levers."""
        if self.own_travel != "structure":
            acts: Acts = "before" if self.own_travel == "always" else "after"
            machine = _acting(machine, acts)
        if self.rotation_point is None:
            return machine
        axes = dict(machine.axes)
        for name in machine.structure.linear:
            point = np.zeros(3)
            for other in levers(machine, name):
                along = np.asarray(machine.axis(other).direction)
                point = point + self.rotation_point.get(other, 0.0) * along
            x, y, z = (float(v) + 0.0 for v in point)
            axes[name] = replace(axes[name], rotation_point=(x, y, z))
        return replace(machine, axes=axes)

    def options(self, axes: tuple[str, ...]) -> str:
        """The options of ``abbe import-map`` for this convention; empty for Abbe's own."""
        words = [f"--sign {selector}=-1" for selector in selectors(self.reversed, axes)]
        point = {a: p for a, p in (self.rotation_point or {}).items() if p != 0.0}
        if point:
            words.append(
                "--rotation-point " + ",".join(f"{a}={p:g}" for a, p in sorted(point.items()))
            )
        if self.own_travel != "structure":
            words.append(f"--own-travel {self.own_travel}")
        if self.squareness != "as written":
            words.append(f"--map-squareness {self.squareness}")
        if self.stated != "angle":
            words.append(f"--squareness-as {self.stated}")
        return " ".join(words)


def levers(machine: Machine, axis: str) -> tuple[str, ...]:
    """The linear axes whose travel is in the lever of an axis's angular errors."""
    order = machine.structure.axes
    start = order.index(axis) + (0 if machine.own_move_in_lever(axis) else 1)
    linear = machine.structure.linear
    return tuple(a for a in order[start:] if a in linear)


def parse_signs(texts: Iterable[str], axes: tuple[str, ...]) -> frozenset[tuple[str, str]]:
    """The reversed columns of a map from signs as typed (``R=-1``); later ones count over earlier.

    >>> sorted(parse_signs(["Z.R=-1", "Z.Rx=1"], ("X", "Y", "Z")))
    [('Z', 'B'), ('Z', 'C')]

    Raises
    ------
    InputError
        For a selector or a sign that cannot be read, an axis that is not among `axes`.
    """
    found: set[tuple[str, str]] = set()
    for text in texts:
        selector, equals, sign = text.partition("=")
        match = _SELECTOR.fullmatch(selector)
        if not equals or match is None or sign not in ("1", "+1", "-1"):
            raise InputError("not a sign", field="sign", found=text, expected=_SIGN_EXPECTED)
        if match["axis"] is not None and match["axis"] not in axes:
            raise InputError(
                "no such axis", field="sign", found=text, expected="one of " + ", ".join(axes)
            )
        column = match["of_axis"] or match["of_all"] or ""
        chosen = {
            (axis, component)
            for axis in ([match["axis"]] if match["axis"] else axes)
            for component, name in zip(COMPONENTS, COLUMNS, strict=True)
            if name.startswith(column)
        }
        found = found | chosen if sign == "-1" else found - chosen
    return frozenset(found)


def selectors(reversed_: frozenset[tuple[str, str]], axes: tuple[str, ...]) -> list[str]:
    """The fewest column selectors (``L``, ``Ry``, ``Z.R``, ``X.Lz``) for just these columns."""
    left = set(reversed_)
    found: list[str] = []

    def take(name: str, chosen: set[tuple[str, str]]) -> None:
        if chosen and chosen <= left:
            found.append(name)
            left.difference_update(chosen)

    for kind, letters in (("L", "XYZ"), ("R", "ABC")):
        take(kind, {(a, c) for a in axes for c in letters})
    for component, column in zip(COMPONENTS, COLUMNS, strict=True):
        take(column, {(a, component) for a in axes})
    for axis in axes:
        for kind, letters in (("L", "XYZ"), ("R", "ABC")):
            take(f"{axis}.{kind}", {(axis, c) for c in letters})
    for axis in axes:
        for component, column in zip(COMPONENTS, COLUMNS, strict=True):
            take(f"{axis}.{column}", {(axis, component)})
    return found


def parse_rotation_point(text: str, ranges: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Rotation points as typed (``X=200,Z=far``): axis → position, mm.

    Each axis has a number, ``low`` or ``high`` (the ends of its table), ``far`` (the end farther
    from zero) or ``zero``. A text without ``=`` holds for every axis.

    Raises
    ------
    InputError
        For what cannot be read, an axis without a table, a ``far`` end that could be either.
    """
    point: dict[str, float] = {}
    parts = text.split(",")
    if len(parts) == 1 and "=" not in text:
        return {axis: _place(text, axis, ranges) for axis in ranges}
    for part in parts:
        axis, equals, place = (piece.strip() for piece in part.partition("="))
        if not equals or axis not in ranges or axis in point:
            raise InputError(
                "not a rotation point",
                field="rotation point",
                found=part,
                expected="each of " + ", ".join(ranges) + " at most once, as in X=200,Z=far",
            )
        point[axis] = _place(place, axis, ranges)
    return point


def _place(text: str, axis: str, ranges: Mapping[str, tuple[float, float]]) -> float:
    low, high = ranges[axis]
    named = {"zero": 0.0, "low": low, "high": high}
    if text == "far":
        if abs(low) == abs(high):
            raise InputError(
                f"both ends of {axis} are equally far from zero",
                field="rotation point",
                found=f"{axis}=far",
                expected=f"{axis}=low ({low:g} mm) or {axis}=high ({high:g} mm)",
            )
        return low if abs(low) > abs(high) else high
    if text in named:
        return named[text]
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputError(
            "not a rotation point",
            field="rotation point",
            found=f"{axis}={text}",
            expected="a position in mm, zero, low, high or far",
        )
    return value


def _acting(machine: Machine, acts: Acts) -> Machine:
    linear = machine.structure.linear
    axes = {
        name: replace(axis, error_acts=acts) if name in linear else axis
        for name, axis in machine.axes.items()
    }
    return replace(machine, axes=axes)
