"""Heidenhain Klartext: straight lines in machine coordinates (``M91``), cycle 9 for standing still.

With M91 a block counts from the machine's datum, and the tool's length does not count in it. Never
run by a control; the words were compared with public manuals (docs/sources.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

from abbe.compcore.machine.machine import Machine
from abbe.compcore.planning.motion import ProgramStep
from abbe.drivers.programs.dialect import (
    MADE_BY,
    Dialect,
    feed_of,
    no_lathe,
    no_touching,
    plain,
    require_letters,
    shown,
    touches,
)


class Klartext(Dialect):
    """Heidenhain TNC and iTNC, TNC7."""

    name: ClassVar[str] = "heidenhain"
    title: ClassVar[str] = "Heidenhain TNC"

    def text(self, steps: Sequence[ProgramStep], machine: Machine, title: str, feed: float) -> str:
        """The program; mm, degrees, mm/min.

        Raises
        ------
        InputError
            For a lathe, where X may be a diameter; for axes of more than a letter.
        """
        require_letters(self.title, machine)
        if machine.structure.shows_diameters:
            raise no_lathe(self.title, machine)
        if touches(steps):
            raise no_touching(self.title)
        lines = ["BEGIN PGM ABBE MM", *self._lines(steps, title, feed), "END PGM ABBE MM"]
        return "\n".join(f"{i} {line}" for i, line in enumerate(lines)) + "\n"

    def _lines(self, steps: Sequence[ProgramStep], title: str, feed: float) -> Iterator[str]:
        yield f"; {plain(title)}, {MADE_BY}"
        for step in steps:
            if step.kind == "note":
                yield f"; {plain(step.text)}"
            elif step.kind in ("stop", "there"):
                yield f"; {plain(step.text)}"
                yield "STOP"
            elif step.kind == "move":
                words = " ".join(f"{a}{v:+.4f}" for a, v in shown(step.at).items())
                yield f"L {words} R0 F{feed_of(step, feed):.0f} M91"
                if step.seconds:
                    yield from self._dwell(step.seconds)
            else:
                yield f"; target {step.number}"
                yield from self._dwell(step.seconds)

    def _dwell(self, seconds: float) -> tuple[str, str]:
        return "CYCL DEF 9.0 DWELL TIME", f"CYCL DEF 9.1 DWELL {seconds:.3f}"
