"""Tolerances of the command line: ``A=8um``, ``X.R=4um``, ``body.E=15um``, ``bar.range=9um``."""

from __future__ import annotations

import re
from collections.abc import Sequence

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.units import FACTORS
from abbe.compcore.verification.budget import FIGURES
from abbe.compcore.verification.line_test import BODY, FACE
from abbe.compcore.verification.tolerance import RANGE, Tolerance

_GIVEN = re.compile(
    r"(?:(?P<of>[\w+. -]{1,80})\.)?(?P<figure>[A-Z]|range)=(?P<size>[0-9.]{1,12})\s*"
    r"(?P<unit>[A-Za-zµ/]{0,10})"
)
_DIAGONAL = re.compile(r"(?:[+-][XYZ]){2,3}")
_MOST = {"mm": 10.0, "rad": 0.1}
"""What nobody states as a tolerance."""


def tolerances_of(given: Sequence[str], machine: Machine) -> tuple[Tolerance, ...]:
    """Stated tolerances of a machine's lines, mm or rad.

    Raises
    ------
    InputError
        For what cannot be read, a figure, axis or unit that there is not, a tolerance stated twice.
    """
    found: dict[tuple[str, bool], Tolerance] = {}
    for text in given:
        one = _tolerance(text, machine)
        if (str(one), one.angle) in found:
            raise InputError("a tolerance is stated twice", field="tolerance", found=text)
        found[str(one), one.angle] = one
    return tuple(found.values())


def _tolerance(text: str, machine: Machine) -> Tolerance:
    def wrong(problem: str, expected: str) -> InputError:
        return InputError(problem, field="tolerance", found=text, expected=expected)

    read = _GIVEN.fullmatch(text.strip())
    if read is None:
        raise wrong("not a tolerance", "A=8um, X.R=4um, body.E=15um, C.A=20urad, range=9um")
    figure, of = read["figure"], read["of"] or ""
    if figure not in (*FIGURES, RANGE):
        raise wrong("no such figure", "one of " + ", ".join((*FIGURES, RANGE)))
    axes = machine.structure.axes
    if figure != RANGE and of and of not in (*axes, BODY, FACE) and not _DIAGONAL.fullmatch(of):
        raise wrong("no such line", ", ".join((*axes, BODY, FACE, "+X+Y+Z")))
    kind, factor = FACTORS.get(read["unit"], ("", 0.0))
    if kind not in _MOST:
        raise wrong("a tolerance needs its unit", "um, mm, urad, arcsec, deg")
    angle = kind == "rad"
    if figure != RANGE and of and angle != (of in machine.structure.rotary):
        raise wrong("not the unit of this line", "urad or arcsec for rotary axes, um for others")
    try:
        limit = float(read["size"]) * factor
    except ValueError:
        raise wrong("not a number", "such as A=8um") from None
    if not 0.0 < limit <= _MOST[kind]:
        raise wrong("not believable", f"more than 0, at most {_MOST[kind]:g} {kind}")
    return Tolerance(figure, of, limit, angle)
