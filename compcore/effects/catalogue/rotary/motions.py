"""Error motions of rotary axes: positioning, radial, axial, tilt (ISO 230-7)."""

from __future__ import annotations

from collections.abc import Iterable

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import (
    ABOUT,
    AxisLetter,
    Component,
)
from abbe.compcore.effects.catalogue.rotary.over_an_arc import RotaryMotion, held, read_of
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.targets import TRANSLATIONS, turned_about
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import WHOLE_TURN, Machine, own_component


@register
class RotaryPositioning(RotaryMotion):
    """Angular positioning error of a rotary axis, E_CC (ISO 230-2 for rotary axes).

    Formula
        ``E_CC = Σ A_h·cos(hθ) + B_h·sin(hθ)``, h = 1 … ``harmonics`` (default 2), θ the axis's
        angle; or a ``shape`` over the travel (spline:N; table with ``positions`` in degrees) where
        the error does not repeat after a turn. The mean is the zero angle of `rotary_location`.
    Parameters
    ----------
        A1, B1, … in rad (coefficients of the shape likewise), within ±500 µrad: an eccentric
        encoder ring gives one harmonic of eccentricity/radius (5 µm on 100 mm: 50 µrad), a worm one
        at its number of teeth.
    Signals
        None beyond the angle.
    Typical causes
        Eccentric or distorted encoder ring, errors of worm wheel or gear, a coupling at an angle.
    Cure
        Two reading heads opposite each other; table of angular positions (R-POS).
    Source
        ISO 230-2 (rotary axes); ISO 230-7:2015; ISO/TR 16907:2015, 6 and 8.2 (R-POS).
    """

    kind = "rotary_positioning"

    def component(self) -> Component:
        """About the axis itself."""
        return own_component(self.axis)  # type: ignore[return-value]

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[RotaryPositioning]:
        """Each rotary axis that moved, also once a turn; where it does not turn around, a curve.

        Within part of a turn waves imitate one another, with amplitudes that no ring has.
        """
        moving = [a for a in machine.structure.rotary if a in coverage.moving]
        yield from held((cls(axis=a) for a in moving), machine, coverage)
        for axis in (machine.axis(a) for a in moving):
            if 2.0 * axis.half_travel < WHOLE_TURN:
                yield cls(axis=axis.name, shape="spline:4").held_beyond(*read_of(axis, coverage))
            else:
                yield cls(axis=axis.name, harmonics=1).held_beyond(*read_of(axis, coverage))


@register
class RotaryRadial(RotaryMotion):
    """Radial error motion of a rotary axis: its line wanders sideways while it turns, E_XC, E_YC.

    Formula
        ``E_dC = Σ A_h·cos(hθ) + B_h·sin(hθ)``, h = 1 … ``harmonics`` (default 2), d a direction
        across the axis; or a ``shape`` over the travel.
        On the workpiece side it is the tool's motion relative to the table: an indicator or R-test
        on the table itself shows the opposite sign.
    Parameters
    ----------
        A1, B1, … in mm, within ±50 µm; rolling bearings 1 to 5 µm, hydrostatic below 0.5 µm. The
        first harmonic of both directions together, a point that circles with the axis, is the same
        as an artefact or tool that is mounted off its centre.
    Signals
        None beyond the angle.
    Typical causes
        Out-of-round bearing seats, bearings without preload, unbalance, wear.
    Cure
        New bearings, preload; compensation R-RAX where linear axes can follow.
    Source
        ISO 230-7:2015 (radial error motion); ISO/TR 16907:2015, 6 and 8.2 (R-RAX).
    """

    kind = "rotary_radial"
    direction: AxisLetter

    def component(self) -> Component:
        """Across the axis."""
        return self.direction

    def check(self, machine: Machine) -> None:
        """A direction across the axis."""
        super().check(machine)
        _across(self.axis, self.direction, "radial error motion")

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[RotaryRadial]:
        """Two for each rotary axis that moved."""
        for axis in (a for a in machine.structure.rotary if a in coverage.moving):
            for direction in TRANSLATIONS:
                if direction != turned_about(axis):
                    at = read_of(machine.axis(axis), coverage)
                    yield cls(axis=axis, direction=direction).held_beyond(*at)


