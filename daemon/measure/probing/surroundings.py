"""What is read while the machine touches: positions, signals, whether a correction runs."""

from __future__ import annotations

import asyncio
import time

import numpy as np

from abbe.compcore.errors import AbbeError
from abbe.daemon.config import Configuration
from abbe.daemon.measure.compensation import RunsBeside
from abbe.daemon.measure.kept_rows import KeptRows
from abbe.daemon.measure.machine_view import MachineView, SeenMachine, missing_signal
from abbe.daemon.measure.news import MeasureNews
from abbe.daemon.measure.probing.guarded_tip import GuardedTip
from abbe.drivers.link import Link

_LOOK = 0.1
"""s between two looks while something is waited for."""
_NO_POSITION = 2.0
"""s without a position after which the measurement ends."""
_UP_WITHIN = 20.0
"""s that the machine is waited for at the beginning."""
_STANDS = 0.01
"""mm from look to look of a machine that stands."""
_SAME_TIP = 0.1
"""mm by which the tip may differ from where axes and the plan's tool put it."""


class Surroundings:
    """The machine and its sensors between two touches.

    Parameters
    ----------
    news
        Is told what is missing and what is back.
    rows
        Tried to be written at every look.
    stated
        Whether it is stated which compensation acts.
    """

    def __init__(
        self, configuration: Configuration, news: MeasureNews, rows: KeptRows, *, stated: bool
    ) -> None:
        self._view = MachineView(configuration, {})
        self._held = configuration.file.measure.signals_held
        self._news = news
        self._rows = rows
        self._stated = stated
        self._runs = RunsBeside(configuration)
        self._watch: asyncio.Task[None] | None = None

    @property
    def signal_names(self) -> tuple[str, ...]:
        """The signals that are read."""
        return self._view.signal_names

    def link(self, name: str) -> Link:
        """A link that is read."""
        return self._view.links[name]

    async def open(self) -> None:
        """Open the links."""
        await self._view.open()
        self._watch = asyncio.create_task(self._runs.watch())

    async def close(self) -> None:
        """Close them."""
        if self._watch is not None:
            self._watch.cancel()
            await asyncio.gather(self._watch, return_exceptions=True)
        await self._view.close()

    async def look(self) -> SeenMachine:
        """Look once; what is new is said, rows that wait are written.

        Raises
        ------
        AbbeError
            When a correction of which nobody has said what it does runs beside.
        """
        await asyncio.sleep(0.0)
        seen = await self._view.look()
        self._rows.flush(seen.time)
        self._news.disk(self._rows.problem)
        self._news.signals(seen)
        if self._runs.live and not self._stated:
            raise AbbeError(f"{self._runs.live}, and [measure] active does not say what that does")
        return seen

    async def complete(self) -> SeenMachine:
        """Look until no signal is missing.

        Raises
        ------
        AbbeError
            When it is positions that are missing: the machine has been stopped, or is away.
        """
        told, until = "", time.monotonic() + _NO_POSITION
        while True:
            seen = await self.look()
            missing = self.missing(seen)
            if not seen.fault:
                until = seen.time + _NO_POSITION
            elif seen.time > until:
                raise AbbeError(f"no position: {seen.fault}")
            if not missing:
                return seen
            if missing != told:
                self._news.event("unsteady", f"waits: {missing}")
            told = missing
            await asyncio.sleep(_LOOK)

    def missing(self, seen: SeenMachine) -> str:
        """What is missing for a row; empty when nothing is."""
        return seen.fault or missing_signal(seen, self._held)

    async def look_at_tip(self, tip: GuardedTip) -> None:
        """Refuse another tool than the plan's: the tip would be elsewhere.

        Raises
        ------
        AbbeError
            When it is.
        """
        until = time.monotonic() + _UP_WITHIN
        before = np.full(3, np.inf)
        while True:
            seen = await self.look()
            axes = np.array([seen.positions[a] for a in "XYZ"])
            stands = not seen.fault and float(np.abs(axes - before).max()) < _STANDS
            if stands or time.monotonic() > until:
                break
            before = axes if not seen.fault else before
            await asyncio.sleep(_LOOK)
        if not stands:
            raise AbbeError(f"no position: {seen.fault}" if seen.fault else "the machine moves")
        away = float(np.linalg.norm(await tip.where() - axes - tip.offset))
        if away > _SAME_TIP:
            raise AbbeError(
                f"the tip is {away:.2f} mm from where the axes and the plan's tool put it: another "
                "tool is in, or the channels of the axes are not those of the axes"
            )
