"""What a dialect of programs is, and which there are."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.motion import ProgramStep
from abbe.compcore.planning.planned_setup import FEED, TURN_RATE

MADE_BY = "made by abbe program"
"""Stands in every program, so that one may be overwritten by the next."""
_PLAIN = str.maketrans(
    {"µ": "u", "−": "-", "°": " deg", "×": "x", "…": "..", "ä": "ae", "ö": "oe", "ü": "ue"}
)


LOG = "probed.csv"
"""What a program calls the file of its touches; `abbe import-campaign --as probed` reads it."""


class Dialect(ABC):
    """The language of one kind of controller.

    Attributes
    ----------
    name
        On the command line.
    title
        For people.
    """

    name: ClassVar[str]
    title: ClassVar[str]

    @abstractmethod
    def text(self, steps: Sequence[ProgramStep], machine: Machine, title: str, feed: float) -> str:
        """The program.

        Parameters
        ----------
        title
            What it is, for people.
        feed
            Of all moves, mm/min; where only rotary axes move, `feed_of` of it.

        Raises
        ------
        InputError
            When the language cannot say it.
        """


def feed_of(step: ProgramStep, feed: float) -> float:
    """The feed of a move, mm/min; degrees/min, a fifth of it, where only rotary axes move.

    So the plan's times count them: 3000 mm/min beside 10 degrees a second.
    """
    return feed * math.degrees(TURN_RATE) / FEED if step.turning else feed


def no_touching(title: str) -> InputError:
    """The refusal of a sphere that is touched."""
    return InputError(
        f"no programs that touch a sphere in the language of {title}",
        field="controller",
        found=title,
        expected="linuxcnc, fanuc or siemens; the control's own cycle (KinematicsOpt), or "
        "abbe measure with a section [probing]",
    )


def touches(steps: Sequence[ProgramStep]) -> bool:
    """Whether a program touches anything."""
    return any(step.kind == "touch" for step in steps)


def no_lathe(title: str, machine: Machine) -> InputError:
    """The refusal of a lathe: X may be a diameter there, and words mean something else.

    G94 of a Fanuc lathe turns a face in its usual system of codes.
    """
    return InputError(
        f"no programs for a lathe in the language of {title}: X may be a diameter there, and what "
        "sets that is a parameter of the machine",
        field="controller",
        found=str(machine.structure),
        expected="linuxcnc or siemens, which can say that X is a radius",
    )


def require_letters(title: str, machine: Machine) -> None:
    """Refuse axes called C2 or B3 where a word is one letter and a number.

    LinuxCNC ends ``C0 C2-121.6`` with *Multiple c words on one line*; no manual at hand says what
    the others make of it.

    Raises
    ------
    InputError
        Of the first such axis.
    """
    for axis in machine.structure.axes:
        if len(axis) > 1:
            raise InputError(
                f"in the language of {title} an axis is one letter",
                field="controller",
                found=axis,
                expected="siemens, which writes C2=…; its --targets is a list for all others",
            )


def shown(at: Mapping[str, float]) -> dict[str, float]:
    """Positions as controllers spell them: mm and degrees."""
    return {a: (math.degrees(v) if is_rotary(a) else v) + 0.0 for a, v in at.items()}


def plain(text: str) -> str:
    """ASCII without brackets and line ends, as comments of every controller may hold it.

    >>> plain("laser (XL−80): 5 µm")
    'laser [XL-80]: 5 um'
    """
    ascii_ = text.translate(_PLAIN).encode("ascii", "replace").decode("ascii")
    one_line = "".join(c if c.isprintable() else " " for c in ascii_)
    return one_line.replace("(", "[").replace(")", "]").replace(";", ",").replace('"', "'")


def targets_csv(steps: Sequence[ProgramStep], machine: Machine) -> str:
    """The list of targets: number, set-up, positions (mm, degrees), directions, s of standing."""
    axes = machine.structure.axes
    lines = [",".join(["number", "setup", *axes, *(f"{a}_dir" for a in axes), "seconds"])]
    for step in steps:
        if step.kind == "target":
            at = shown(step.at)
            cells = [str(step.number), step.setup, *(f"{at[a]:.4f}" for a in axes)]
            cells += [str(step.directions.get(a, 0)) for a in axes]
            lines.append(",".join([*cells, f"{step.seconds:g}"]))
    return "\n".join(lines) + "\n"
