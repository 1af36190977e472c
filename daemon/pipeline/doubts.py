"""Doubts about what is read and written: too far gone, our own writes, somebody else's writes."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence

from daemon.config.sections import ConfigFile
from daemon.pipeline.follow import Follow
from daemon.pipeline.foreign import Foreign
from daemon.pipeline.motion import Motion
from daemon.pipeline.plan import Plan
from daemon.pipeline.write_back import Outcome, WriteBack
from drivers.link import Link


class Doubts:
    """What makes a position unbelievable though its sample is good and fresh.

    Parameters
    ----------
    axes
        All, in the compensator's order.
    plan
        What is read and written.
    links
        All links.
    write_back
        What is held by the controller, as far as is known.
    file
        The configuration's sections.
    """

    def __init__(
        self,
        axes: Sequence[str],
        plan: Plan,
        links: Mapping[str, Link],
        write_back: WriteBack,
        file: ConfigFile,
    ) -> None:
        self._axes = tuple(axes)
        self._written = tuple(axes.index(target.axis) for target in plan.targets)
        self._motion = Motion(len(axes))
        self._max_lag = math.inf if file.guard.max_lag is None else file.guard.max_lag
        self._follow = Follow(plan.expected.steps)
        self._withheld: list[int] = []
        self._own = ""
        self._write_back = write_back
        self._foreign: Foreign | None = None
        read_back = plan.expected.read_back
        if read_back and file.output.read_back > 0.0:
            self._foreign = Foreign(links, read_back, file.output.read_back)

    @property
    def foreign(self) -> str:
        """Who else writes what Abbe writes, or reads it to Abbe; empty when nobody does."""
        return self._own or (self._foreign.fault if self._foreign is not None else "")

    def step(
        self,
        positions: list[float],
        faults: dict[str, str],
        times: Sequence[float],
        now: float,
    ) -> list[float]:
        """Take doubtful positions out, with the reason; how far each axis may have gone since.

        Parameters
        ----------
        positions
            mm (rotary: rad); those not to be believed become NaN.
        faults
            Axis → why; added to.
        times
            Earliest moment of each position, monotonic, s.
        now
            Monotonic, s.

        Returns
        -------
        list of float
            mm (rotary: rad), by axis.
        """
        lags = self._motion.step(positions, times, now)
        if max(lags, default=0.0) > self._max_lag:
            for i, lag in enumerate(lags):
                if lag > self._max_lag:
                    positions[i] = math.nan
                    faults.setdefault(
                        self._axes[i],
                        f"may have moved by {lag:.3g} since it was read, "
                        f"{1e3 * (now - times[i]):.0f} ms ago",
                    )
        if self._written:
            self._withheld = self._follow.doubts([positions[i] for i in self._written])
            if self._withheld:
                self._take_out_own(positions, faults)
        return lags

    def _take_out_own(self, positions: list[float], faults: dict[str, str]) -> None:
        for place in self._follow.faults():
            axis = self._axes[self._written[place]]
            self._own = (
                f"axis {axis}: what is read as its position is what Abbe writes as the corrected "
                "one; read it elsewhere, then start Abbe again"
            )
            positions[self._written[place]] = math.nan
            faults.setdefault(axis, "its position is what Abbe wrote itself")

    def withhold(self, positions: Sequence[float], corrected: Sequence[float]) -> Sequence[float]:
        """What is written for each target, mm: NaN where the position may be our own."""
        if not self._withheld:
            return corrected
        answer = list(corrected)
        for place in self._withheld:
            answer[place] = math.nan
        return answer

    def wrote(self, positions: Sequence[float], answer: Sequence[float], outcome: Outcome) -> None:
        """Take note of what was written; what was not taken says nothing."""
        kept = outcome.untouched | outcome.unknown
        for place, value in enumerate(answer):
            if value == value and not kept >> place & 1:
                self._follow.wrote(place, positions[self._written[place]], value)

    async def look(self) -> None:
        """Now and then, look whether somebody else writes what Abbe writes."""
        if self._foreign is not None and self._foreign.due(now := time.monotonic()):
            await self._foreign.look(self._write_back.held, now)
