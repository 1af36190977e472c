"""The answer of ``abbe correct`` for one point: as JSON (formats.md) and as text."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.inverse import invert_model
from abbe.compcore.model.model import Model
from abbe.compcore.model.pose import command_of
from abbe.compcore.model.uncertainty import (
    COVERAGE,
    UNKNOWN,
    PredictionUncertainty,
    expanded,
    uncertainty,
)
from abbe.compcore.units import in_digits
from abbe.daemon.answers.outside import outside_json
from abbe.daemon.arguments.effect_name import short

F64 = NDArray[np.float64]
Triple = tuple[float, float, float]

NO_LINEAR_AXIS = "no linear axis moves that: --command says where to send the rotary axes instead"
_UNSEEN = 5e-9
"""mm: what is less reads 0.00 µm or is rounding."""


@dataclass(frozen=True)
class PoseLeft:
    """What of the tool's pose a command does not bring back.

    Attributes
    ----------
    direction, spin
        Angle between the tool and where it should point, and its turn about itself, rad.
    place
        Distance of the functional point from where it should be, mm.
    damped, limited
        Whether a rotary axis stands near a pole, or would have to turn farther than it may.
    """

    direction: float
    spin: float
    place: float
    damped: bool
    limited: bool


@dataclass(frozen=True, eq=False)
class Corrected:
    """One point, corrected.

    Attributes
    ----------
    asked, answer
        Axis → position, mm (rotary: degrees): the indicated position and where the functional
        point really is; with `command` the target and what to command to reach it.
    command
        Which of the two questions was answered.
    orientation
        Shape (3, 3): columns are the directions of X, Y, Z at the tool.
    parts
        Effect → its part of the error at the indicated (commanded) position, moves of X, Y, Z, mm;
        they sum to the error but for `second_order`.
    second_order
        What full rotations add to the sum of the parts, mm.
    contraction, iterations
        Of the iteration that found the command.
    carrying
        Those of X, Y, Z that the machine has.
    beside
        Of the error, what no linear axis moves (Y of a lathe): direction → mm; empty where X, Y
        and Z are there, and for a command that has `left`.
    left
        Of a command on a machine with rotary axes: what of the tool's place and orientation it
        leaves.
    sure
        How sure the model is there; None where nobody knows.
    """

    asked: Mapping[str, float]
    answer: Mapping[str, float]
    command: bool
    orientation: F64
    parts: Mapping[str, Triple]
    second_order: Triple
    contraction: float = 0.0
    iterations: int = 0
    carrying: tuple[str, ...] = ("X", "Y", "Z")
    beside: Mapping[str, float] = field(default_factory=dict)
    left: PoseLeft | None = None
    sure: PredictionUncertainty | None = None

    @property
    def staying(self) -> dict[str, float]:
        """`beside` without the directions in which the model has no error, nor any doubt: a slit's.

        For people, who look for an axis wherever its letter stands.
        """
        wide = {} if self.sure is None else expanded(self.sure)
        return {
            a: e for a, e in self.beside.items() if abs(e) > _UNSEEN or wide.get(a, 0.0) > _UNSEEN
        }

    def correction(self, axis: str) -> float:
        """The answer minus what was asked, mm (rotary: degrees)."""
        return self.answer[axis] - self.asked[axis]


def correct_point(
    model: Model, at: Conditions, *, command: bool, held: Collection[str] = ()
) -> Corrected:
    """Answer for one row of conditions; rotary axes in `held` are not moved by a command.

    Raises
    ------
    InputError
        When no axis of the machine can carry a correction that a command needs.
    NotContractionError
        When a command cannot be found.
    """
    contraction, iterations = 0.0, 0
    place, left = at, None
    if command and model.machine.structure.rotary:
        posed = command_of(model, at, held=held)
        place, iterations = posed.conditions, posed.rounds
        contraction = float(posed.contraction[0])
        left = PoseLeft(
            float(posed.direction_left[0]),
            float(posed.spin_left[0]),
            float(posed.place_left[0]),
            bool(posed.damped[0]),
            bool(posed.limited[0]),
        )
    elif command:
        place, solved = invert_model(model, at)
        contraction, iterations = float(solved.contraction[0]), solved.iterations
    chain = Chain(model.machine, place)
    error = chain.along_axes(model.predict(place).translation)[0]
    carrying = model.machine.structure.carrying
    beside = {a: float(e) for a, e in zip("XYZ", error, strict=True) if a not in carrying}
    asked = {a: _shown(a, float(q[0])) for a, q in at.positions.items()}
    if command:
        answer = {a: _shown(a, float(q[0])) for a, q in place.positions.items()}
    else:
        found = dict(zip("XYZ", error.tolist(), strict=True))
        answer = {a: q + found.get(a, 0.0) for a, q in asked.items()}
    parts = {
        spec: _triple_of(chain.along_axes(part)[0])
        for spec, part in model.contributions(place).items()
    }
    summed = np.sum([*parts.values(), (0.0, 0.0, 0.0)], axis=0)
    return Corrected(
        asked,
        answer,
        command,
        model.predict(place).orientation[0],
        parts,
        _triple_of(error - summed),
        contraction,
        iterations,
        carrying,
        beside if left is None else {},
        left,
        uncertainty(model, place),
    )


def as_json(found: Corrected, warnings: list[str], *, explain: bool) -> dict[str, Any]:
    """One object for ``--json``; positions in mm, rotary axes in degrees."""
    reported: dict[str, Any] = {
        "indicated": dict(found.asked),
        "corrected": dict(found.answer),
        "correction": {a: found.correction(a) for a in found.carrying},
        "unit": "mm",
        "orientation": found.orientation.tolist(),
        "answers": "command" if found.command else "reading",
    }
    if found.beside:
        reported["left"] = dict(found.beside)
    if found.command:
        reported["contraction"] = found.contraction
        reported["iterations"] = found.iterations
    reported["uncertainty"] = None
    if found.sure is not None:
        wide = {a: v * 1e3 for a, v in expanded(found.sure).items()}
        reported["uncertainty"] = {
            **wide,
            "unit": "um",
            "k": COVERAGE,
            "beyond": outside_json(found.sure.beyond),
        }
    if found.left is not None:
        rotary = {a: found.correction(a) for a in found.asked if is_rotary(a)}
        reported["rotary_correction"] = {a: round(v, 12) for a, v in rotary.items()}
        reported["rotary_unit"] = "deg"
        reported["orientation_left"] = {
            **({} if len(found.carrying) == 3 else {"place": found.left.place}),
            "direction": found.left.direction * 1e6,
            "spin": found.left.spin * 1e6,
            "unit": "urad",
            "near_pole": found.left.damped,
            "limited": found.left.limited,
        }
    if explain:
        reported["effects"] = [
            {"effect": spec, **dict(zip("XYZ", part, strict=True))}
            for spec, part in found.parts.items()
        ]
        reported["second_order"] = dict(zip("XYZ", found.second_order, strict=True))
    if warnings:
        reported["warnings"] = warnings
    return reported


def as_text(found: Corrected, *, explain: bool) -> Iterator[str]:
    """Lines for people: mm and µm."""
    heads = ("target", "command") if found.command else ("indicated", "corrected")
    yield f"     {heads[0]:>14}   {heads[1]:>14}     correction"
    for axis, asked in found.asked.items():
        if is_rotary(axis):
            turn_left = ""
            if found.left is not None:
                turned = math.radians(found.correction(axis)) * 1e6
                turn_left = f"  {round(turned, 2) + 0.0:>9.2f} µrad"
            yield f"{axis:<4} {asked:>13.4f}°   {found.answer[axis]:>13.4f}°{turn_left}"
        else:
            wide = "" if found.sure is None else _plus_minus(found.sure, axis)
            yield (
                f"{axis:<4} {asked:>11.4f} mm   {found.answer[axis]:>11.4f} mm  "
                f"{round(found.correction(axis) * 1e3, 2) + 0.0:>9.2f} µm{wide}"
            )
    for direction, error in found.staying.items():
        wide = "" if found.sure is None else _plus_minus(found.sure, direction)
        amount = f"{round(error * 1e3, 2) + 0.0:.2f} µm{wide}"
        yield f"along {direction} the machine has no axis: an error of {amount} stays"
    if not found.carrying and not found.command:
        yield NO_LINEAR_AXIS
    turn = found.orientation
    angles = (turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
    a, b, c = (f"{round(0.5e6 * angle, 1) + 0.0:.1f}" for angle in angles)
    if found.left is None:
        yield f"the tool is turned by A {a}, B {b}, C {c} µrad"
    else:
        yield from _pose_left(found.left, short_of_axes=len(found.carrying) < len("XYZ"))
    if found.command:
        yield (
            f"found in {found.iterations} rounds; each shrinks what is left to "
            f"{in_digits(found.contraction, 2)} of it"
        )
    yield UNKNOWN if found.sure is None else f"± with k = {COVERAGE:g}"
    if explain:
        yield ""
        yield from _explained(found)


def _plus_minus(sure: PredictionUncertainty, axis: str) -> str:
    wide = expanded(sure).get(axis)
    return "" if wide is None else f" ± {wide * 1e3:.2f}"


def _pose_left(left: PoseLeft, *, short_of_axes: bool) -> Iterator[str]:
    if short_of_axes:
        yield f"the tool then stands {left.place * 1e3:.2f} µm from where it should"
    yield (
        f"the tool then points {left.direction * 1e6:.2f} µrad beside where it should, and is "
        f"turned about itself by {left.spin * 1e6:.2f} µrad"
    )
    if left.damped and short_of_axes:
        yield (
            "near a singular position: no axis moves the tool well in the direction that is left, "
            "and none is made to turn far for little"
        )
    elif left.damped:
        yield (
            "near a pole: the axis that would turn the tool stands almost along it, and is not "
            "made to turn far for little"
        )
    if left.limited:
        yield "a rotary axis would have to turn farther than it may; it stops there"


def _explained(found: Corrected) -> Iterator[str]:
    if found.command:
        yield "where the machine errs at the commanded position, µm (the command is opposite):"
    else:
        yield "what the correction is made of, µm:"
    parts = {short(s): p for s, p in found.parts.items() if any(abs(v) > 5e-10 for v in p)}
    width = max((len(s) for s in [*parts, "second order"]), default=0)
    yield f"{'':<{width}} {'X':>9} {'Y':>9} {'Z':>9}"
    for spec, part in parts.items():
        yield f"{spec:<{width}} " + " ".join(_um(v) for v in part)
    if any(abs(v) > 5e-10 for v in found.second_order):
        yield f"{'second order':<{width}} " + " ".join(_um(v) for v in found.second_order)
    total = np.sum([*found.parts.values(), found.second_order], axis=0)
    yield f"{'sum':<{width}} " + " ".join(_um(float(v)) for v in total)
    silent = len(found.parts) - len(parts)
    if silent:
        yield f"({silent} effects contribute nothing here)"


def _um(millimetres: float) -> str:
    return f"{round(millimetres * 1e3, 3) + 0.0:9.3f}"


def _shown(axis: str, position: float) -> float:
    return math.degrees(position) if is_rotary(axis) else position


def _triple_of(vector: F64) -> Triple:
    x, y, z = vector.tolist()
    return x, y, z
