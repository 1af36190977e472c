"""A running LinuxCNC while its tables are looked after: what it does, and what they do in it.

LinuxCNC's compensation of a joint is ``motor-pos-cmd − pos-cmd − motor-offset``. It depends on the
direction of the last motion, which shows only while something moves.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import abbe.drivers.linuxcnc
from abbe.drivers.link import LinkProtocolError, LinkTimeoutError
from abbe.drivers.linuxcnc.process import BridgeProcess
from abbe.drivers.stores.base import RefusedError, ShownCorrection
from abbe.drivers.stores.linuxcnc.ini import is_rotary

_BRIDGE = Path(abbe.drivers.linuxcnc.__file__).with_name("table_bridge.py")
_SETTINGS = {"offsets": {}, "lease": 1e9, "ramp": 0.0, "servo_silence": 5.0}
_PINS = ("motor-pos-cmd", "motor-offset", "vel-cmd", "backlash-corr", "backlash-filt", "pos-cmd")
_THERE = 1e-5
"""mm or degrees by which an axis may stand beside its place."""
_LOOK = 0.02
"""s between two looks."""
_STILL = 1e-9
"""Machine units by which a compensation that has arrived may still differ."""
_A_WAY = 1e-6
"""mm or rad that are no rounding error."""
_MOVE_ROOM = 30.0
"""s on top of the time that a move takes by its feed."""
_NOT_BEGUN = 2.0
"""s for which an axis stands where it stood, and LinuxCNC is idle: it has lost the order."""
_ORDERS = 3
"""How often a move is ordered that LinuxCNC does not begin."""


class Running:
    """A LinuxCNC that runs.

    Parameters
    ----------
    bridge
        The process that is part of it.
    joints
        Axis → its joint.
    timeout
        s for an answer.
    """

    def __init__(self, bridge: BridgeProcess, joints: Mapping[str, int], timeout: float) -> None:
        self._bridge = bridge
        self._joints = joints
        self._timeout = timeout
        self._directions = dict.fromkeys(joints, 0)
        self._speeds: dict[str, float] = {}
        """Last speed that was seen of axes since all stood still."""
        self._stood: dict[str, float] = {}
        self._acting: set[str] = set()
        """Axes that have moved since they were homed, as far as that was seen."""
        self._units = 1.0

    async def state(self) -> dict[str, Any]:
        """What it is doing, as `abbe.drivers.linuxcnc.table_bridge` tells it."""
        said = await self._bridge.ask({"state": True}, self._timeout)
        self._units = float(said["units_per_mm"])
        return said

    def _size(self, axis: str) -> float:
        """How many mm or rad are each of LinuxCNC's units."""
        return math.radians(1.0) if is_rotary(axis) else 1.0 / self._units

    async def look(self) -> ShownCorrection | None:
        """What the tables do where it stands; None while something moves.

        A direction is known where the axis was seen to go that way and to end there. LinuxCNC goes
        by the sign of the last commanded speed, be it 1e-15: after rounding errors it is unknown.
        An axis that has not moved since it was homed is left out: LinuxCNC adds nothing to it yet.
        """
        pins = [
            f"joint.{joint}.{pin}" for joint in self._joints.values() for pin in ("pos-cmd", *_PINS)
        ]
        said = await self._bridge.ask({"read": pins}, self._timeout)
        if said["why"]:
            raise RefusedError("; ".join(f"{k}: {v}" for k, v in said["why"].items()))
        position, correction, still = {}, {}, True
        each = len(_PINS) + 1
        for i, axis in enumerate(self._joints):
            before, motor, offset, speed, wanted, applied, after = said["values"][
                i * each : (i + 1) * each
            ]
            if speed:
                self._speeds[axis] = speed
            still &= not speed and before == after and abs(wanted - applied) <= _STILL
            position[axis] = after * self._size(axis)
            if speed or wanted or applied:
                self._acting.add(axis)
            if axis in self._acting:
                correction[axis] = (motor - after - offset) * self._size(axis)
        if not still:
            return None
        for axis, at in position.items():
            way, speed = at - self._stood.get(axis, at), self._speeds.pop(axis, 0.0)
            if way or speed:
                self._acting.add(axis)
                agree = abs(way) > _A_WAY and way * (speed or way) > 0.0
                self._directions[axis] = (1 if way > 0.0 else -1) if agree else 0
        self._stood = position
        return ShownCorrection(position, correction, dict(self._directions))

    async def watch(self, seconds: float) -> list[ShownCorrection]:
        """What the tables do wherever it stands still within some time, at least once.

        Raises
        ------
        LinkTimeoutError
            When it never stands still.
        """
        began = time.monotonic()
        found: list[ShownCorrection] = []
        while True:
            seen = await self.look()
            if seen is not None and (not found or seen != found[-1]):
                found.append(seen)
            passed = time.monotonic() - began
            if passed > seconds and (found or passed > self._timeout + _MOVE_ROOM):
                break
            await asyncio.sleep(_LOOK)
        if not found:
            raise LinkTimeoutError("the machine does not stand still: no compensation can be seen")
        return found

    async def move(self, step: float, points: int, feed: float) -> list[ShownCorrection]:
        """Move each axis up by some steps and down again; what the tables do on the way.

        Parameters
        ----------
        step
            mm or degrees.
        points
            Steps each way; fewer where the soft limits are nearer.
        feed
            mm/min or degrees/min.

        Raises
        ------
        LinkTimeoutError
            When a move does not begin or end.
        LinkProtocolError
            When the machine is off, busy or not homed, or somebody else has told it something.
        """
        state = await self.state()
        found: list[ShownCorrection] = []
        try:
            for axis in self._joints:
                if axis in state["position"]:
                    found += await self._up_and_down(axis, state, step, points, feed)
        finally:
            await self._bridge.ask({"mode": state["mode"]}, self._timeout + _MOVE_ROOM)
        return found

    async def _up_and_down(
        self, axis: str, state: Mapping[str, Any], step: float, points: int, feed: float
    ) -> list[ShownCorrection]:
        unit = 1.0 if is_rotary(axis) else 1.0 / self._units
        start = state["position"][axis] * unit
        low, high = (limit * unit for limit in state["limits"][axis])
        upward = min(points, int((high - start) / step))
        downward = min(points, int((start - low) / step))
        sign, count = (1, upward) if upward >= downward else (-1, downward)
        found = []
        at = start
        for i in (*range(1, count + 1), *range(count - 1, -1, -1)):
            to = start + sign * i * step
            seen = await self._go(axis, at, to, feed)
            # the others may have moved by rounding errors
            found.append(replace(seen, direction={axis: 1 if to > at else -1}))
            at = to
        return found

    async def _go(self, axis: str, at: float, to: float, feed: float) -> ShownCorrection:
        """One move, mm or degrees; ordered again where LinuxCNC lost the order."""
        for _ in range(_ORDERS):
            said = await self._bridge.ask(
                {"move": {"axis": axis, "to": to, "feed": feed}}, self._timeout + _MOVE_ROOM
            )
            self._acting.add(axis)
            limit = abs(to - at) / feed * 60.0 + _MOVE_ROOM
            seen = await self._arrival(axis, at, to, said["command"], limit)
            if seen is not None:
                return seen
        raise LinkTimeoutError(f"LinuxCNC does not move {axis} to {to:g}, ordered {_ORDERS} times")

    async def _arrival(
        self, axis: str, at: float, to: float, command: int, limit: float
    ) -> ShownCorrection | None:
        """What is shown when it has arrived; None where the move was never begun.

        Nothing is ordered again once it has moved, or somebody else has told LinuxCNC anything: it
        may have been stopped for a reason.
        """
        began = latest = time.monotonic()
        while True:
            state = await self.state()
            now = time.monotonic()
            unit = 1.0 if is_rotary(axis) else 1.0 / self._units
            place = state["position"][axis] * unit
            if not state["on"]:
                raise LinkProtocolError(f"LinuxCNC was switched off while {axis} moved to {to:g}")
            if not (state["idle"] and state["in_position"]):
                latest = now
            elif abs(place - to) < _THERE:
                seen = await self.look()
                if seen is not None:
                    return seen
            elif now - latest > _NOT_BEGUN:
                if state["command"] != command:
                    raise LinkProtocolError(
                        f"{axis} stands at {place:g} instead of {to:g}: LinuxCNC was told "
                        "something else meanwhile; it is not moved any further"
                    )
                if abs(place - at) < _THERE:
                    return None
            if now - began > limit:
                raise LinkTimeoutError(
                    f"{axis} did not reach {to:g} in {limit:.0f} s: it is at {place:g}, "
                    f"LinuxCNC is {'idle' if state['idle'] else 'busy'}"
                )
            await asyncio.sleep(_LOOK)


