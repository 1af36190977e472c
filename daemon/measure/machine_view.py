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
        wanted = [*sorted(fast), *(c for i in self._instruments for c in i.channels)]
        self._fast = Poll(links, by_link(wanted))
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
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        await asyncio.gather(*(self._close(link) for link in self.links.values()))

    async def look(self) -> SeenMachine:
        """Look once; the instruments take in what they have read."""
        batch = await self._fast()
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
