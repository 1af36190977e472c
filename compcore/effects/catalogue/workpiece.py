"""Effects of the workpiece: its expansion away from the reference temperature."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import WORKPIECE, Effect, ErrorMotion, Motion, Parameter
from abbe.compcore.effects.keys import Vector
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.signals import by_sense, excess, recorded, require_temperatures
from abbe.compcore.effects.targets import TRANSLATIONS
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine


@register
class WorkpieceExpansion(Effect):
    """Thermal expansion of the workpiece: lengths are stated at 20 °C and measured at another.

    The warm workpiece is too large. Where the machine stands at its point p, that point will be at
    p·(1 − α·(T − T0)) when the workpiece has cooled (ISO 1): this is the error of the indicated
    position *as a statement about the workpiece at T0*, and what a corrected reading takes out. A
    calibrated artefact shows it the same way.

    Formula
        ``e = −α·(p − datum)·(T − T0)``, p the functional point in the workpiece's frame (mm), the
        same in all directions; ``datum`` (x,y,z in mm, default 0,0,0): the point held fixed.
    Parameters
    ----------
        alpha in 1/K, the workpiece's expansion coefficient, between 0 and 40 ppm/K: Invar 1, steel
        11.5, aluminium 23; zero-expansion ceramics 0.
    Signals
        One temperature of the workpiece or artefact, °C.
    Typical causes
        Workpieces straight from machining or storage, coolant, artefacts handled by hand.
    Cure
        Soak before measuring; workpiece temperature in the program; never mixed into the machine's
        own tables.
    Source
        ISO 1:2022; ISO/TR 16015 (length measurements away from 20 °C).
    """

    kind = "workpiece_expansion"
    scope = "workpiece"
    reads_tool = True
    signal: str
    datum: Vector = (0.0, 0.0, 0.0)

    def check(self, machine: Machine) -> None:
        """A temperature."""
        super().check(machine)
        require_temperatures(machine, "signal", [self.signal])

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The expansion coefficient."""
        return (Parameter("alpha", "1/K", (0.0, 40e-6), "expansion of the workpiece"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``−(p − datum)·(T − T0)`` in the workpiece's X, Y and Z."""
        warmth = excess(machine, conditions, self.signal, None)
        point = Chain(machine, conditions).point
        return tuple(
            Motion(ErrorMotion(WORKPIECE, k), ((self.datum[i] - point[:, i]) * warmth)[:, None])
            for i, k in enumerate(TRANSLATIONS)
        )

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """All of them: they say where on the workpiece the point lies."""
        return machine.structure.axes

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[WorkpieceExpansion]:
        """Each recorded temperature: the workpiece's own first. In one place it is a mere shift."""
        signals = recorded(machine, coverage, temperature=True) if coverage.moving else []
        for signal in by_sense(signals, ("workpiece",)):
            yield cls(signal=signal.name)
