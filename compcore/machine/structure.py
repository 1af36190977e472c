"""The structure code of ISO/TR 16907, 5.1: a machine's axes from workpiece to tool.

``w b Y X Z t`` is a moving-bridge CMM (everything moves on the tool side), ``w X' b Y Z C B (C) t``
a five-axis mill whose table carries the workpiece along X and whose head carries two rotary
axes and a spindle (in brackets: not a positioned axis).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from abbe.compcore.errors import InputError

ROTARY = "ABC"
_AXIS = r"[XYZUVWRABC][0-9]?"
_TOKEN = re.compile(rf"\s*(?:(?P<end>[wbt])|\(\s*(?P<spindle>{_AXIS}'?)\s*\)|(?P<axis>{_AXIS}'?))")
_EXPECTED = 'a code such as "w b Y X Z t" or "w X\' b Y Z C B (C) t"'


def is_rotary(axis: str) -> bool:
    """Whether an axis name is that of a rotary axis (A, B, C; ISO 841)."""
    return axis[0] in ROTARY


@dataclass(frozen=True, slots=True)
class Structure:
    """A machine's structure by ISO/TR 16907, 5.1: its axes from workpiece to tool, and its spindle.

    Attributes
    ----------
    workpiece_side
        Axis names from the workpiece to the bed (written with a prime in the code).
    tool_side
        Axis names from the bed to the tool.
    spindle
        Name of the axis in brackets, or None; `spindle_on_workpiece` for a lathe's.
    """

    workpiece_side: tuple[str, ...]
    tool_side: tuple[str, ...]
    spindle: str | None = None
    spindle_on_workpiece: bool = False

    @classmethod
    def parse(cls, code: str) -> Structure:
        """The structure that a structure code such as ``w X' b Y Z C B (C) t`` describes.

        Raises
        ------
        InputError
            Naming the offending piece and what is expected there.
        """

        def wrong(problem: str, found: str | None = None) -> InputError:
            return InputError(
                f"structure code: {problem}",
                field="structure",
                found=code if found is None else found,
                expected=_EXPECTED,
            )

        text = code.strip().replace("’", "'").replace("′", "'")
        if text.startswith("[") and text.endswith("]"):
            text = text[1:-1]
        text = text.replace("-", " ")
        sides: dict[str, list[str]] = {"w": [], "b": []}
        seen: list[str] = []
        spindle: str | None = None
        spindle_on_workpiece = False
        at, length = 0, len(text.rstrip())
        while at < length:
            match = _TOKEN.match(text, at)
            if match is None:
                rest = text[at:].strip().split()[0]
                raise wrong(f"cannot read {rest if len(rest) <= 20 else rest[:20] + '…'!r}")
            at = match.end()
            if end := match["end"]:
                order = "wbt".index(end)
                if order != len(seen):
                    raise wrong(f"{end!r} stands in the wrong place; the order is w, b, t")
                seen.append(end)
                continue
            token = match["spindle"] or match["axis"]
            name, primed = token.rstrip("'"), token.endswith("'")
            if not seen or len(seen) == 3:
                raise wrong(f"axis {name} stands outside w … t")
            on_workpiece = seen[-1] == "w"
            if on_workpiece and not primed:
                raise wrong(f"axis {name} is on the workpiece side of b and needs a prime: {name}'")
            if primed and not on_workpiece:
                raise wrong(f"axis {name}' is on the tool side of b and must have no prime")
            if match["spindle"]:
                if not is_rotary(name):
                    raise wrong(f"a spindle turns: ({name}) is a linear axis")
                if spindle is not None:
                    raise wrong("more than one spindle in brackets")
                spindle, spindle_on_workpiece = name, on_workpiece
                continue
            if name in sides["w"] + sides["b"]:
                raise wrong(f"axis {name} occurs twice")
            if spindle is not None and not on_workpiece and not spindle_on_workpiece:
                raise wrong(f"axis {name} stands between the spindle and the tool")
            sides[seen[-1]].append(name)
        if seen != ["w", "b", "t"]:
            missing = " ".join(end for end in "wbt" if end not in seen)
            raise wrong(f"{missing} missing")
        if not sides["w"] and not sides["b"]:
            raise wrong("no axes")
        return cls(tuple(sides["w"]), tuple(sides["b"]), spindle, spindle_on_workpiece)

    @property
    def axes(self) -> tuple[str, ...]:
        """All positioned axes, from workpiece to tool."""
        return self.workpiece_side + self.tool_side

    @property
    def linear(self) -> tuple[str, ...]:
        """The linear axes, from workpiece to tool."""
        return tuple(a for a in self.axes if not is_rotary(a))

    @property
    def carrying(self) -> tuple[str, ...]:
        """Those of X, Y, Z that the machine has: the axes that can carry a correction.

        >>> Structure.parse("w b Z X t").carrying
        ('X', 'Z')
        """
        return tuple(a for a in "XYZ" if a in self.linear)

    @property
    def shows_diameters(self) -> bool:
        """Whether a control may show X as a diameter: a lathe, whose spindle turns the work.

        Also where that spindle is a positioned axis, of a machine that mills, too: C next to the
        workpiece, no other axis turns it, and X lies beyond Z, or there is no Y. Abbe's positions
        are always those of the slide itself, a radius.

        >>> [Structure.parse(code).shows_diameters
        ...  for code in ("w (C') b Z X t", "w C' b Z X Y B t", "w C' b X Z t", "w C' b Y X Z t")]
        [True, True, True, False]
        """
        if "X" not in self.linear:
            return False
        return self.spindle_on_workpiece or self._turns_the_work

    @property
    def _turns_the_work(self) -> bool:
        axes = self.axes
        turning = [a for a in self.workpiece_side if is_rotary(a)]
        if turning != ["C"] or axes[0] != "C" or "Z" not in axes or self.spindle is not None:
            return False
        return "Y" not in axes or axes.index("Z") < axes.index("X")

    @property
    def upright(self) -> str:
        """The letter of the direction that stands upright; empty where none is known to.

        A lathe's Z lies along its spindle. A table that turns about Y alone stands under a spindle
        that lies: a boring machine's Y is upright, its Z not.

        >>> [Structure.parse(code).upright for code in ("w b Y X Z t", "w (C') b Z X t")]
        ['Z', '']
        >>> Structure.parse("w B' X' Z' b Y W (C) t").upright
        'Y'
        """
        if self.spindle_on_workpiece:
            return ""
        tables = [a[0] for a in self.workpiece_side if is_rotary(a)]
        return "Y" if tables == ["B"] else "Z"

    @property
    def jointed(self) -> bool:
        """Whether it is an arm: joints that turn about lines of one direction, one behind another.

        >>> [Structure.parse(code).jointed for code in ("w b C C2 Z t", "w C' b Y X Z A t")]
        [True, False]
        """
        joints = [a[0] for a in self.tool_side if is_rotary(a)]
        return len(set(joints)) < len(joints)

    def require_carrying(self) -> None:
        """Refuse a machine that has none of X, Y, Z: an arm or a mount of rotary axes.

        Raises
        ------
        InputError
            When no linear axis can carry a correction.
        """
        if not self.carrying:
            raise InputError(
                "the machine has no axis X, Y or Z that could carry a correction",
                field="structure",
                found=str(self),
                expected="abbe correct --command, which says where to send rotary axes",
            )

    @property
    def rotary(self) -> tuple[str, ...]:
        """The rotary axes, from workpiece to tool."""
        return tuple(a for a in self.axes if is_rotary(a))

    def __str__(self) -> str:
        spindle = f"({self.spindle}{chr(39) if self.spindle_on_workpiece else ''})"
        return " ".join(
            ["w"]
            + ([spindle] if self.spindle and self.spindle_on_workpiece else [])
            + [f"{a}'" for a in self.workpiece_side]
            + ["b"]
            + list(self.tool_side)
            + ([spindle] if self.spindle and not self.spindle_on_workpiece else [])
            + ["t"]
        )
