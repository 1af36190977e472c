"""Effects of an instrument's placing: zero, slope and frame of a set-up (formats.md).

The column formulas stand here once, for the fit, which eliminates the set-ups that a campaign names
as ``free``, and for the effects by which a set-up that was thought known is found to be free.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import F64, INSTRUMENT, Effect, ErrorMotion, Motion, Parameter
from abbe.compcore.effects.registry import register
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine

Measures = Literal["length", "angle"]
"""Whether a set-up measures lengths (mm) or angles (rad)."""

MEASURED = ErrorMotion(INSTRUMENT, "X")
"""The measured value itself."""

_ONE_PLACE = 0.01
"""mm: points that extend less in some direction are one place in it."""

_LENGTH = 10.0
"""mm: what is shorter is not measured as a length."""


def path_coordinate(positions: F64) -> F64:
    """Where along its set-up's path each row stands, −1 … 1, shape (m,).

    The path is the line that fits the rows' axis positions best, from the middle of the set-up to
    its far end; it runs in the positive sense of the axis that moves most.

    Parameters
    ----------
    positions
        Shape (m, number of axes), mm or rad, of the rows of one set-up.
    """
    centred = positions - positions.mean(axis=0)
    _, _, directions = np.linalg.svd(centred, full_matrices=False)
    along = directions[0] * np.sign(directions[0][np.argmax(np.abs(directions[0]))])
    coordinate = centred @ along
    reach = float(np.abs(coordinate).max())
    return np.asarray(coordinate / reach if reach > 0.0 else coordinate)


def _extended(arm: F64) -> F64:
    """Points, (m, 3) mm about their middle, without directions in which they do not extend.

    A sphere that a tool follows is one point of the table, however its coordinates are rounded: no
    turn about it is seen, and none may be invented from the last decimals.
    """
    extent, axes = np.linalg.eigh(arm.T @ arm / max(len(arm), 1))
    seen = extent > _ONE_PLACE**2
    return arm if seen.all() else np.asarray(arm @ axes[:, seen] @ axes[:, seen].T)


def frame_columns(point: F64, toward: F64, about: F64) -> F64:
    """What a small rigid displacement of a whole set-up does to its rows, shape (m, 6).

    Three translations (mm per mm) and three rotations (mm or rad per rad) about the middle of the
    set-up's points. All in the workpiece's frame: an artefact that is clamped to a rotary table
    turns with it.

    Parameters
    ----------
    point
        Functional points, shape (m, 3), mm, workpiece's frame.
    toward
        Directions in which a displacement is seen, shape (m, 3); 0 on rows that see none.
    about
        Directions about which a rotation is seen, shape (m, 3); 0 on rows that see none.
    """
    arm = _extended(point - point.mean(axis=0))
    return np.hstack([toward, np.cross(arm, toward) + about])


class SetupEffect(Effect):
    """An effect on the measured values of one set-up."""

    scope = "instrument"
    setup: str
    measures: Measures = "length"

    @property
    def unit(self) -> str:
        """Unit of the measured value inside the code."""
        return "rad" if self.measures == "angle" else "mm"

    def rows(self, conditions: Conditions) -> NDArray[np.bool_]:
        """The set-up's rows that measure lengths, or angles, shape (n,).

        Raises
        ------
        InputError
            When the set-up has rows, but none that measure what `measures` says.
        """
        mask = conditions.setup_rows().mask(self.setup)
        if conditions.kind is None or not mask.any():
            return mask
        wanted = np.equal(conditions.kind, Kind.ROTATION) == (self.measures == "angle")
        if not (mask & wanted).any():
            other = "length" if self.measures == "angle" else "angle"
            raise InputError(
                f"set-up {self.setup} measures {other}s",
                field="measures",
                found=self.measures,
                expected=other,
            )
        return np.asarray(mask & wanted)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None of the machine's: an instrument's effects are never folded."""
        return ()

    @classmethod
    def keys_of(cls, coverage: Coverage, setup: str) -> dict[str, str]:
        """The where-keys for one of a campaign's set-ups; its lengths where it has both."""
        kinds = coverage.setup_details[setup].kinds
        return {"setup": setup} | ({"measures": "angle"} if kinds == {"rotation"} else {})


