"""The probe of a measuring machine that speaks I++ DME: ``GoTo`` and ``PtMeas``.

By the standard (1.5, 6.12): the nominal point is on the surface; the approach position lies the
tip's radius and ``Tool.PtMeasPar.Approach`` away from it along ``IJK``, the end of search
``Tool.PtMeasPar.Search`` on the other side; a negative ``Retract`` goes back to the approach
position; what is reported is the middle of the tip. Some servers count no radius there: the
approach is made longer and the search shorter by it, so that both keep clear.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence

from abbe.drivers.ipp.asking import Asking
from abbe.drivers.ipp.config import IppChannelConfig
from abbe.drivers.ipp.errors import StoppedError
from abbe.drivers.ipp.grammar import Named, Value
from abbe.drivers.ipp.question import coordinate_system
from abbe.drivers.link import LinkDownError, LinkError, LinkProtocolError
from abbe.drivers.touch_probe import NotTouchedError, Place, TouchProbe, TouchTravel

SURFACE_NOT_FOUND = 1006
_MACHINE = "MachineCsy"
_ANSWER = 5.0
"""s for a command that moves nothing."""
_SLOW = 3.0
"""Ways may take so many times longer than at their speed, and `_ANSWER` more."""
_TURNING = 180.0
"""s that a rotary table may take."""
_LONGEST = 5000.0
"""mm of a way to an unknown place, for the time that it may take."""


class IppProbe(TouchProbe):
    """The probe behind a link's server; ``docs/measure.md``."""

    def __init__(
        self, asking: Asking, channels: Mapping[str, IppChannelConfig] | None = None
    ) -> None:
        self._asking = asking
        self._channels = dict(channels or {})
        self._travel = TouchTravel(1.0, 1.0, 1.0, 1.0, 1.0)
        self._at: Place | None = None
        self._connection: int | None = None
        """Which connection it is that moves the machine."""

    async def begin(self, travel: TouchTravel) -> None:
        """As `TouchProbe.begin`."""
        self._travel = travel
        found = coordinate_system(await self._command("GetCoordSystem()", _ANSWER))
        if found != _MACHINE:
            raise LinkError(f"the machine counts in {found}, and {_MACHINE} is wanted")
        approach = travel.approach + travel.tip
        search = max(travel.search - travel.tip, 0.0)
        for name, value in (
            ("GoToPar.Speed", travel.speed),
            ("PtMeasPar.Speed", travel.touch_speed),
            ("PtMeasPar.Approach", approach),
            ("PtMeasPar.Search", search),
            ("PtMeasPar.Retract", -1.0),
        ):
            await self._command(f"SetProp(Tool.{name}({value:.4f}))", _ANSWER)
        await self._command("OnPtMeasReport(X(), Y(), Z())", _ANSWER)

    async def where(self) -> Place:
        """As `TouchProbe.where`."""
        self._at = _place(await self._command("Get(X(), Y(), Z())", _ANSWER))
        return self._at

    async def go(self, to: Place) -> None:
        """As `TouchProbe.go`."""
        way = _LONGEST if self._at is None else math.dist(self._at, to)
        self._at = None
        await self._command(f"GoTo({_words(to)})", self._within(way, self._travel.speed))
        self._at = to

    async def touch(self, surface: Place, outward: Place) -> Place:
        """As `TouchProbe.touch`."""
        own, start = self._travel, self._at
        way = _LONGEST if start is None else math.dist(start, surface)
        slow = 2.0 * (own.approach + own.search + 2.0 * own.tip)
        within = self._within(way, own.speed) + self._within(slow, own.touch_speed)
        direction = ", ".join(f"{v:.6f}" for v in outward)
        self._at = None
        try:
            answer = await self._command(f"PtMeas({_words(surface)}, IJK({direction}))", within)
        except StoppedError as error:
            if error.error.number == SURFACE_NOT_FOUND:
                raise NotTouchedError(str(error)) from None
            raise
        self._at = surface
        return _place(answer)

    def turns(self, channel: str) -> bool:
        """The rotary table; a probe head takes another tool in each of its places."""
        return channel in self._channels and self._channels[channel].axis == "R"

    async def turn(self, angles: Mapping[str, float]) -> None:
        """As `TouchProbe.turn`: ``GoTo(R())``."""
        unknown = [name for name in angles if not self.turns(name)]
        if unknown:
            raise LinkError(f"{', '.join(unknown)}: no rotary table")
        words = ", ".join(
            f"R({self._channels[name].number_of(value):.6f})" for name, value in angles.items()
        )
        await self._command(f"GoTo({words})", self._within(0.0, 1.0) + _TURNING)

    async def clear(self) -> None:
        """As `TouchProbe.clear`."""
        await self._command("ClearAllErrors()", _ANSWER)

    async def halt(self) -> None:
        """As `TouchProbe.halt`."""
        self._at = None
        with contextlib.suppress(LinkError):
            await self._asking.overtake("AbortE()")

    async def _command(self, text: str, within: float) -> tuple[Value, ...]:
        """A command of the one connection on which it began: what was before is not known."""
        own = self._asking.reconnector.status.reconnects
        if self._connection is None:
            self._connection = own
        elif own != self._connection:
            raise LinkDownError(f"{self._asking.reconnector.label}: the connection was lost")
        return await self._asking.command(text, within)

    def _within(self, way: float, speed: float) -> float:
        return _ANSWER + _SLOW * way / speed


def _words(place: Sequence[float]) -> str:
    return ", ".join(f"{a}({v:.5f})" for a, v in zip("XYZ", place, strict=True))


def _place(data: tuple[Value, ...]) -> Place:
    found = {v.name: v.values[0] for v in data if isinstance(v, Named) and v.values}
    x, y, z = (found.get(a) for a in "XYZ")
    if not (isinstance(x, float) and isinstance(y, float) and isinstance(z, float)):
        raise LinkProtocolError(f"no place in the answer {data!r:.200}")
    return x, y, z
