"""The stylus's tip: no move is sent that leaves the travels or enters a keep-out box."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.planning.drawing_back import drawn_back
from abbe.compcore.planning.envelope import WorkingSpace
from abbe.drivers.touch_probe import Place, TouchProbe, TouchTravel

F64 = NDArray[np.float64]


class GuardedTip:
    """A machine's tip, moved along straight lines that were looked at before.

    Parameters
    ----------
    probe
        Moves it.
    machine, space
        Where it may be.
    offset
        Of the tip from the axes' positions, mm.
    turns
        Rotary axis → the link's channel by which it is turned.
    """

    def __init__(
        self,
        probe: TouchProbe,
        machine: Machine,
        space: WorkingSpace,
        offset: Place,
        turns: Mapping[str, str] | None = None,
    ) -> None:
        self._turns = dict(turns or {})
        self._probe = probe
        self._machine = machine
        self._space = space
        self._offset = np.asarray(offset)
        self._at: F64 | None = None
        self._travel = TouchTravel(1.0, 1.0, 1.0, 1.0, 1.0)

    @property
    def offset(self) -> F64:
        """From the axes' positions to the tip, mm."""
        return self._offset

    async def begin(self, travel: TouchTravel) -> None:
        """As `TouchProbe.begin`."""
        await self._probe.begin(travel)
        self._travel = travel

    async def where(self) -> F64:
        """Where the tip is, asked for."""
        self._at = np.asarray(await self._probe.where())
        return self._at

    async def draw_back(self) -> None:
        """Take the tip back towards the spindle, to the end of that axis's travel."""
        await self.go(self.drawn_back(await self.where()))

    async def turn(self, angles: Mapping[str, float]) -> None:
        """Turn rotary axes (rad), the tip drawn back.

        Raises
        ------
        InputError
            For an angle outside the travel, and an axis that the link does not turn; nothing turns.
        LinkError
            As `TouchProbe.turn`.
        """
        for axis, angle in angles.items():
            low, high = self._machine.axes[axis].travel
            if axis not in self._turns or not low - 1e-6 <= angle <= high + 1e-6:
                known = axis in self._turns
                raise InputError(
                    f"{axis} would leave its travel" if known else f"nothing turns {axis}",
                    found=f"{degrees(angle):.3f}°",
                    expected=f"{degrees(low):g} … {degrees(high):g}°" if known else "by hand",
                )
        if angles:
            await self.draw_back()
            await self._probe.turn({self._turns[a]: q for a, q in angles.items()})

    async def come(self, to: F64) -> None:
        """Go to a place from wherever the tip is: back, across, and forward again."""
        await self.draw_back()
        await self.go(self.drawn_back(to))
        await self.go(to)

    def drawn_back(self, place: F64) -> F64:
        """A place as it is with the tip drawn back."""
        axis, height = drawn_back(self._machine, tuple(self._offset.tolist()))
        found = place.copy()
        k = "XYZ".index(axis)
        found[k] = height + self._offset[k]
        return found

    async def go(self, to: F64) -> None:
        """Move straight.

        Raises
        ------
        InputError
            For a way that is not free; nothing was sent.
        LinkError
            As `TouchProbe.go`.
        """
        self.look(to if self._at is None else self._at, to)
        self._at = None
        await self._probe.go(_place(to))
        self._at = to

    async def touch(self, surface: F64, outward: F64) -> F64:
        """Touch, and go back to where the touch began; where the tip was.

        Raises
        ------
        InputError
            For a way that is not free; nothing was sent.
        LinkError
            As `TouchProbe.touch`.
        """
        own = self._travel
        away = surface + (own.approach + 2.0 * own.tip) * outward
        self.look(away, surface - own.search * outward)
        self._at = None
        found = np.asarray(await self._probe.touch(_place(surface), _place(outward)))
        self._at = away
        return found

    async def after_miss(self, away: F64) -> None:
        """Go straight back where nothing was touched, to where the search began."""
        await self._probe.clear()
        await self._probe.go(_place(away))
        self._at = away

    def look(self, start: F64, end: F64) -> None:
        """Look at a straight line before the tip is sent along it.

        Raises
        ------
        InputError
            When it leaves the travels or enters a keep-out box.
        """
        for k, axis in enumerate("XYZ"):
            low, high = self._machine.axes[axis].travel
            value = float(end[k] - self._offset[k])
            if not low - 1e-6 <= value <= high + 1e-6:
                raise InputError(
                    f"{axis} would leave its travel",
                    found=round(value, 3),
                    expected=f"{low:g} … {high:g} mm; place it elsewhere",
                )
        way = {a: np.array([start[k], end[k]]) - self._offset[k] for k, a in enumerate("XYZ")}
        hit = self._space.entered(self._machine, way, self._offset.tolist(), turns=False)
        if hit is not None:
            raise InputError(
                f"the stylus would enter keep-out box {hit}",
                found=", ".join(f"{v:.1f}" for v in end.tolist()),
                expected="a free way",
            )


def _place(at: F64) -> Place:
    x, y, z = at.tolist()
    return x, y, z