@register
class RotaryAxial(RotaryMotion):
    """Axial error motion of a rotary axis: it moves along its own line while it turns, E_ZC.

    Formula
        ``E_ZC = Σ A_h·cos(hθ) + B_h·sin(hθ)``, h = 1 … ``harmonics`` (default 2); or a ``shape``
        over the travel. ``direction`` may be left out; it is the axis's own.
        On the workpiece side an indicator on the table itself shows the opposite sign.
    Parameters
    ----------
        A1, B1, … in mm, within ±50 µm; good tables 1 to 3 µm.
    Signals
        None beyond the angle.
    Typical causes
        Thrust bearing faces not square or not flat, chips under the table, wear.
    Cure
        Re-grind or exchange the thrust bearing; compensation R-RAX.
    Source
        ISO 230-7:2015 (axial error motion); ISO/TR 16907:2015, 6 and 8.2 (R-RAX).
    """

    kind = "rotary_axial"
    direction: AxisLetter | None = None

    def component(self) -> Component:
        """Along the axis."""
        return turned_about(self.axis)

    def check(self, machine: Machine) -> None:
        """The axis's own direction, if any is given."""
        super().check(machine)
        if self.direction not in (None, self.component()):
            raise InputError(
                "axial error motion is along the axis; across it the effect is 'rotary_radial'",
                field="direction",
                found=self.direction,
                expected=self.component(),
            )

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[RotaryAxial]:
        """Each rotary axis that moved."""
        moving = (a for a in machine.structure.rotary if a in coverage.moving)
        return held((cls(axis=a) for a in moving), machine, coverage)


@register
class RotaryTilt(RotaryMotion):
    """Tilt error motion of a rotary axis: its line wobbles while it turns, E_AC, E_BC.

    Formula
        ``E_AC`` (direction X) or ``E_BC`` (direction Y) ``= Σ A_h·cos(hθ) + B_h·sin(hθ)``, a turn
        about the ``direction``, right-handed, h = 1 … ``harmonics`` (default 2); or a ``shape``
        over the travel.
        On the workpiece side a level on the table itself shows the opposite sign.
    Parameters
    ----------
        A1, B1, … in rad, within ±500 µrad; good tables 2 to 20 µrad. At the functional point it
        grows with the height above the table.
    Signals
        None beyond the angle.
    Typical causes
        Bearing planes not flat, a table bolted down unevenly, unbalance of the workpiece.
    Cure
        Scraping of the seat, preload; compensation R-ANG.
    Source
        ISO 230-7:2015 (tilt error motion); ISO/TR 16907:2015, 6 and 8.2 (R-ANG).
    """

    kind = "rotary_tilt"
    direction: AxisLetter

    def component(self) -> Component:
        """About the direction."""
        return ABOUT[self.direction]

    def check(self, machine: Machine) -> None:
        """A direction across the axis."""
        super().check(machine)
        _across(self.axis, self.direction, "tilt error motion")

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[RotaryTilt]:
        """Two for each rotary axis that moved."""
        for axis in (a for a in machine.structure.rotary if a in coverage.moving):
            for direction in TRANSLATIONS:
                if direction != turned_about(axis):
                    at = read_of(machine.axis(axis), coverage)
                    yield cls(axis=axis, direction=direction).held_beyond(*at)


def _across(axis: str, direction: str, what: str) -> None:
    own = turned_about(axis)
    if direction == own:
        raise InputError(
            f"a {what} is across the axis",
            field="direction",
            found=direction,
            expected="one of " + ", ".join(d for d in "XYZ" if d != own),
        )
