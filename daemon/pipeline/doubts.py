"""Doubts about what is read and written: too far gone, our own writes, somebody else's writes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from abbe.compcore.units import in_digits
from abbe.daemon.config.sections.config_file import ConfigFile
from abbe.daemon.pipeline.plan import PipelinePlan
from abbe.daemon.pipeline.reading.motion import SampleSpeeds
from abbe.daemon.pipeline.writing.foreign_writes import Foreign
from abbe.daemon.pipeline.writing.own_writes import Follow
from abbe.daemon.pipeline.writing.write_back import WriteBack, WriteOutcome
from abbe.drivers.link import Link


class Doubts:
    """Doubts about positions whose samples are good and fresh.

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
        plan: PipelinePlan,
        links: Mapping[str, Link],
        write_back: WriteBack,
        file: ConfigFile,
    ) -> None:
        self._axes = tuple(axes)
        self._written = tuple(axes.index(target.axis) for target in plan.targets)
        self._motion = SampleSpeeds(len(axes))
        self._max_lag = file.guard.max_lag
        self._indicated: Sequence[float] = ()
        self._follow = Follow(plan.expected.steps)
        self._withheld: list[int] = []
        self._own = ""
        self._foreign: Foreign | None = None
        read_back = plan.expected.read_back
        if read_back and file.output.read_back > 0.0:
            counters = {plan.status, plan.heartbeat, *(target for _, target in plan.echo)}
            self._foreign = Foreign(
                links,
                read_back,
                write_back,
                plan.status if plan.status in read_back else None,
                plan.heartbeat if plan.heartbeat in read_back else None,
                frozenset(c for c in counters if c is not None),
                file.output.read_back,
                file.cycle.period,
            )

    @property
    def foreign(self) -> str:
        """Who else writes what Abbe writes, or reads it to Abbe; empty when nobody does."""
        return self._own or (self._foreign.fault if self._foreign is not None else "")

    @property
    def undecided(self) -> bool:
        """Whether it is not known yet if somebody else is at work, and will be."""
        return self._foreign is not None and self._foreign.undecided

    @property
    def longest_doubt(self) -> float:
        """Time after which that is known where the controller answers, s."""
        return self._foreign.longest_doubt if self._foreign is not None else 0.0

    def step(
        self, positions: list[float], faults: dict[str, str], taken_at: float, now: float
    ) -> None:
        """Take doubtful positions out, with the reason.

        Parameters
        ----------
        positions
            mm (rotary: rad); those not to be believed become NaN.
        faults
            Axis → why; added to.
        taken_at
            Earliest moment at which they can have been taken, monotonic, s.
        now
            Monotonic, s.
        """
        self._motion.step(positions, taken_at)
        if self._max_lag is not None:
            self._take_out_far(positions, faults, now - taken_at)
        if self._written:
            self._indicated = [positions[i] for i in self._written]
            self._withheld = self._follow.doubts(self._indicated)
            if self._withheld:
                self._take_out_own(positions, faults)

    def _take_out_far(self, positions: list[float], faults: dict[str, str], age: float) -> None:
        for i, speed in enumerate(self._motion.speeds):
            if age * speed > (self._max_lag or 0.0):
                positions[i] = math.nan
                faults.setdefault(
                    self._axes[i],
                    f"may have moved by {in_digits(age * speed)} since it was read, "
                    f"{1e3 * age:.0f} ms ago",
                )

    def _take_out_own(self, positions: list[float], faults: dict[str, str]) -> None:
        for place in self._follow.faults():
            axis = self._axes[self._written[place]]
            self._own = (
                f"axis {axis}: what is read as its position is what Abbe writes as the corrected "
                "one; read it elsewhere, then start Abbe again"
            )
            positions[self._written[place]] = math.nan
            faults.setdefault(axis, "its position is what Abbe wrote itself")

    @property
    def speeds(self) -> tuple[float, ...]:
        """By axis, as measured, mm/s (rotary: rad/s), without sign."""
        return self._motion.speeds

    def withhold(self, corrected: Sequence[float]) -> Sequence[float]:
        """What is written for each target, mm: NaN where the position may be our own."""
        if not self._withheld:
            return corrected
        answer = list(corrected)
        for place in self._withheld:
            answer[place] = math.nan
        return answer

    def shut_late(self, now: float) -> None:
        """Keep a cycle that was stopped half-way, for long, from writing over somebody else."""
        if self._foreign is not None:
            self._foreign.shut_late(now)

    def wrote(self, answer: Sequence[float], outcome: WriteOutcome) -> None:
        """Take note of what was written; what was not taken says nothing."""
        self._follow.wrote(self._indicated, answer, outcome.untouched | outcome.unknown)

    def due(self, now: float) -> bool:
        """Whether it is time to `look`, at `now` (monotonic, s)."""
        return self._foreign is not None and self._foreign.due(now)

    async def look(self, now: float) -> None:
        """See whether somebody else writes what Abbe writes."""
        if self._foreign is not None:
            await self._foreign.look(now)
