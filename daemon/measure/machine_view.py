"""The machine and its instruments as they are read while measuring; nothing is ever written."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

from abbe.compcore.errors import InputError
from abbe.daemon.config import Configuration
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.unseen_moves import UnseenMoves
from abbe.daemon.pipeline.plan import make_plan
from abbe.daemon.pipeline.reading.convert import PositionConverter, SignalConverter, SignalReading
from abbe.daemon.pipeline.reading.directions import StatedDirections
from abbe.daemon.pipeline.reading.plausible import Plausible
from abbe.daemon.pipeline.reading.poll import Batch, Poll, by_link
from abbe.drivers.link import Link

_OPEN_WITHIN = 5.0
"""s that a link is given to open; it goes on trying afterwards."""
_CLOSE_WITHIN = 2.0
_ANSWERS_WITHIN = 0.1
"""s that a look waits for instruments on links of their own: positions must not get old by them."""


@dataclass(frozen=True, slots=True)
class SeenMachine:
    """What one look at the machine has shown.

    Attributes
    ----------
    time
        Monotonic, s.
    positions, directions
        Axis → position (mm, rad) and the direction in which it moved last.
    fault
        Why the positions are not to be believed; empty when they are.
    signals
        Signal → its reading.
    unseen
        Axes that came to where they are while nobody looked: their direction is not known.
    """

    time: float
    positions: Mapping[str, float]
    directions: Mapping[str, float]
    fault: str
    signals: Mapping[str, SignalReading]
    unseen: frozenset[str] = frozenset()


def missing_signal(seen: SeenMachine, held: float) -> str:
    """The first signal that was not read for longer than `held` s, and why; else empty."""
    for name, reading in seen.signals.items():
        if seen.time - reading.time > held and (reading.fault or math.isnan(reading.value)):
            return f"{name}: {reading.fault or 'not read yet'}"
    return ""


class MachineView:
    """Reads positions, signals and instruments over and over.

    Parameters
    ----------
    configuration
        What was checked.
    instruments
        Those whose readings are wanted.

    Raises
    ------
    InputError
        For an axis whose datum somebody would have to set.
    """

    def __init__(self, configuration: Configuration, instruments: Mapping[str, Instrument]) -> None:
        file = configuration.file
        for axis, section in file.axes.items():
            if section.datum:
                raise InputError(
                    f"axis {axis} has no position before abbe datum was told one, and that is for "
                    "a running correction",
                    file=configuration.path,
                    field=f"axes.{axis}.datum",
                    expected="an axis whose controller knows where it stands",
                )
        links = configuration.make_links(instruments=True)
        self.axes = configuration.model.machine.structure.axes
        plan = make_plan(configuration, self.axes, links)
        self._instruments = tuple(instruments.values())
        fast = {(link, name) for link, names in plan.fast.items() for name in names}
        fast -= {channel for channel, _ in plan.echo}
        positioning = {link for link, _ in fast}
        read = dict.fromkeys(c for i in self._instruments for c in i.channels)
        wanted = [*sorted(fast), *read]
        self._fast = Poll(links, by_link(c for c in wanted if c[0] in positioning))
        self._own = Poll(links, by_link(c for c in read if c[0] not in positioning))
        self._own_links = {link for link, _ in read} - positioning
        self._own_batch: Batch = {}
        self._asked: asyncio.Task[Batch] | None = None
        self._slow = Poll(links, plan.slow)
        self._slow_batch: Batch = {}
        opened = {*by_link(wanted), *plan.slow}
        self.links: dict[str, Link] = {n: link for n, link in links.items() if n in opened}
        together = by_link(s.channel for s in plan.positions)
        for link, members in together.items():
            if len(members) > 1:
                links[link].keep_together(members)
        expected = plan.expected
        self._positions = PositionConverter(
            plan.positions, file.guard.stale_after, plan.watch, expected.positions
        )
        self.signal_names = tuple(s.name for s in plan.signals)
        self._signals = SignalConverter(
            plan.signals,
            file.guard.signals_stale_after,
            Plausible(expected.signals, expected.similar),
        )
        self._directions = StatedDirections(
            self.axes, [file.axes[axis].turns_after(axis) for axis in self.axes], plan.directions
        )
        stated = [channel is not None for channel in plan.directions]
        self._moves = UnseenMoves(
            [
                math.inf if said else file.axes[axis].turns_after(axis)
                for axis, said in zip(self.axes, stated, strict=True)
            ]
        )
        self._signals_every = file.cycle.signals_every
        self._signals_due = 0.0
        self._task: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Open what is read; a device that cannot be reached is tried again by its link."""
        await asyncio.gather(*(self._open(link) for link in self.links.values()))
        self._task = asyncio.create_task(self._read_slowly())

    async def close(self) -> None:
        """Close it all."""
        running = [task for task in (self._task, self._asked) if task is not None]
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
        await asyncio.gather(*(self._close(link) for link in self.links.values()))

    async def look(self) -> SeenMachine:
        """Look once; the instruments take in what they have read."""
        batch, answered = await self._read_all()
        now = time.monotonic()
        values, faults = self._positions(batch, now)
        directions = self._directions(values, batch, faults)
        moves = zip(self.axes, self._moves.step(now, values), strict=True)
        unseen = frozenset(axis for axis, moved in moves if moved)
        fault = "; ".join(f"{axis}: {why}" for axis, why in faults.items())
        if len(set(faults.values())) == 1:
            fault = next(iter(faults.values()))
        if now >= self._signals_due:
            self._signals_due = now + self._signals_every
            self._signals({**batch, **self._slow_batch}, now)
        for instrument in self._instruments:
            if not answered and any(link in self._own_links for link, _ in instrument.channels):
                instrument.wait(now)
                continue
            reconnects = sum(
                self.links[link].status.reconnects for link, _ in set(instrument.channels)
            )
            instrument.take(batch, now, reconnects)
        return SeenMachine(
            now,
            dict(zip(self.axes, values, strict=True)),
            {
                axis: 0.0 if axis in unseen else direction
                for axis, direction in zip(self.axes, directions, strict=True)
            },
            fault,
            self._signals.readings,
            unseen,
        )

    async def _read_all(self) -> tuple[Batch, bool]:
        """What was read, and whether the instruments on links of their own have answered."""
        if not self._own_links:
            return await self._fast(), True
        if self._asked is None:
            self._asked = asyncio.create_task(self._own())
        asked, until = self._asked, time.monotonic() + _ANSWERS_WITHIN
        batch = await self._fast()
        left = max(0.0, until - time.monotonic()) if self._own_batch else None
        answered = bool((await asyncio.wait({asked}, timeout=left))[0])
        if answered:
            self._own_batch, self._asked = asked.result(), None
        return {**batch, **self._own_batch}, answered

    async def _read_slowly(self) -> None:
        while True:
            self._slow_batch = await self._slow()
            await asyncio.sleep(max(self._signals_every, 0.01))

    async def _open(self, link: Link) -> None:
        try:
            async with asyncio.timeout(_OPEN_WITHIN):
                await link.open()
        except TimeoutError:
            return

    async def _close(self, link: Link) -> None:
        try:
            async with asyncio.timeout(_CLOSE_WITHIN):
                await link.close()
        except TimeoutError:
            return
