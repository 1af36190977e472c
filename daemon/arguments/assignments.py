"""KEY=VALUE arguments of the command line."""

from __future__ import annotations

from collections.abc import Iterable

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.numbers import checked_number
from abbe.compcore.machine.plausible import TOOL, Range


def split_assignments(arguments: Iterable[str]) -> dict[str, str]:
    """``["X=1", "tool=0,0,-50"]`` → ``{"X": "1", "tool": "0,0,-50"}``.

    Raises
    ------
    InputError
        For an argument without ``=``, an empty key, or a key given twice.
    """
    found: dict[str, str] = {}
    for argument in arguments:
        key, equals, value = argument.partition("=")
        if not equals or not key:
            raise InputError("cannot read an argument", found=argument, expected="KEY=VALUE")
        if key in found:
            raise InputError(f"{key} is given twice", found=argument)
        found[key] = value
    return found


def number(key: str, text: str, unit: str, allowed: Range | None = None) -> float:
    """A finite number of the command line, within what is believable where that is given.

    Raises
    ------
    InputError
        Naming the key, what was found and the unit expected.
    """
    return checked_number(text, field=key, expected=f"a number in {unit}", allowed=allowed)


def tool_offset(key: str, text: str) -> tuple[float, float, float]:
    """A tool's offset, mm: three comma-separated numbers; raises as `number`."""
    parts = text.split(",")
    if len(parts) != 3:
        raise InputError("not three numbers", field=key, found=text, expected="x,y,z in mm")
    x, y, z = (number(key, part, "mm", TOOL) for part in parts)
    return x, y, z
