"""Error motions by name: a component at a place of the machine, or of the instrument."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Component = Literal["X", "Y", "Z", "A", "B", "C"]
AxisLetter = Literal["X", "Y", "Z"]

FUNCTIONAL_POINT = "point"
SPINDLE = "spindle"
WORKPIECE = "workpiece"
INSTRUMENT = "instrument"

ABOUT: dict[str, Component] = {"X": "A", "Y": "B", "Z": "C"}
"""Rotation about X, Y, Z → its ISO letter."""


@dataclass(frozen=True, slots=True)
class ErrorMotion:
    """An error motion by ISO 230-1, such as E_YX: component (X Y Z, A B C) and axis or place.

    `place` is an axis, or `FUNCTIONAL_POINT` (translations of the tool point in machine axes),
    `SPINDLE` (between the last axis and the tool), `WORKPIECE` (between the workpiece and the first
    axis), or `INSTRUMENT` (component X: the measured value itself, in its own unit).
    """

    place: str
    component: Component

    @property
    def rotation(self) -> bool:
        """Whether the error motion is an angle (rad) and not a length (mm)."""
        return self.component in "ABC"

    @property
    def unit(self) -> str:
        """Unit inside the code: ``mm`` or ``rad``."""
        return "rad" if self.rotation else "mm"

    def __str__(self) -> str:
        if self.place == FUNCTIONAL_POINT:
            return f"d{self.component}"
        if self.place == INSTRUMENT:
            return "measured value"
        place = {SPINDLE: "(spindle)", WORKPIECE: "(workpiece)"}.get(self.place, self.place)
        return f"E_{self.component}{place}"