@register
class SetupZero(SetupEffect):
    """The zero of a set-up is not what it was thought to be.

    Formula
        ``value = zero`` on all rows of the set-up.
    Parameters
    ----------
        zero in mm (rad where ``measures = angle``), within ±1 mm (1 mrad).
    Signals
        None.
    Typical causes
        The instrument was zeroed elsewhere than the campaign's author believed, or again in the
        middle; what a campaign calls ``free = ["zero"]``.
    Cure
        Declare the zero free; zero the instrument at a point that another set-up sees too.
    Source
        ISO 230-2 and ISO/TR 16907:2015, 7: only differences within one set-up carry meaning.
    """

    kind = "setup_zero"

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The zero."""
        most = 1e-3 if self.unit == "rad" else 1.0
        return (Parameter("zero", self.unit, (-most, most), f"zero of set-up {self.setup}"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """1 on the set-up's rows."""
        return (Motion(MEASURED, self.rows(conditions).astype(np.float64)[:, None]),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[SetupZero]:
        """Set-ups of displacements and angles whose zero is not free."""
        for name, seen in coverage.setup_details.items():
            plain = seen.kinds <= {"displacement", "rotation"} and len(seen.kinds) == 1
            if plain and not {"zero", "frame"} & set(seen.free):
                yield cls.model_validate(cls.keys_of(coverage, name))


@register
class SetupSlope(SetupEffect):
    """A set-up whose values run off linearly along its path: the reference was not aligned.

    Formula
        ``value = slope·s`` on the rows of the set-up; s the place along the set-up's path, −1 at
        one end, 1 at the other, counted along the line that fits the axis positions best.
    Parameters
    ----------
        slope in mm (rad where ``measures = angle``) at the path's end, within ±1 mm (1 mrad):
        laser or straightedge that are aligned by eye are off by 0.1 mm in 1 m.
    Signals
        None beyond the positions.
    Typical causes
        A straightedge, wire or beam that is not parallel to the motion; what a campaign calls
        ``free = ["zero", "slope"]``. A true squareness looks the same in one set-up alone.
    Cure
        Declare the slope free; align; measure with the reference reversed.
    Source
        ISO 230-1:2012 (straightness: slope of the reference taken out).
    """

    kind = "setup_slope"

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The value at the path's end."""
        most = 1e-3 if self.unit == "rad" else 1.0
        return (Parameter("slope", self.unit, (-most, most), f"slope of set-up {self.setup}"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """The place along the path on the set-up's rows."""
        rows = np.flatnonzero(self.rows(conditions))
        column = np.zeros((conditions.n, 1))
        if rows.size:
            positions = np.stack([q[rows] for q in conditions.positions.values()], axis=1)
            column[rows, 0] = path_coordinate(positions)
        return (Motion(MEASURED, column),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[SetupSlope]:
        """Set-ups that measure across their path and whose slope is not free."""
        for name, seen in coverage.setup_details.items():
            across = seen.kinds == {"displacement"} and seen.across > 10.0 * seen.along
            if across and not {"slope", "frame"} & set(seen.free):
                yield cls.model_validate(cls.keys_of(coverage, name))


@register
class SetupFrame(SetupEffect):
    """A whole set-up lies a little elsewhere than it was thought to: artefact, plate, tracker.

    Formula
        ``value = u·(t + ω × (p − p̄))`` for displacements along u, ``u·ω`` for angles; p the
        functional point, p̄ the middle of the set-up's points, all in the workpiece's frame: what is
        clamped to a rotary table turns with it.
    Parameters
    ----------
        x, y, z in mm, within ±1 mm; a, b, c in rad, within ±1 mrad.
    Signals
        None beyond the positions.
    Typical causes
        An artefact or plate that is set down on the table: what a campaign calls
        ``free = ["frame"]``.
    Cure
        Declare the frame free; align the artefact by more than the fewest points.
    Source
        ISO/TR 16907:2015, 7 (indirect methods with artefacts).
    """

    kind = "setup_frame"

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """Three translations and three rotations."""
        text = f"of set-up {self.setup}"
        moves = [Parameter(k, "mm", (-1.0, 1.0), f"place {k} {text}") for k in "xyz"]
        turns = [Parameter(k, "rad", (-1e-3, 1e-3), f"turn {k} {text}") for k in "abc"]
        return (*moves, *turns)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """Six columns on the set-up's rows.

        Raises
        ------
        InputError
            For distances: their frame is the base points', which are fitted.
        """
        rows = np.flatnonzero(self.rows(conditions))
        columns = np.zeros((conditions.n, 6))
        if rows.size:
            kind, u = conditions.kind, conditions.u
            if u is None or (kind is not None and (kind[rows] >= Kind.DISTANCE).any()):
                raise InputError(
                    f"set-up {self.setup} measures distances, whose frame is that of their bases",
                    field="setup",
                    found=self.setup,
                )
            chain = Chain(machine, conditions.rows(rows))
            seen = chain.to_workpiece(u[rows])
            turning = np.zeros_like(seen) if self.measures == "length" else seen
            columns[rows] = frame_columns(chain.point, seen - turning, turning)
        return (Motion(MEASURED, columns),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[SetupFrame]:
        """Set-ups that see an artefact's place in two directions or more, and whose frame is known.

        A line along one direction sees of its frame no more than its zero and its slope.
        """
        for name, seen in coverage.setup_details.items():
            artefact = seen.kinds == {"displacement"} and seen.spread > 1 and seen.rows > 6
            if artefact and "frame" not in seen.free:
                yield cls.model_validate(cls.keys_of(coverage, name))


@register
class SetupScale(SetupEffect):
    """A workpiece or an artefact of another temperature than stated: all its lengths scale.

    Nobody measured how warm it was. Its own expansion is then one number for all directions, and
    is distinguished from the machine's scales by other set-ups, or by being alike in all axes.

    Formula
        ``value = −s·u·(p − p̄)`` for displacements along u; p the functional point in the
        workpiece's frame, p̄ the middle of the set-up's points: the warm part is too large, as for
        `workpiece_expansion`.
    Parameters
    ----------
        s = α·(T − T_stated), without a unit; within ±300 ppm: aluminium 10 K too warm has 230 ppm,
        steel 115.
    Signals
        None; where a thermometer sits on the part, `workpiece_expansion` says more.
    Typical causes
        A part drilled warm and measured cold, an artefact from another room, a stated temperature
        or coefficient of expansion that is wrong, a laser's material sensor that lay elsewhere.
    Cure
        Soak; a thermometer on the part.
    Source
        ISO 1:2022; ISO/TR 16015 (length measurements away from 20 °C).
    """

    kind = "setup_scale"

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The expansion."""
        text = f"expansion of what set-up {self.setup} measures"
        return (Parameter("s", "1", (-3e-4, 3e-4), text),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``−u·(p − p̄)`` on the set-up's rows."""
        rows = np.flatnonzero(self.rows(conditions))
        column = np.zeros((conditions.n, 1))
        if rows.size and conditions.u is not None:
            chain = Chain(machine, conditions.rows(rows))
            toward = chain.to_workpiece(conditions.u[rows])
            arm = chain.point - chain.point.mean(axis=0)
            column[rows, 0] = -np.einsum("ni,ni->n", arm, toward)
        return (Motion(MEASURED, column),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[SetupScale]:
        """Set-ups that saw displacements in two directions or more, or along their own path.

        Not the only one of an arm, of which all lengths together may as well be its own.
        """
        if len(coverage.setup_details) == 1 and not machine.structure.linear:
            return
        for name, seen in coverage.setup_details.items():
            line = seen.along > max(_LENGTH, seen.across) and "slope" not in seen.free
            if seen.kinds == {"displacement"} and seen.rows > 3 and (seen.spread > 1 or line):
                yield cls(setup=name)
