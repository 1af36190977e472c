"""An axis with two drives: what the second encoder says of the carriage's yaw."""

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
from abbe.compcore.effects.keys import Finite
from abbe.compcore.effects.registry import register
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, nominal_direction

_UNIT = {"X": 0, "Y": 1, "Z": 2}
LENGTHS = ("mm", "um", "µm")
"""Units of the difference of two encoders."""


@register
class TwoDrives(Effect):
    """A gantry with two drives: the slave runs ahead of the master, and the bridge yaws.

    The control shows the master's encoder as the axis's position. What the slave's encoder shows
    less the master's is how far the other leg is ahead: divided by the legs' distance, the angle by
    which the bridge is turned. Where the master's scale is, nothing is wrong; at the tool it is the
    angle times the distance to the master.

    Formula
        ``φ = (d − zero)/(slave − master)`` about the direction square to the axis and to
        ``across``; ``E_C = φ`` for an axis Y with drives apart along X (−φ for an axis X with
        drives apart along Y), and a shift of ``−φ·master`` along the axis, so that the master's
        line is where the axis says it is.
    Parameters
    ----------
        zero in mm, the difference at which the bridge is square; within ±2 mm. It depends on where
        the slave was referenced, and cannot be distinguished from a squareness unless the
        difference changes.
    Signals
        One, in mm: the slave's reading minus the master's at the same moment.
    Typical causes
        Uneven friction or load on the legs, a screw that is warmer on one side, slave referenced
        askew, a soft coupling of the drives.
    Cure
        Reference both sides squarely, share the torque, keep both screws at one temperature;
        compensation L-ANG from the difference, or of the slave by a table of its own.
    Source
        ISO/TR 16907:2015, 10.1 (axes with two drives, master and slave).
    """

    kind = "two_drives"
    axis: str
    signal: str
    across: AxisLetter
    master: Finite
    slave: Finite

    def check(self, machine: Machine) -> None:
        """A linear axis, drives apart square to it, a length as signal."""
        super().check(machine)
        axis = machine.axis(self.axis)
        if axis.rotary or not np.allclose(axis.direction, nominal_direction(self.axis)):
            raise InputError(
                "two drives belong to a linear axis along X, Y or Z", field="axis", found=self.axis
            )
        if abs(axis.direction[_UNIT[self.across]]) > 0.5:
            raise InputError(
                "the drives of an axis are not apart along itself", field="across",
                found=self.across, expected="a direction square to the axis",
            )  # fmt: skip
        if abs(self.slave - self.master) < 10.0:
            raise InputError(
                "two drives at one place", field="slave", found=self.slave,
                expected="at least 10 mm from the master",
            )  # fmt: skip
        unit = machine.signals[self.signal].unit
        if unit not in LENGTHS:
            raise InputError(
                "the difference of two encoders is a length", field="signal",
                found=f"{self.signal} in {unit}", expected="a signal in mm or um",
            )  # fmt: skip

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The difference at which the bridge is square, mm."""
        text = f"difference of the drives of {self.axis} at which it is square"
        return (Parameter("zero", "mm", (-2.0, 2.0), text),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """The yaw, and the shift that leaves the master's line where it is."""
        axis = machine.axis(self.axis)
        scale = 1.0 if machine.signals[self.signal].unit == "mm" else 1e-3
        apart = self.slave - self.master
        turned = scale * np.asarray(conditions.signals[self.signal]) / apart
        own, across = np.asarray(axis.direction), np.eye(3)[_UNIT[self.across]]
        about = np.cross(across, own)
        k, a = int(np.abs(about).argmax()), int(np.abs(own).argmax())
        yaw: Component = ABOUT["XYZ"[k]]
        along: Component = "XYZ"[a]  # type: ignore[assignment]
        lever = self.master - axis.rotation_point[_UNIT[self.across]]
        one = np.full((conditions.n, 1), -1.0 / apart)
        found = []
        for component, factor in ((yaw, about[k]), (along, -own[a] * lever)):
            motion = ErrorMotion(self.axis, component)
            found.append(Motion(motion, factor * one, known=factor * turned))
        return tuple(found)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None: the difference says it all."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[TwoDrives]:
        """None: where the drives are, a campaign does not say."""
        return ()
