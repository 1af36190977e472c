"""Where a head holds its spindle: pivot length, and the spindle's line beside the head's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import (
    FUNCTIONAL_POINT,
    SPINDLE,
    Component,
    Effect,
    ErrorMotion,
    Motion,
    Parameter,
)
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.targets import TRANSLATIONS
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine


@register
class SpindleLocation(Effect):
    """Where a head holds its spindle: pivot length, and the spindle's line beside the head's.

    The controller turns the tool about the head's line and takes the distance from there to the
    tool from its parameters. If the spindle sits elsewhere in the head, the tool's tip stays right
    with the head at zero and goes astray as the head turns.

    Formula
        ``e = R·p − p``, p = (E_X0S, E_Y0S, E_Z0S) a constant that turns with the head, R the turn
        of the head's axes; zero with all of them at 0. Along the line of a head with one axis
        nothing is seen, and no parameter stands for it. An arm of joints: where its flange is.
    Parameters
    ----------
        E_X0S, E_Y0S, E_Z0S in mm, within ±0.2 mm: where the spindle is, as seen from the head's
        lines, less where it is configured, the head at zero. A head that hangs from its line above
        the tool has a pivot length that is too short by E_Z0S where this is positive.
    Signals
        None beyond the angles of the head.
    Typical causes
        An old pivot length in the controller, a spindle that was exchanged, a tool length that was
        measured from another plane: with one tool these are the same.
    Cure
        Enter the pivot length (head's kinematics) by sphere and probe, with two tools of known
        lengths to tell it from the tool's; then take the effect out.
    Source
        ISO 10791-6 (kinematic tests with heads); ISO/TR 16907:2015, 6.
    """

    kind = "spindle_location"

    def check(self, machine: Machine) -> None:
        """A machine whose tool is carried by a rotary axis."""
        super().check(machine)
        if not _head(machine):
            raise InputError(
                f"{self.kind} is an effect of heads",
                field="structure",
                found=str(machine.structure),
                expected="a rotary axis between the bed and the tool",
            )

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """E_X0S, E_Y0S, E_Z0S; of a head with one axis without the one along its line."""
        return tuple(
            Parameter(f"E_{d}0S", "mm", (-0.2, 0.2), f"the spindle's place in the head, {d}")
            for d in _seen(machine)
        )

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """A constant that turns with the head, less the same unturned."""
        one = np.ones((conditions.n, 1))
        found = []
        for i, d in enumerate(_seen(machine)):
            found.append(Motion(ErrorMotion(SPINDLE, d), one, first=i))
            found.append(Motion(ErrorMotion(FUNCTIONAL_POINT, d), -one, first=i))
        return tuple(found)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None: constants, seen from the spindle and from the bed."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[SpindleLocation]:
        """Where an axis of the head moved."""
        if any(a in coverage.moving for a in _head(machine)):
            yield cls()


def _head(machine: Machine) -> tuple[str, ...]:
    """The rotary axes between the bed and the tool."""
    return tuple(a for a in machine.structure.tool_side if machine.axes[a].rotary)


def _seen(machine: Machine) -> tuple[Component, ...]:
    """The directions in which a place in the head shows as the head turns."""
    lines = np.array([machine.axis(a).direction for a in _head(machine)])
    # what all of a head's axes turn about stays where it is
    return tuple(d for k, d in enumerate(TRANSLATIONS) if (np.abs(lines[:, k]) < 1.0 - 1e-9).any())
