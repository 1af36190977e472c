"""The dialects that there are, by name."""

from __future__ import annotations

from abbe.compcore.errors import InputError
from abbe.drivers.programs.dialect import Dialect
from abbe.drivers.programs.gcode import FanucProgram, LinuxCnc, Siemens
from abbe.drivers.programs.heidenhain import Klartext
from abbe.drivers.programs.ipp import IppCommands


def dialect_called(name: str) -> Dialect:
    """The dialect of a name.

    Raises
    ------
    InputError
        When there is none; lists those that there are.
    """
    known: dict[str, Dialect] = {
        d.name: d for d in (LinuxCnc(), FanucProgram(), Siemens(), Klartext(), IppCommands())
    }
    if name not in known:
        raise InputError(
            "no such controller",
            field="controller",
            found=name,
            expected="one of " + ", ".join(known),
        )
    return known[name]
