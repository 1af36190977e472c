"""Thermal angles: bodies that bend and lean because one side is warmer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import ABOUT, F64, AxisLetter, ErrorMotion, Motion, Parameter
from abbe.compcore.effects.keys import Pair
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.signals import (
    ACTING,
    LAGGING,
    LaggedEffect,
    OneOrTwoSignals,
    by_sense,
    excess,
    heats,
    pairs_by_sense,
    per,
    recorded,
    two_alike,
)
from abbe.compcore.effects.targets import TRANSLATIONS, require_linear
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine, Signal, own_component
from abbe.compcore.machine.typical import typical


@register
class ThermalBending(LaggedEffect):
    """A column, beam or bed that bends because one side is warmer than the other.

    A beam of height h with a temperature difference ΔT across it takes the curvature α·ΔT/h. What
    rides on it turns in proportion to how far along it stands.

    Formula
        ``E_Aa, E_Ba or E_Ca = κ·(T1 − T2)·q_a``, q_a counted from the axis's zero, optionally with
        T1 − T2 behind a first-order lag τ. With ``deflection = true`` the beam's own bending line
        ``½·κ·(T1 − T2)·q_a²`` goes with it, across the axis, as the beam's slope demands; without,
        what it does across is left to straightness.
    Parameters
    ----------
        kappa = α/h in rad/(K·mm), right-handed, signed by the order of the two signals: within
        ±0.3 µrad/(K·mm). Steel 100 mm high has 0.115, a cast bed of 500 mm 0.02, so that 1 K bends
        1 m by 20 µrad.
    Signals
        Two temperatures on opposite sides of one body: column front and rear, bed top and bottom.
    Typical causes
        Floor and ceiling at different temperatures, sun or a heater on one side, warm coolant in
        the bed, a spindle motor at the column's front.
    Cure
        Insulation, coolant kept at machine temperature, air circulation; live compensation by two
        sensors.
    Source
        Timoshenko, Strength of Materials (bimetal and thermal gradient); ISO/TR 16015; Mayr et al.,
        CIRP Annals 61/2 (2012), 771-791.
    """

    kind = "thermal_bending"
    axis: str
    about: AxisLetter
    signals: Pair
    deflection: bool = False

    def check(self, machine: Machine) -> None:
        """A linear axis, two different signals of one unit, a deflection only across the axis."""
        super().check(machine)
        require_linear(machine, self.axis, self.kind)
        two_alike(machine, self.signals)
        if self.deflection and np.linalg.norm(self._across(machine.axis(self.axis))) < 1e-6:
            raise InputError(
                "a twist about the axis itself has no deflection",
                field="deflection",
                found=True,
                expected="about a direction across the axis",
            )

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The curvature by temperature difference."""
        text = f"bending of {self.axis} about {self.about}"
        signal = machine.signals[self.signals[0]]
        unit = "K" if signal.temperature else signal.unit
        most = 3e-6 / typical(signal).change
        return (Parameter("kappa", f"rad/({unit}·mm)", (-most, most), text),)

    def _across(self, axis: Axis) -> F64:
        """Where the beam's end goes, shape (3,): the turn's direction × the axis's."""
        about = np.eye(3)["XYZ".index(self.about)]
        return np.asarray(np.cross(about, axis.direction))

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``(T1 − T2)·q_a`` on the turn; held at the ends of the travel."""
        tau = self.lag(nonlinear)
        one, two = (excess(machine, conditions, s, tau) for s in self.signals)
        axis = machine.axis(self.axis)
        position = axis.clamp(conditions.position(self.axis))
        turn = (one - two) * position
        found = [Motion(ErrorMotion(self.axis, ABOUT[self.about]), turn[:, None])]
        if self.deflection:
            # where its own move is in the lever, the turn over that move is twice what is wanted
            half = -0.5 if machine.own_move_in_lever(self.axis) else 0.5
            found += [
                Motion(
                    ErrorMotion(self.axis, TRANSLATIONS[k]),
                    (half * part * turn * position)[:, None],
                )
                for k, part in enumerate(self._across(axis))
                if abs(part) > 1e-12
            ]
        return tuple(found)

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The ends of the travel."""
        return {self.axis: machine.axis(self.axis).travel}

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[ThermalBending]:
        """Each axis, turn and pair of temperatures: pairs of the structure first.

        Bending (about a direction across the axis) before twist. Pairs of the structure also with
        the bending line, and lagged, since the core of a column follows its skin.
        """
        for axis in (a for a in machine.structure.linear if a in coverage.moving):
            pairs = pairs_by_sense(recorded(machine, coverage, temperature=True), axis)
            own = own_component(axis)
            turns = [d for d in TRANSLATIONS if d != own] + [own]
            for pair in pairs:
                names = (pair[0].name, pair[1].name)
                for about in turns:
                    yield cls(axis=axis, about=about, signals=names)
                    if _of_structure(pair):
                        yield cls(axis=axis, about=about, signals=names, tau="fit")
                        if about != own:
                            yield cls(axis=axis, about=about, signals=names, deflection=True)