@asynccontextmanager
async def attached(
    python: str, joints: Mapping[str, int], wait_limit: float
) -> AsyncIterator[Running]:
    """Be part of the LinuxCNC that runs.

    Raises
    ------
    LinkDownError
        When none does.
    """
    bridge = BridgeProcess(python, _SETTINGS, lambda _why: None, _BRIDGE)
    try:
        await bridge.start()
        yield Running(bridge, joints, wait_limit)
    finally:
        await bridge.close()


def largest_trim(texts: Mapping[str, str], kinds: Mapping[str, int]) -> float:
    """The largest trim that LinuxCNC would make of files, in their unit.

    Parameters
    ----------
    texts
        File → text.
    kinds
        File → COMP_FILE_TYPE.
    """
    largest = 0.0
    for name, text in texts.items():
        for row in _rows(text):
            trims = [v - row[0] for v in row[1:]] if kinds[name] == 0 else row[1:]
            largest = max(largest, *(abs(trim) for trim in trims))
    return largest


def _rows(text: str) -> Sequence[Sequence[float]]:
    """Rows as LinuxCNC reads them: up to the first line that is not three numbers."""
    rows = []
    for line in text.splitlines():
        try:
            row = [float(word) for word in line.split()[:3]]
        except ValueError:
            break
        if len(row) < 3:
            break
        rows.append(row)
    return rows
