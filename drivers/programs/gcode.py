"""G-code: LinuxCNC, Fanuc, Siemens. All moves in machine coordinates, all at feed.

LinuxCNC's (``G53 G1``) are run by its own interpreter in the tests. Those for Siemens (``SUPA``
suppresses all frames in its block, ``D0`` the tool's length) and Fanuc (``G53`` is rapid only
there, so moves are in ``G54`` and the program ends with an alarm where that is not zero: variables
#5201 …, #5221 …) were never run by a control; their words were compared with public manuals
(docs/sources.md).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

from abbe.compcore.machine.machine import Machine
from abbe.compcore.planning.motion import ProgramStep
from abbe.drivers.programs.dialect import (
    LOG,
    MADE_BY,
    Dialect,
    feed_of,
    no_lathe,
    plain,
    require_letters,
    shown,
    touches,
)

TOUCH_FEED = 60.0
"""While touching, mm/min."""
_TOUCHED = {"X": "#5061", "Y": "#5062", "Z": "#5063"}
"""Where LinuxCNC has a touch, in the program's coordinates."""
_SKIPPED = _TOUCHED
"""Where a Fanuc control whose first three axes are X, Y, Z has it."""
_SIEMENS_LOG = "/_N_MPF_DIR/_N_PROBED_MPF"


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
            it; for axes of more than a letter where the language has no ``=``.
        """
        if not self.between:
            require_letters(self.title, machine)
        if machine.structure.shows_diameters and not self.radius:
            raise no_lathe(self.title, machine)
        return "\n".join(self._lines(steps, machine, title, feed)) + "\n"

    def _lines(
        self, steps: Sequence[ProgramStep], machine: Machine, title: str, feed: float
    ) -> Iterator[str]:
        if touches(steps):
            yield from self._declared()
        yield from self._head(machine, title)
        if touches(steps):
            yield from self._open(machine)
        for step in steps:
            if step.kind == "note":
                yield self._note(step.text)
            elif step.kind in ("stop", "there"):
                yield self._note(step.text)
                yield "M0"
            elif step.kind == "move" and step.guarded:
                yield from self._guarded(step, feed)
            elif step.kind == "move":
                yield f"{self.move} {self._words(step.at)} F{self._feed(feed_of(step, feed))}"
                if step.seconds:
                    yield self._dwell(step.seconds)
            elif step.kind == "touch":
                yield from self._touch(step, machine)
            else:
                yield self._note(f"target {step.number}")
                yield self._dwell(step.seconds)
        if touches(steps):
            yield from self._close()
        yield from self._foot()

    def _declared(self) -> Iterator[str]:
        """What has to come before everything else of a program that touches."""
        yield from ()

    @abstractmethod
    def _guarded(self, step: ProgramStep, feed: float) -> Iterator[str]:
        """A move on which the probe must not touch anything."""

    @abstractmethod
    def _touch(self, step: ProgramStep, machine: Machine) -> Iterator[str]:
        """A touch, and its line in the file of touches."""

    @abstractmethod
    def _open(self, machine: Machine) -> Iterator[str]:
        """The file of touches begun: axes in the structure's order."""

    @abstractmethod
    def _close(self) -> Iterator[str]:
        """The file of touches ended."""

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

    def _guarded(self, step: ProgramStep, feed: float) -> Iterator[str]:
        # a contact on a move that is no G38 ends the program: LinuxCNC does that by itself
        yield f"{self.move} {self._words(step.at)} F{self._feed(feed)}"

    def _touch(self, step: ProgramStep, machine: Machine) -> Iterator[str]:
        # without contact G38.2 ends the program
        yield f"G38.2 {self._words(step.at)} F{TOUCH_FEED:g}"
        cells = [_TOUCHED.get(a, f"{v:.4f}") for a, v in shown(step.stands).items()]
        yield f"(LOG,{','.join(cells)})"

    def _open(self, machine: Machine) -> Iterator[str]:
        # G38.2 counts as the program does: with any offset it would go elsewhere
        yield "G54"
        checked = [*range(5211, 5220), *range(5221, 5231)]
        total = "+".join(f"ABS[#{n}]" for n in checked)
        yield f"o100 if [{total} GT 0]"
        yield "(ABORT,the offsets G54 and G92 have to be zero)"
        yield "o100 endif"
        yield f"(LOGOPEN,{LOG})"
        yield f"(LOG,{','.join(machine.structure.axes)})"

    def _close(self) -> Iterator[str]:
        yield "(LOGCLOSE)"


