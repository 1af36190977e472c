"""What is typed of a plan: times, tools, keep-out boxes, effects that are to be told apart."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from abbe.compcore.errors import InputError
from abbe.compcore.machine.plausible import POINT, Range
from abbe.daemon.arguments.assignments import number, split_assignments, tool_offset

if TYPE_CHECKING:
    from abbe.compcore.model.model import Model
    from abbe.compcore.planning.envelope import KeepOut

_TIME = re.compile(r"([0-9.]{1,10})\s*(h|min)")
_LONGEST = Range(1.0, 60000.0, "min")
_USUAL_TOOL = (0.0, 0.0, -100.0)


def seconds_of(text: str, field: str = "time") -> float:
    """``4h`` or ``90min`` → s.

    Parameters
    ----------
    field
        What it is called where it is wrong.

    Raises
    ------
    InputError
        For anything else, and times that no plan takes.
    """
    found = _TIME.fullmatch(text.strip())
    if found is None:
        raise InputError("not a time", field=field, found=text, expected="such as 4h or 90min")
    minutes = number(field, found[1], "h or min") * (60.0 if found[2] == "h" else 1.0)
    if not _LONGEST.holds(minutes):
        raise InputError("not a time", field=field, found=text, expected="1min to 1000h")
    return 60.0 * minutes


def tools_of(given: Sequence[str]) -> dict[str, tuple[float, float, float]]:
    """``NAME=x,y,z`` → name → offset, mm; one of 100 mm downwards where none is given.

    Raises
    ------
    InputError
        For what is no offset.
    """
    found = {k: tool_offset(f"tool {k}", v) for k, v in split_assignments(given).items()}
    for name in found:
        if not re.fullmatch(r"[A-Za-z0-9_-]{1,40}", name):
            raise InputError("not a name", field="tool", found=name, expected="letters and digits")
    return found or {"T1": _USUAL_TOOL}


def place_of(key: str, text: str) -> tuple[float, float, float]:
    """``x,y,z`` → where X, Y, Z stand, mm.

    Raises
    ------
    InputError
        For what are not three numbers.
    """
    parts = text.split(",")
    if len(parts) != 3:
        raise InputError("not a place", field=key, found=text, expected="x,y,z, mm")
    x, y, z = (number(key, part, "mm", POINT) for part in parts)
    return x, y, z


def keep_out_of(given: Sequence[str]) -> tuple[KeepOut, ...]:
    """``x,y,z:x,y,z`` → boxes between two corners, mm.

    Raises
    ------
    InputError
        For what is no box.
    """
    from abbe.compcore.planning.envelope import KeepOut

    found = []
    for text in given:
        ends = [part.split(",") for part in text.split(":")]
        if [len(e) for e in ends] != [3, 3]:
            raise InputError(
                "not a box", field="keep-out", found=text, expected="x,y,z:x,y,z, two corners, mm"
            )
        one, two = ([number("keep-out", v, "mm", POINT) for v in e] for e in ends)
        low, high = map(min, one, two), map(max, one, two)
        (a, b, c), (d, e, f) = low, high
        found.append(KeepOut((a, b, c), (d, e, f)))
    return tuple(found)


def with_effects(model: Model, specs: Sequence[str]) -> tuple[Model, tuple[int, ...]]:
    """A model with some effects, added where it lacks them, and where they stand in it.

    Raises
    ------
    InputError
        For what is no effect of this machine.
    """
    from abbe.compcore.model.revise import with_effect

    places = []
    for spec in specs:
        kind, *keys = spec.split() or [spec]
        alike = [
            i for i, e in enumerate(model.effects) if e.spec.startswith(" ".join([kind, *keys]))
        ]
        if len(alike) != 1:
            model, effect = with_effect(model, kind, split_assignments(keys))
            alike = [i for i, e in enumerate(model.effects) if e == effect]
        places.append(alike[0])
    return model, tuple(places)
