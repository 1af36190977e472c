"""How sure the correction is while it runs: ± where the machine stands, beside the cycle.

A listener that keeps the last record, and a task that looks at it once a second in a thread of its
own: nothing is added to the cycle.
"""

from __future__ import annotations

import asyncio
import enum
import logging
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.measured_ranges import OutsideMeasured
from abbe.compcore.model.model import Model
from abbe.compcore.model.sensitivity import covariance_root
from abbe.compcore.model.uncertainty import expanded, uncertainty
from abbe.daemon.guard import Vec3
from abbe.daemon.pipeline.record import CycleRecord

logger = logging.getLogger("abbe.pipeline")

EVERY = 1.0
"""s from one look to the next."""


class Outside(enum.IntFlag):
    """What of the machine's present state was never measured, as the controller receives it."""

    POSITION = 1 << 0
    """An axis stands where it was not measured."""
    SIGNAL = 1 << 1
    """A temperature, or another signal that the model reads."""
    TOOL = 1 << 2
    """The tool's offset."""
    UNKNOWN = 1 << 3
    """Nobody knows, nor how sure the correction is."""


LARGEST_OUTSIDE = int(sum(Outside))


@dataclass(frozen=True)
class PlusMinus:
    """How sure the correction was at one moment.

    Attributes
    ----------
    wide
        ± in X, Y, Z, k = 2, mm.
    beyond
        What lay outside of what was measured.
    """

    wide: Vec3
    beyond: tuple[OutsideMeasured, ...]

    def outside(self, axes: Collection[str]) -> Outside:
        """The same as bits, for a machine with these axes."""
        found = Outside(0)
        for one in self.beyond:
            if one.name in axes:
                found |= Outside.POSITION
            else:
                found |= Outside.TOOL if one.name.startswith("tool ") else Outside.SIGNAL
        return found


class LiveUncertainty:
    """The ± of a running correction.

    Parameters
    ----------
    model
        The model that corrects.
    axes
        Order of a record's positions.
    tool
        Says the tool's present offset, mm.
    every
        s from one look to the next.

    Attributes
    ----------
    latest
        What was found last; None before the first look, without a covariance, and while a position
        or a signal is missing.
    listeners
        Are called after every look.
    """

    def __init__(
        self, model: Model, axes: tuple[str, ...], tool: Callable[[], Vec3], every: float = EVERY
    ) -> None:
        self._axes, self._tool, self._every = axes, tool, every
        self._record: CycleRecord | None = None
        self._said: tuple[str, ...] = ()
        self.latest: PlusMinus | None = None
        self.listeners: list[Callable[[], None]] = []
        self.change_model(model)

    @property
    def outside(self) -> Outside:
        """What lies outside of what was measured, as bits."""
        return Outside.UNKNOWN if self.latest is None else self.latest.outside(self._axes)

    def change_model(self, model: Model) -> None:
        """Go on with another model of the same machine."""
        self._model = model
        self._root = None if model.covariance is None else covariance_root(model.covariance)
        self._needed = model.signals_needed()

    def __call__(self, record: CycleRecord) -> None:
        """Keep a cycle's record."""
        self._record = record

    async def run(self) -> None:
        """Look until cancelled; at once over where no ± can be known."""
        while True:
            await asyncio.sleep(self._every)
            record = self._record
            if record is None or self._root is None:
                continue
            try:
                self.latest = await asyncio.to_thread(self.at, record, self._tool())
            except Exception:
                # whoever looks on must not disturb the machine
                logger.exception("how sure the correction is cannot be worked out any more")
                self.latest = None
                return
            self._say()
            for listener in self.listeners:
                listener()

    def at(self, record: CycleRecord, tool: Vec3) -> PlusMinus | None:
        """The ± at a record's position, signals and tool."""
        values = {n: record.signals[n].value for n in self._needed if n in record.signals}
        known = (*record.indicated, *values.values())
        if len(values) < len(self._needed) or not all(map(math.isfinite, known)):
            return None
        at = Conditions(
            {a: np.array([q]) for a, q in zip(self._axes, record.indicated, strict=True)},
            # play is as uncertain on either side
            directions={a: np.ones(1) for a in self._axes},
            tool=np.array([tool]),
            time=np.array([record.time]),
            signals={n: np.array([v]) for n, v in values.items()},
        )
        found = uncertainty(self._model, at, self._root)
        if found is None:
            return None
        wide = expanded(found)
        return PlusMinus((wide["X"], wide["Y"], wide["Z"]), found.beyond)

    def _say(self) -> None:
        """Have the journal know, once, which signal or tool has left what was measured."""
        if self.latest is None:  # something is missing: nothing is known to have come back
            return
        outside = {b.name: str(b) for b in self.latest.beyond if b.name not in self._axes}
        names = tuple(sorted(outside))
        if names and names != self._said:
            logger.warning("%s: the correction is less sure", "; ".join(outside.values()))
        elif self._said and not names:
            logger.info("all signals are where the machine was measured again")
        self._said = names