class FanucProgram(_GCode):
    """Fanuc 0i, 30i and those that read like them."""

    name: ClassVar[str] = "fanuc"
    title: ClassVar[str] = "Fanuc"
    end: ClassVar[str] = "M30"

    def _guarded(self, step: ProgramStep, feed: float) -> Iterator[str]:
        yield f"G31 {self._words(step.at)} F{self._feed(feed)}"
        yield f"IF [[{self._short(step)}] GT 0.05] THEN #3000=3 (PROBE TOUCHED ON ITS WAY)"

    def _touch(self, step: ProgramStep, machine: Machine) -> Iterator[str]:
        yield f"G31 {self._words(step.at)} F{self._feed(TOUCH_FEED)}"
        yield f"IF [[{self._short(step)}] LT 0.01] THEN #3000=2 (NOTHING TOUCHED)"
        cells = []
        for i, (axis, value) in enumerate(shown(step.stands).items()):
            if axis not in _SKIPPED:
                yield f"#{100 + i}={value:.4f}"
            cells.append(f"{axis}{_SKIPPED.get(axis, f'#{100 + i}')}[44]")
        yield f"DPRNT[{'*'.join(cells)}]"

    def _short(self, step: ProgramStep) -> str:
        """How far X, Y, Z together stopped before the end."""
        return "+".join(f"ABS[{_SKIPPED[a]}-[{v:.4f}]]" for a, v in shown(step.at).items())

    def _open(self, machine: Machine) -> Iterator[str]:
        yield "POPEN"

    def _close(self) -> Iterator[str]:
        yield "PCLOS"

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

    def _declared(self) -> Iterator[str]:
        yield "DEF INT FAULT"
        yield "DEF STRING[200] ROW"

    def _measured(self, step: ProgramStep, feed: float) -> Iterator[str]:
        yield f"MEAS=1 {self.move} {self._words(step.at)} F{self._feed(feed)}"
        yield "STOPRE"

    def _guarded(self, step: ProgramStep, feed: float) -> Iterator[str]:
        yield from self._measured(step, feed)
        yield "IF $AC_MEA[1]==1 GOTOF TOUCHED"

    def _touch(self, step: ProgramStep, machine: Machine) -> Iterator[str]:
        yield from self._measured(step, TOUCH_FEED)
        yield "IF $AC_MEA[1]==0 GOTOF MISSED"
        cells = [
            f"$AA_MM[{a}]" if a in "XYZ" else f'"{v:.4f}"' for a, v in shown(step.stands).items()
        ]
        yield f"""ROW=""<<{'<<","<<'.join(cells)}"""
        yield from self._written()

    def _written(self) -> Iterator[str]:
        yield f'WRITE(FAULT,"{_SIEMENS_LOG}",ROW)'
        yield "IF FAULT<>0 GOTOF NOTWRITTEN"

    def _open(self, machine: Machine) -> Iterator[str]:
        # WRITE goes on after what is there
        yield f'IF ISFILE("{_SIEMENS_LOG}") GOTOF NOTWRITTEN'
        yield f'ROW="{",".join(machine.structure.axes)}"'
        yield from self._written()

    def _close(self) -> Iterator[str]:
        yield self.end
        for label, words in (
            ("MISSED", "nothing touched"),
            ("TOUCHED", "the probe touched on its way"),
            ("NOTWRITTEN", f"{_SIEMENS_LOG} is there already, or cannot be written"),
        ):
            yield f'{label}: MSG("{words}")'
            yield "M0"
            yield self.end

    def _note(self, text: str) -> str:
        return f"; {plain(text)}"

    def _dwell(self, seconds: float) -> str:
        return f"G4 F{seconds:g}"

    def _head(self, machine: Machine, title: str) -> Iterator[str]:
        yield self._note(f"{title}, {MADE_BY}")
        # G71 would leave the feed in inches per minute where the control's own unit is the inch
        yield "G710 G90 G94 G40 G500 D0"
        if machine.structure.rotary:
            # a five-axis transformation that is left on would take X, Y, Z for the tool's tip
            yield "TRAFOOF"
        yield from self._radius(machine)
