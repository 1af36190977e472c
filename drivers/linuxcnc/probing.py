"""The touch probe of a machine that LinuxCNC moves: straight moves over MDI, and ``G38.2``.

LinuxCNC looks at ``motion.probe-input`` once a servo period, notes where the axes are when it
rises, and slows down. Whoever moves the axes besides, or switches the machine off, ends it.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from abbe.drivers.link import LinkDownError, LinkError
from abbe.drivers.linuxcnc.config import LinuxCncConfig
from abbe.drivers.linuxcnc.process import BridgeProcess
from abbe.drivers.touch_probe import NotTouchedError, Place, TouchProbe, TouchTravel

TOUCH_BRIDGE = Path(__file__).with_name("touch_bridge.py")
_LOOK = 0.02
"""s between two looks at a move."""
_THERE = 2e-3
"""mm or degrees from its end within which a move has come to it, or has not begun."""
_STANDS = 10.0
"""s without motion after which a move that is not over is given up."""
_STOPPED = 0.5
"""s without motion after which a move that ended on its way counts as stopped."""
_NOT_BEGUN = 2.0
"""s for which nothing moves and LinuxCNC is idle: it has lost the order."""
_ORDERS = 3
"""How often a move is ordered that LinuxCNC does not begin."""
_TURNS_AT = 600.0
"""Degrees/min at which rotary axes turn."""
_ANSWER = 30.0
"""s for an answer of the bridge process: LinuxCNC may have to change its mode."""


class LinuxCncProbe(TouchProbe):
    """The probe behind ``motion.probe-input``; ``docs/linuxcnc.md``.

    Parameters
    ----------
    label
        The link, for people.
    config
        Its section: rotary axes are turned that a channel with pin ``axis.L.pos-cmd`` shows.
    """

    def __init__(self, label: str, config: LinuxCncConfig) -> None:
        self._label = label
        self._channels = config.channels
        settings = {"offsets": {}, "lease": 1.0, "ramp": 0.0, "servo_silence": config.servo_silence}
        self._bridge = BridgeProcess(config.python, settings, self._lost, TOUCH_BRIDGE)
        self._patience = max(_ANSWER, config.timeout)
        self._asking = asyncio.Lock()
        self._up = False
        self._gone = ""
        self._travel = TouchTravel(1.0, 1.0, 1.0, 1.0, 1.0)

    def _lost(self, why: str) -> None:
        self._gone = why

    async def close(self) -> None:
        """End its process; a move of it that is under way is aborted."""
        if self._up:
            await self._bridge.close()

    async def begin(self, travel: TouchTravel) -> None:
        """As `TouchProbe.begin`."""
        self._travel = travel
        await self._ask({"begin": True})

    async def where(self) -> Place:
        """As `TouchProbe.where`."""
        return _place((await self._ask({"tip": True}))["tip"])

    async def go(self, to: Place) -> None:
        """As `TouchProbe.go`."""
        await self._go(to)

    async def touch(self, surface: Place, outward: Place) -> Place:
        """As `TouchProbe.touch`."""
        own = self._travel
        await self._go(_beside(surface, outward, own.approach + own.tip))
        end = _beside(surface, outward, own.tip - own.search)
        how = await self._carried_out("touch", {"to": end, "feed": 60.0 * own.touch_speed})
        if not how["tripped"]:
            raise NotTouchedError(f"{self._label}: G38.2 came to its end and touched nothing")
        await self._go(_beside(surface, outward, own.approach + 2.0 * own.tip), touching=True)
        return _place(how["touched"])

    def turns(self, channel: str) -> bool:
        """A channel with the pin ``axis.a.pos-cmd``, likewise b and c."""
        return channel in self._channels and self._letter(channel) != ""

    async def turn(self, angles: Mapping[str, float]) -> None:
        """As `TouchProbe.turn`: ``G53 G1``, at 10° a second."""
        unknown = [name for name in angles if not self.turns(name)]
        if unknown:
            raise LinkError(f"{', '.join(unknown)}: no rotary axis")
        to = {
            self._letter(name): value / self._channels[name].scale for name, value in angles.items()
        }
        await self._carried_out("turn", {"to": to, "feed": _TURNS_AT})

    async def clear(self) -> None:
        """Nothing: LinuxCNC goes on after a G38.2 that touched nothing."""

    async def halt(self) -> None:
        """As `TouchProbe.halt`."""
        if self._up:
            with contextlib.suppress(LinkError):
                await self._ask({"halt": True})

    def _letter(self, channel: str) -> str:
        words = str(self._channels[channel].pin).split(".")
        turns = len(words) == 3 and words[0] == "axis" and words[2] == "pos-cmd"
        return words[1].upper() if turns and words[1] in ("a", "b", "c") else ""

    async def _go(self, to: Place, *, touching: bool = False) -> None:
        feed = 60.0 * self._travel.speed
        await self._carried_out("go", {"to": to, "feed": feed, "touching": touching})

    async def _carried_out(self, kind: str, order: dict[str, Any]) -> dict[str, Any]:
        """A move; how it ended. One that LinuxCNC loses is ordered again, one that ends is not.

        Raises
        ------
        LinkError
            When it does not end where it shall: at its end, or where the probe trips.
        """
        for _ in range(_ORDERS):
            began = (await self._ask({kind: order}))["from"]
            how = await self._ended(kind, began, free=not order.get("touching"))
            if how is not None:
                await self._ask({"done": True})
                return how
        raise LinkError(f"{self._label}: LinuxCNC does not begin to move, ordered {_ORDERS} times")

    async def _ended(
        self, kind: str, began: dict[str, Any], *, free: bool
    ) -> dict[str, Any] | None:
        """How a move ended; None when it never began.

        `free`: nothing may be touched by a ``go``.
        """
        moved_at, last = time.monotonic(), began["axes"]
        while True:
            how = await self._ask({"how": True})
            self._require_free(how)
            left = math.dist(how["axes"], began["axes"]) > _THERE
            there = how["off"] <= _THERE
            if how["idle"] and (there or (kind == "touch" and left and how["tripped"])):
                if kind == "go" and free and how["met"]:
                    raise LinkError(f"{self._label}: the probe touched something on its way")
                # what tripped before this move began says nothing of it
                return how | {"tripped": how["tripped"] and left}
            now = time.monotonic()
            if how["axes"] != last:
                moved_at, last = now, how["axes"]
            stands = now - moved_at
            if how["idle"] and left and stands > _STOPPED:
                met = kind == "go" and how["met"]
                words = "the probe touched something" if met else "LinuxCNC says why on its screen"
                raise LinkError(
                    f"{self._label}: a move was stopped {how['off']:.2f} before its end: {words}"
                )
            if how["idle"] and not left and stands > _NOT_BEGUN:
                return None
            if stands > _STANDS:
                raise LinkError(
                    f"{self._label}: the machine stands, and is not where it was sent: is the "
                    "feed held, or its override at 0?"
                )
            await asyncio.sleep(_LOOK)

    def _require_free(self, how: dict[str, Any]) -> None:
        if not how["on"]:
            raise LinkError(f"{self._label}: the machine was switched off")
        if how["astray"]:
            raise LinkError(f"{self._label}: the tip was {how['astray']:.2f} mm beside its line")
        if how["others"]:
            raise LinkError(f"{self._label}: somebody else has told LinuxCNC something")

    async def _ask(self, order: dict[str, Any]) -> dict[str, Any]:
        if self._gone:
            raise LinkDownError(f"{self._label}: {self._gone}")
        try:
            async with self._asking:
                if not self._up:
                    self._up = True
                    await self._bridge.start()
                return await self._bridge.ask(order, self._patience)
        except LinkError as error:
            raise type(error)(f"{self._label}: {error}") from None


def _beside(surface: Place, outward: Place, by: float) -> Place:
    x, y, z = (s + by * d for s, d in zip(surface, outward, strict=True))
    return x, y, z


def _place(found: list[float]) -> Place:
    x, y, z = found
    return x, y, z
