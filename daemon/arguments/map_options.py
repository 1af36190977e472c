"""The options of ``abbe import-map`` and ``abbe identify-convention`` → convention, squareness."""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

from abbe.compcore.errors import InputError
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.convention import (
    Convention,
    OwnTravel,
    SquarenessForm,
    parse_rotation_point,
    parse_signs,
)
from abbe.compcore.maps.squareness import Form, square_pairs
from abbe.compcore.maps.table import CompensationMap
from abbe.compcore.maps.to_model import map_machine
from abbe.compcore.units import to_internal
from abbe.daemon.arguments.assignments import number, split_assignments

_FORMS: dict[str, SquarenessForm] = {
    "as-written": "as written",
    "angle": "angle",
    "gradient": "gradient",
}
_STATED: dict[str, Form] = {"angle": "angle", "gradient": "gradient"}


def convention_of(
    compensation: CompensationMap,
    structure: Structure,
    *,
    signs: Iterable[str],
    rotation_point: str,
    own_travel: str,
    map_squareness: str,
    squareness_as: str | None,
    stated: bool,
) -> Convention:
    """A convention from a command line; `stated`: whether squareness stands beside the map.

    Raises
    ------
    InputError
        Naming the option, what was found and what was expected.
    """
    axes = structure.linear
    own: OwnTravel | None = next((o for o in get_args(OwnTravel) if o == own_travel), None)
    if own is None:
        raise InputError(
            "unknown word",
            field="own-travel",
            found=own_travel,
            expected="one of " + ", ".join(get_args(OwnTravel)),
        )
    for option, text, words in (
        ("map-squareness", map_squareness, [*_FORMS]),
        ("squareness-as", squareness_as, [*_STATED]),
    ):
        if text is not None and text not in words:
            raise InputError(
                "unknown word", field=option, found=text, expected="one of " + ", ".join(words)
            )
    if squareness_as is not None and not stated:
        raise InputError(
            "no squareness is stated that it could belong to",
            field="squareness-as",
            found=squareness_as,
            expected="--squareness YX=… beside it; what the map's columns hold is moved by "
            "--map-squareness",
        )
    ranges = {a: t.range for a, t in compensation.tables.items() if a in axes}
    point = parse_rotation_point(rotation_point, ranges)
    return Convention(
        parse_signs(signs, axes),
        {a: p for a, p in point.items() if p != 0.0},
        own,
        _FORMS[map_squareness],
        _STATED[squareness_as or "angle"],
    )


def squareness_of(
    texts: Iterable[str], compensation: CompensationMap, structure: Structure
) -> dict[tuple[str, str], float]:
    """``YX=0.05mm/m`` → the pair in the structure's order and the angle in Abbe's sign, rad.

    Given the other way round, ``XY``, the angle is that by which Y is turned against X.

    Raises
    ------
    InputError
        For a pair that is not square on this machine, a number without unit, a unit of no angle.
    """
    pairs = square_pairs(map_machine(compensation, structure))
    found: dict[tuple[str, str], float] = {}
    for key, text in split_assignments(texts).items():
        names = next(
            ((a, b) for a, b in (*pairs, *((b, a) for a, b in pairs)) if f"{a}{b}" == key), None
        )
        if names is None:
            raise InputError(
                "not a pair of axes",
                field="squareness",
                found=key,
                expected="one of " + ", ".join(f"{a}{b}" for a, b in pairs),
            )
        digits = text.rstrip("abcdefghijklmnopqrstuvwxyzµ/")
        unit = text[len(digits) :]
        if not unit:
            raise InputError(
                "squareness without a unit",
                field="squareness",
                found=f"{key}={text}",
                expected=f"a number with its unit, such as {key}=0.05mm/m, 50urad, 10arcsec",
            )
        angle = to_internal(number(key, digits, "an angle"), unit, "rad")
        pair, turn = (names, angle) if names in pairs else (names[::-1], -angle)
        if pair in found:
            raise InputError("the same pair twice", field="squareness", found=key)
        found[pair] = turn
    return found
