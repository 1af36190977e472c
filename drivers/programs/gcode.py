"""G-code: LinuxCNC, Fanuc, Siemens. All moves in machine coordinates, all at feed.

LinuxCNC's (``G53 G1``) are run by its own interpreter in the tests. Those for Siemens (``SUPA``
suppresses all frames in its block, ``D0`` the tool's length) and Fanuc (``G53`` is rapid only
there, so moves are in ``G54`` and the program ends with an alarm where that is not zero: variables
#5201 …, #5221 …) were never run by a control; their words were compared with public manuals
(docs/sources.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

from abbe.compcore.machine.machine import Machine
from abbe.compcore.planning.motion import ProgramStep
from abbe.drivers.programs.dialect import MADE_BY, Dialect, no_lathe, plain, shown


class _GCode(Dialect):
    """What the three have in common."""

    move: ClassVar[str] = "G1"
    between: ClassVar[str] = ""
    end: ClassVar[str] = "M2"
    radius: ClassVar[str] = ""
    """Makes X of a lathe a radius; empty: nothing that is known does in every such control."""

    def text(self, steps: Sequence[ProgramStep], machine: Machine, title: str, feed: float) -> str:
        """The program; mm, degrees, mm/min.

        Raises
        ------
        InputError
            For a lathe, where the control may count X in diameters and nothing is known that ends
            it.
        """
        if machine.structure.shows_diameters and not self.radius:
            raise no_lathe(self.title, machine)
        return "\n".join(self._lines(steps, machine, title, feed)) + "\n"

    def _lines(
        self, steps: Sequence[ProgramStep], machine: Machine, title: str, feed: float
    ) -> Iterator[str]:
        yield from self._head(machine, title)
        for step in steps:
            if step.kind == "note":
                yield self._note(step.text)
            elif step.kind == "stop":
                yield self._note(step.text)
                yield "M0"
            elif step.kind == "move":
                yield f"{self.move} {self._words(step.at)} F{self._feed(feed)}"
                if step.seconds:
                    yield self._dwell(step.seconds)
            else:
                yield self._note(f"target {step.number}")
                yield self._dwell(step.seconds)
        yield from self._foot()

    def _words(self, at: Mapping[str, float]) -> str:
        return " ".join(f"{a}{self.between}{v:.4f}" for a, v in shown(at).items())

    def _feed(self, feed: float) -> str:
        return f"{feed:g}"

    def _note(self, text: str) -> str:
        return f"({plain(text)})"

    def _dwell(self, seconds: float) -> str:
        return f"G4 P{seconds:g}"

    def _head(self, machine: Machine, title: str) -> Iterator[str]:
        yield self._note(f"{title}; {MADE_BY}")
        yield "G21 G90 G94 G40 G49 G80"
        yield from self._radius(machine)

    def _radius(self, machine: Machine) -> Iterator[str]:
        if machine.structure.shows_diameters:
            yield self._note("X is a radius, the travel of the slide")
            yield self.radius

    def _foot(self) -> Iterator[str]:
        yield self.end


class LinuxCnc(_GCode):
    """LinuxCNC (RS274/NGC)."""

    name: ClassVar[str] = "linuxcnc"
    title: ClassVar[str] = "LinuxCNC"
    move: ClassVar[str] = "G53 G1"
    radius: ClassVar[str] = "G8"


class FanucProgram(_GCode):
    """Fanuc 0i, 30i and those that read like them."""

    name: ClassVar[str] = "fanuc"
    title: ClassVar[str] = "Fanuc"
    end: ClassVar[str] = "M30"

    def _feed(self, feed: float) -> str:
        # without a decimal point a control may count least increments (parameter 3401, DPI)
        return f"{feed:.1f}"

    def _note(self, text: str) -> str:
        return f"({plain(text).upper()})"

    def _dwell(self, seconds: float) -> str:
        return f"G4 X{seconds:.3f}"

    def _head(self, machine: Machine, title: str) -> Iterator[str]:
        yield "%"
        yield f"O0001 {self._note(f'{title}; {MADE_BY}')}"
        yield self._note("the offsets EXT and G54 have to be zero")
        for first in (5201, 5221):
            for i in range(len(machine.structure.axes)):
                yield f"IF [#{first + i} NE 0] THEN #3000=1 (OFFSET NOT ZERO)"
        yield "G21 G90 G94 G40 G49 G80 G54"

    def _foot(self) -> Iterator[str]:
        yield self.end
        yield "%"


class Siemens(_GCode):
    """Siemens 840D sl, 828D, ONE."""

    name: ClassVar[str] = "siemens"
    title: ClassVar[str] = "Siemens Sinumerik"
    move: ClassVar[str] = "SUPA G1"
    between: ClassVar[str] = "="
    end: ClassVar[str] = "M30"
    radius: ClassVar[str] = "DIAMOF"

    def _note(self, text: str) -> str:
        return f"; {plain(text)}"

    def _dwell(self, seconds: float) -> str:
        return f"G4 F{seconds:g}"

    def _head(self, machine: Machine, title: str) -> Iterator[str]:
        yield self._note(f"{title}, {MADE_BY}")
        # G71 would leave the feed in inches per minute where the control's own unit is the inch
        yield "G710 G90 G94 G40 G500 D0"
        yield from self._radius(machine)
