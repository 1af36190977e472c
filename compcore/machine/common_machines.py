"""Common machine tools and CMMs by name: structure code, typical travels, kind of scales."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Travel = tuple[float, float]


@dataclass(frozen=True, slots=True)
class CommonMachine:
    """A common kind of machine tool or CMM: its structure code (ISO/TR 16907, 5.1) and travels.

    Attributes
    ----------
    title
        For people.
    structure
        Its structure code (ISO/TR 16907, 5.1).
    travels
        Axis → typical lower and upper end, mm (rotary: degrees); a machine's own differ.
    screws
        Whether its linear axes commonly measure by the ball screw (the motor's encoder).
    play
        Whether its axes commonly stand elsewhere when they arrive from the other side.
    """

    title: str
    structure: str
    travels: Mapping[str, Travel]
    screws: bool = False
    play: bool = False


COMMON_MACHINES: Mapping[str, CommonMachine] = {
    "bridge": CommonMachine(
        "moving-bridge CMM",
        "w b Y X Z t",
        {"Y": (0.0, 1000.0), "X": (0.0, 700.0), "Z": (-600.0, 0.0)},
    ),
    "gantry": CommonMachine(
        "gantry: a beam on high rails",
        "w b X Y Z t",
        {"X": (0.0, 3000.0), "Y": (0.0, 2000.0), "Z": (-1000.0, 0.0)},
    ),
    "horizontal-arm": CommonMachine(
        "horizontal-arm CMM",
        "w b X Z Y t",
        {"X": (0.0, 4000.0), "Z": (0.0, 2000.0), "Y": (0.0, 1500.0)},
    ),
    "c-frame": CommonMachine(
        "vertical machining centre, C-frame with a cross table",
        "w X' Y' b Z (C) t",
        {"X": (0.0, 800.0), "Y": (0.0, 500.0), "Z": (-500.0, 0.0)},
        screws=True,
        play=True,
    ),
    "boring": CommonMachine(
        "horizontal boring machine with rotary table and quill W",
        "w B' X' Z' b Y W (C) t",
        {
            "B": (0.0, 360.0),
            "X": (0.0, 2000.0),
            "Z": (0.0, 1500.0),
            "Y": (0.0, 1600.0),
            "W": (-600.0, 0.0),
        },
        play=True,
    ),
    "table-table": CommonMachine(
        "five axes, tilting rotary table (trunnion)",
        "w C' A' Y' b X Z (C) t",
        {
            "C": (0.0, 360.0),
            "A": (-120.0, 30.0),
            "Y": (0.0, 600.0),
            "X": (0.0, 600.0),
            "Z": (-500.0, 0.0),
        },
        play=True,
    ),
    "table-head": CommonMachine(
        "five axes, rotary table and tilting head",
        "w C' X' b Y Z B (C) t",
        {
            "C": (0.0, 360.0),
            "X": (0.0, 1000.0),
            "Y": (0.0, 800.0),
            "Z": (-600.0, 0.0),
            "B": (-110.0, 110.0),
        },
        play=True,
    ),
    "head-head": CommonMachine(
        "five axes, fork head",
        "w X' b Y Z C A (C) t",
        {
            "X": (0.0, 3000.0),
            "Y": (0.0, 2000.0),
            "Z": (-1000.0, 0.0),
            "C": (-200.0, 200.0),
            "A": (-110.0, 110.0),
        },
        play=True,
    ),
    "lathe": CommonMachine(
        "lathe with a turret on a cross slide",
        "w (C') b Z X t",
        {"Z": (0.0, 600.0), "X": (0.0, 250.0)},
        screws=True,
        play=True,
    ),
}
"""Name on the command line → kind of machine."""

_LINEAR: Travel = (0.0, 500.0)
_ROTARY: Travel = (0.0, 360.0)


def usual_travel(axis: str, kind: CommonMachine | None) -> Travel:
    """The usual travel of an axis of such a machine: its ends, mm (rotary: degrees).

    >>> usual_travel("A", None), usual_travel("X", COMMON_MACHINES["lathe"])
    ((0.0, 360.0), (0.0, 250.0))
    """
    if kind is not None and axis in kind.travels:
        return kind.travels[axis]
    return _ROTARY if axis[0] in "ABC" else _LINEAR


def common_machine(structure: str) -> CommonMachine | None:
    """The kind of machine that has this structure code, however it is spaced, if any."""
    bare = structure.replace(" ", "")
    for kind in COMMON_MACHINES.values():
        if kind.structure.replace(" ", "") == bare:
            return kind
    return None
