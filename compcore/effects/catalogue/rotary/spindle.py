"""Squareness of the spindle's average line to the linear axes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import (
    SPINDLE,
    AxisLetter,
    Effect,
    ErrorMotion,
    Motion,
    Parameter,
)
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.targets import ROTATIONS, TRANSLATIONS, turned_about
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine

_JOINTS = 3
"""Rotary axes from which on what carries the tool is an arm; two point a telescope."""


@register
class SpindleSquareness(Effect):
    """The spindle's axis average line is not parallel to the axis that it should be parallel to.

    Two tools of different lengths then touch at different places, and a face cutter leaves a
    hollow.

    Formula
        The spindle leans towards ``direction`` by a constant angle: a turn about s × direction at
        the spindle, s the spindle's nominal direction (Z; the letter in brackets in the structure
        code says otherwise; of an arm of joints alone the line of the last one). For a spindle
        along Z, direction X is ISO's E_B of the spindle, and direction Y its −E_A.
    Parameters
    ----------
        angle in rad, positive where a longer tool's far side (positive s) leans towards positive
        direction; within ±500 µrad (0.02 mm in 300 mm is 67 µrad).
    Signals
        None; tools of different lengths, or a turned tool with a radial offset, show it.
    Typical causes
        Alignment of the head, a collision, thermal tilt of the head.
    Cure
        Shim the head; tool lengths given to the controller with L-ANG or L-VOL.
    Source
        ISO 230-7:2015; ISO 10791-1 (squareness of the spindle); Krulewich, LLNL, who fits the
        spindle's two squarenesses along with the machine.
    """

    kind = "spindle_squareness"
    direction: AxisLetter

    def check(self, machine: Machine) -> None:
        """A direction across the spindle."""
        super().check(machine)
        along = spindle_direction(machine)
        if self.direction == along:
            raise InputError(
                "a spindle leans across its own direction",
                field="direction",
                found=self.direction,
                expected="one of " + ", ".join(d for d in "XYZ" if d != along),
            )

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The angle."""
        text = f"lean of the spindle towards {self.direction}"
        return (Parameter("angle", "rad", (-5e-4, 5e-4), text),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """A constant turn between the last axis and the tool."""
        unit = np.eye(3)
        turn = np.cross(
            unit["XYZ".index(spindle_direction(machine))], unit["XYZ".index(self.direction)]
        )
        k = int(np.argmax(np.abs(turn)))
        return (Motion(ErrorMotion(SPINDLE, ROTATIONS[k]), np.full((conditions.n, 1), turn[k])),)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None: a constant."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[SpindleSquareness]:
        """Both directions where the tool's offset varied: with one tool it is a shift.

        Also where orientations were measured while rotary axes turned the spindle: collimation.
        """
        turned = any(a in coverage.moving for a in machine.structure.rotary)
        rotations = any("rotation" in seen.kinds for seen in coverage.setup_details.values())
        if not coverage.tool_varies and not (turned and rotations):
            return
        along = spindle_direction(machine)
        for direction in TRANSLATIONS:
            about = next((d for d in TRANSLATIONS if d not in (along, direction)), along)
            # a lean about the line of the last rotary axis is that axis's zero
            zero = not coverage.tool_varies and about == _last_turned(machine)
            if direction != along and not zero:
                yield cls(direction=direction)


def _last_turned(machine: Machine) -> str | None:
    """The direction about which the last axis before the tool turns; None where it is linear."""
    last = machine.structure.tool_side[-1:]
    return turned_about(last[0]) if last and machine.axes[last[0]].rotary else None


def spindle_direction(machine: Machine) -> AxisLetter:
    """The spindle's nominal direction: Z, or that of the letter in brackets in the structure.

    Of an arm of joints that names none, the line about which its last joint turns the flange.
    """
    structure = machine.structure
    name = structure.spindle
    joints = all(machine.axes[a].rotary for a in structure.axes)
    if name is None and joints and len(structure.tool_side) >= _JOINTS:
        name = structure.tool_side[-1]
    return "Z" if name is None else turned_about(name)
