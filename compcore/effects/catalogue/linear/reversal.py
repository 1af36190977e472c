"""Reversal effects: what flips with an axis's approach direction (ISO 230-2)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import ABOUT, AxisLetter, Component, ErrorMotion, Motion, Parameter
from abbe.compcore.effects.catalogue.shaped import ShapedEffect
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.targets import TRANSLATIONS, along
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.machine.structure import is_rotary


class ReversalEffect(ShapedEffect):
    """Half of a reversal value times the approach direction, on one error motion of an axis."""

    shape: str = "constant"

    def plausible(self) -> tuple[float, float]:
        """±50 µm, or ±100 µrad."""
        return (-0.05, 0.05) if self.component() in "XYZ" else (-1e-4, 1e-4)

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The reversal value, or its coefficients along the axis."""
        error_motion = ErrorMotion(self.axis, self.component())
        names = self.parsed_shape(machine).names
        if self.shape == "constant":
            names = ("b",)
        return tuple(
            Parameter(
                name,
                error_motion.unit,
                self.plausible(),
                f"reversal value of {error_motion}, {name}",
            )
            for name in names
        )

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``½ s_a`` times the shape; 0 where the direction was not recorded."""
        half = 0.5 * conditions.direction(self.axis)[:, None]
        error_motion = ErrorMotion(self.axis, self.component())
        return (Motion(error_motion, self.basis(machine, conditions) * half),)

    def directions_used(self) -> tuple[str, ...]:
        """The axis itself."""
        return (self.axis,)


@register
class Backlash(ReversalEffect):
    """Backlash: the axis stands elsewhere when it arrives from the other side (ISO 230-2).

    Play between the drive and the carriage, or wind-up of a drive that pushes against friction, is
    not seen by an encoder on the motor. The carriage stops short of where it would have stopped
    without it, on one side when it comes from below, on the other when it comes from above.

    Formula
        ``E_aa = ½·b·s_a``, s_a = +1 where the axis arrived in its positive direction, −1 in its
        negative one, 0 where that is not known. With a shape along the axis
        ``½·s_a·Σ b_i·B_i(q_a)``.
    Parameters
    ----------
        b in mm (rotary axes rad): the reversal value of ISO 230-2, mean arrival in the positive
        direction minus mean arrival in the negative one. Negative for lost motion behind a motor
        encoder, positive where a controller compensates too much. Within ±50 µm (100 µrad): ball
        screws without preload have 20 to 30 µm; a worm or rack that is beyond that needs repair.
    Signals
        None beyond the approach directions, columns ``X_dir``, … of a campaign.
    Typical causes
        Play in ball screw, nut, thrust bearing, coupling, rack or worm; wind-up against friction,
        grows with seal friction and with the distance from the motor (a shape along the axis); a
        loose scale reader.
    Cure
        Preload or new nut and bearing; backlash compensation of the controller; a scale on the
        carriage; arriving from one side only.
    Source
        ISO 230-2 (reversal value); ISO/TR 16907:2015, 9.2 (values by direction).
    """

    kind = "backlash"

    def component(self) -> Component:
        """Along (rotary: about) the axis itself."""
        return along(self.axis).component

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Backlash]:
        """Each axis that arrived from both sides: the same everywhere, then along the axis."""
        for axis in machine.structure.axes:
            if axis in coverage.reversing:
                yield cls(axis=axis)
        for axis in machine.structure.axes:
            if axis in coverage.reversing and axis in coverage.moving:
                yield cls(axis=axis, shape="polynomial:2")


@register
class ReversalAngle(ReversalEffect):
    """An angle that flips with the direction of travel: the carriage cocks when it reverses.

    A carriage that is driven beside its friction's centre turns a little until its guides take the
    moment, the other way when it goes back. At the functional point this is a reversal value that
    grows with the lever.

    Formula
        ``E_Aa, E_Ba or E_Ca = ½·b·s_a``, about X, Y or Z, s_a as for backlash; optionally with a
        shape along the axis.
    Parameters
    ----------
        b in rad, angle after arrival in the positive direction minus angle after arrival in the
        negative one; within ±100 µrad. A stiff bridge stays below 5 µrad, one that is driven on one
        side only reaches 20 to 50 µrad.
    Signals
        None beyond the approach directions.
    Typical causes
        A bridge or gantry driven on one leg, a belt or rack far from the guide, loose guideway
        preload or an air gap too large, play in a gib.
    Cure
        Drive nearer to the centre of friction, gib and preload adjustment, both gantry sides
        driven; arriving from one side only.
    Source
        Schwenke et al., CIRP Annals 57/2 (2008), 660-675; ISO 230-2 for the reversal value.
    """

    kind = "reversal_angle"
    about: AxisLetter

    def component(self) -> Component:
        """About the stated direction."""
        return ABOUT[self.about]

    def check(self, machine: Machine) -> None:
        """A turn that is not the motion of a rotary axis itself."""
        super().check(machine)
        if self.component() == own_component(self.axis):
            raise InputError(
                "about its own axis of rotation the effect is 'backlash'",
                field="about",
                found=self.about,
            )

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[ReversalAngle]:
        """Three for each axis that arrived from both sides; two for a rotary one."""
        for axis in machine.structure.axes:
            if axis in coverage.reversing:
                for about in ("X", "Y", "Z"):
                    if ABOUT[about] != own_component(axis):
                        yield cls(axis=axis, about=about)


@register
class LateralReversal(ReversalEffect):
    """The carriage steps aside when it reverses: straightness by direction.

    A guide with play, or a drive that does not push along it, leaves the carriage at one flank on
    the way there and at the other on the way back. A straightedge shows two lines side by side; on
    a circle the step stands where the *other* axis moves fastest. A rotary axis that is driven from
    one side leaves its average line by direction: radial, or axial for a ``direction`` along it.

    Formula
        ``E_da = ½·b·s_a``, d the direction, s_a as for backlash; optionally with a shape along the
        axis, ``½·s_a·Σ b_i·B_i(q_a)``: a squareness or straightness that depends on the direction.
    Parameters
    ----------
        b in mm, place after arrival in the positive direction minus place after arrival in the
        negative one; within ±50 µm. Preloaded guides stay below 1 µm, sliding ones with gibs reach
        5 to 20 µm.
    Signals
        None beyond the approach directions.
    Typical causes
        Play in gibs or rollers, a belt, rack or screw that pulls aside, a worm that presses its
        wheel against the bearing.
    Cure
        Gib and preload adjustment, the drive nearer to the guide, clamping while cutting; tables
        with two directions (ISO/TR 16907, 8.4 and 9.2); arriving from one side only.
    Source
        ISO/TR 16907:2015, 8.4 and 9.2.3; ISO 230-1 for straightness by direction.
    """

    kind = "lateral_reversal"
    direction: AxisLetter

    def component(self) -> Component:
        """The stated direction."""
        return self.direction

    def check(self, machine: Machine) -> None:
        """A step aside, not along the axis itself."""
        super().check(machine)
        if self.direction == own_component(self.axis):
            raise InputError(
                "along its own travel the effect is 'backlash'",
                field="direction",
                found=self.direction,
                expected="one of " + ", ".join(d for d in "XYZ" if d != self.direction),
            )

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[LateralReversal]:
        """Two for each linear axis that arrived from both sides, three for a rotary one.

        Then, for linear ones that moved, the same with a slope: squareness by direction.
        """
        reversing = [axis for axis in machine.structure.axes if axis in coverage.reversing]
        for axis in reversing:
            for direction in TRANSLATIONS:
                if direction != own_component(axis):
                    yield cls(axis=axis, direction=direction)
        for axis in reversing:
            if axis in coverage.moving and not is_rotary(axis):
                for direction in TRANSLATIONS:
                    if direction != own_component(axis):
                        yield cls(axis=axis, direction=direction, shape="polynomial:1")
