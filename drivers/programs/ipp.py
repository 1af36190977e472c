"""I++ DME commands for a measuring machine: one a line, with their tags (I++ DME 1.7, 6)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.planning.motion import ProgramStep
from abbe.drivers.programs.dialect import MADE_BY, Dialect, no_touching, plain, shown, touches


class IppCommands(Dialect):
    """Commands of I++ DME; lines that begin with ``#`` are for people and are not sent."""

    name: ClassVar[str] = "ipp"
    title: ClassVar[str] = "I++ DME"

    def text(self, steps: Sequence[ProgramStep], machine: Machine, title: str, feed: float) -> str:
        """The commands; mm, mm/s.

        Raises
        ------
        InputError
            When the machine has other axes than X, Y, Z.
        """
        if set(machine.structure.axes) - set("XYZ"):
            raise InputError(
                "I++ commands move X, Y and Z only",
                field="controller",
                found=str(machine.structure),
                expected="a machine without other axes, or another controller",
            )
        if touches(steps):
            raise no_touching(self.title)
        commands = 0
        lines = []
        for line in self._lines(steps, title, feed):
            if not line.startswith("#"):
                commands += 1
                lines.append(f"{commands:05d} {line}")
            else:
                lines.append(line)
        return "\r\n".join(lines) + "\r\n"

    def _lines(self, steps: Sequence[ProgramStep], title: str, feed: float) -> Iterator[str]:
        yield f"# {plain(title)}, {MADE_BY}"
        yield "StartSession()"
        # whatever system the last client left
        yield "SetCoordSystem(MachineCsy)"
        yield f"SetProp(Tool.GoToPar.Speed({feed / 60.0:.3f}))"
        for step in steps:
            if step.kind == "note":
                yield f"# {plain(step.text)}"
            elif step.kind in ("stop", "there"):
                yield f"# stop: {plain(step.text)}"
            elif step.kind == "move":
                words = ", ".join(f"{a}({v:.4f})" for a, v in shown(step.at).items())
                yield f"GoTo({words})"
                if step.seconds:
                    yield f"# stand {step.seconds:g} s"
            else:
                yield f"# target {step.number}, stand {step.seconds:g} s"
                yield "Get(X(), Y(), Z())"
        yield "EndSession()"