@register
class ThermalTilt(OneOrTwoSignals):
    """A constant angle that moves with temperature: squareness that is right at 20 °C only.

    Formula
        ``E_Aa, E_Ba or E_Ca = k·(T − T0)`` for one ``signal``, ``k·(T1 − T2)`` for two ``signals``;
        optionally behind a first-order lag τ. The turn is that of all that stands behind the error
        of axis a, as for `angular`.
    Parameters
    ----------
        k in rad/K, right-handed; within ±100 µrad/K. A column on two feet 500 mm apart, one of them
        warmer by 1 K over 300 mm of cast iron, leans by 6 µrad.
    Signals
        One temperature, or two on opposite sides of the body that leans.
    Typical causes
        A column whose front and rear warm unequally, a bridge with one leg in the sun, feet and
        foundation, a head that tilts as its bearings warm.
    Cure
        Shielding and insulation, symmetric heat, re-alignment at working temperature; live
        compensation.
    Source
        ISO 230-3 (tilt by thermal distortion); Mayr et al., CIRP Annals 61/2 (2012), 771-791.
    """

    kind = "thermal_tilt"
    axis: str
    about: AxisLetter

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The turn by temperature."""
        signal = machine.signals[self.signals_needed()[0]]
        most = 1e-3 / typical(signal).change
        text = f"tilt of {self.axis} about {self.about}"
        return (Parameter("k", per("rad", signal), (-most, most), text),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``T − T0`` or ``T1 − T2`` on the turn."""
        heat = self.heat(machine, conditions, self.lag(nonlinear))
        return (Motion(ErrorMotion(self.axis, ABOUT[self.about]), heat[:, None]),)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None: the angle is the same wherever the axis stands."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[ThermalTilt]:
        """Each axis and turn: pairs of the structure, single signals, all other pairs.

        Lagged: pairs of the structure, and single signals that are not measured on the body itself.
        """
        for axis in machine.structure.axes:
            temperatures = recorded(machine, coverage, temperature=True)
            pairs = pairs_by_sense(temperatures, axis)
            singles = by_sense(temperatures, ("structure", "ambient", "spindle"), axis)
            others = recorded(machine, coverage, temperature=False)
            others = [s for s in others if s.role in ACTING and heats(s)]
            if not coverage.levers:
                # an angle that no lever shows is a shift; by one signal it is `thermal_offset`
                singles, others = [], []
            for about in ("X", "Y", "Z"):
                for pair in (p for p in pairs if _of_structure(p)):
                    names = (pair[0].name, pair[1].name)
                    yield cls(axis=axis, about=about, signals=names)
                    yield cls(axis=axis, about=about, signals=names, tau="fit")
                for signal in [*singles, *others]:
                    yield cls(axis=axis, about=about, signal=signal.name)
                    if signal.role in LAGGING:
                        yield cls(axis=axis, about=about, signal=signal.name, tau="fit")
                for pair in (p for p in pairs if not _of_structure(p)):
                    yield cls(axis=axis, about=about, signals=(pair[0].name, pair[1].name))


def _of_structure(pair: tuple[Signal, Signal]) -> bool:
    return pair[0].role == pair[1].role == "structure"
