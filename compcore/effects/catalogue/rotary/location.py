"""Position and orientation of a rotary axis's average line (ISO 230-7)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import (
    ABOUT,
    Component,
    Effect,
    ErrorMotion,
    Motion,
    Parameter,
)
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.targets import TRANSLATIONS, require_rotary, turned_about
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, own_component


@register
class RotaryLocation(Effect):
    """Where a rotary axis really lies: position and orientation of its axis average line.

    Every computation with a rotary axis takes the place of its line from the machine's parameters.
    If the line lies elsewhere, or leans, each point moves on another circle than the one computed.

    Formula
        Constants on the axis's error motions, in its stator's frame, with their origin at the
        nominal line (``location`` in the model file). For a C axis: E_X0C, E_Y0C, E_A0C, E_B0C, and
        E_C0C (where it stands when it shows 0); for A and B by their letters. They are errors of
        the tool relative to the workpiece. On the **tool side** the line lies E_X0C, E_Y0C beside
        its nominal place and leans by E_A0C, E_B0C. On the **workpiece side** it is the opposite: a
        table C' whose line lies 10 µm towards −X of the nominal place has E_X0C = +10 µm. An axis
        that is carried by another counts from where the other carries it.
    Parameters
    ----------
        E_X0C, E_Y0C in mm, within ±0.2 mm; E_A0C, E_B0C, E_C0C in rad, within ±1 mrad. After a
        careful set-up 5 to 20 µm and 10 to 50 µrad; more after a collision. No value of E_C0C is
        doubted: where an encoder counts from is a convention, of a robot's joint any angle. Nor of
        E_C0B where C carries B: C counts from where the line of B stands as it should. Nor of a
        head's E_X0B, E_Z0B where no rotary axis carries it: there X and Z count from elsewhere.
    Signals
        None beyond the angle, which turns the levers.
    Typical causes
        Set-up of the table or head, an old value in the controller, collision, thermal growth of
        column or trunnion.
    Cure
        Calibrate with a sphere and probe (R-test) and enter the place and direction that ``abbe
        fit`` says, on either side of the bed (not the nominal place plus the parameter: on the
        workpiece side that doubles the error); then take the effect out. Compensation R-POR.
    Source
        ISO 230-7:2015 (axis average line); ISO/TR 16907:2015, 6 and 8.2 (R-POR); ISO 10791-6.
    """

    kind = "rotary_location"
    axis: str

    def check(self, machine: Machine) -> None:
        """Rotary axes only."""
        super().check(machine)
        require_rotary(machine, self.axis, self.kind)

    def components(self) -> tuple[Component, ...]:
        """Two crossings, two leanings and the zero angle, as ISO lists them."""
        own = own_component(self.axis)
        across = [d for d in TRANSLATIONS if d != turned_about(self.axis)]
        leaning = [ABOUT[d] for d in across]
        zero: Component = own  # type: ignore[assignment]
        return (*across, *leaning, zero)

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """E_X0C, E_Y0C, E_A0C, E_B0C, E_C0C, and alike for A and B."""
        found = []
        zeros = {own_component(a) for a in (self.axis, *_carriers(machine, self.axis))}
        for k in self.components():
            error_motion = ErrorMotion(self.axis, k)
            plausible = (-1e-3, 1e-3) if error_motion.rotation else (-0.2, 0.2)
            text = f"axis average line of {self.axis}, {k}"
            if k == own_component(self.axis):
                text = f"where {self.axis} stands when it shows 0"
            # where an encoder counts from is agreed upon: no angle is more sound than another
            agreed = k in zeros or (
                not error_motion.rotation and _on_linear_axes(machine, self.axis)
            )
            found.append(
                Parameter(f"E_{k}0{self.axis}", error_motion.unit, plausible, text, agreed)
            )
        return tuple(found)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """One constant each."""
        one = np.ones((conditions.n, 1))
        return tuple(
            Motion(ErrorMotion(self.axis, k), one, first=i) for i, k in enumerate(self.components())
        )

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None: constants in the stator's frame."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[RotaryLocation]:
        """Each rotary axis that moved."""
        return (cls(axis=a) for a in machine.structure.rotary if a in coverage.moving)


def _on_linear_axes(machine: Machine, axis: str) -> bool:
    """Whether it is the first rotary axis of a head: where its line lies is their zeros."""
    head = [a for a in machine.structure.tool_side if machine.axes[a].rotary]
    return head[:1] == [axis] and any(not machine.axis(a).rotary for a in machine.structure.axes)


def _carriers(machine: Machine, axis: str) -> tuple[str, ...]:
    """The rotary axis next to one on the bed's side, about which its line is turned; or none."""
    for side in (machine.structure.tool_side, tuple(reversed(machine.structure.workpiece_side))):
        if axis in side:
            at = side.index(axis)
            return tuple(a for a in side[max(0, at - 1) : at] if machine.axis(a).rotary)
    return ()
