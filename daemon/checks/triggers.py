"""Triggers: numbers by which a controller says that it has measured a check point.

The controller writes what it measured first, then changes the trigger. Both are read again, in one
question, after the change was seen: what is taken belongs to that trigger.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from abbe.daemon.config.channels import split
from abbe.daemon.config.sections.check_points import CheckPointSection
from abbe.drivers.link import Link, Sample

LONGEST_GAP = 30.0
"""s without a look after which a changed trigger is of a time whose temperatures nobody knows."""


class NotTakenError(Exception):
    """A measurement that was noticed and cannot be used; the message says why."""


@dataclass(frozen=True, slots=True)
class MeasuredPoint:
    """What a controller has measured of one check point.

    Attributes
    ----------
    name
        Of the check point.
    values
        Of its channels, in their order and unit: three of `found`, one of `value`, or none.
    """

    name: str
    values: tuple[float, ...]


class Trigger:
    """One check point's trigger, and what is read when it has changed.

    Parameters
    ----------
    name, section
        The check point.
    links
        All links.
    """

    def __init__(self, name: str, section: CheckPointSection, links: Mapping[str, Link]) -> None:
        self.name = name
        self._links = links
        self._link, self._channel = split(section.trigger)
        sources = section.found or (() if section.value is None else (section.value,))
        self._sources = tuple(split(channel) for channel in sources)
        self._known: float | None = None
        self._looked = -math.inf

    async def look(self, now: float) -> MeasuredPoint | None:
        """What was measured since the last look; None: nothing.

        Parameters
        ----------
        now
            Monotonic, s.

        Raises
        ------
        NotTakenError
            When something was, and cannot be used; said once.
        """
        trigger = await self._read_trigger()
        if trigger is None:
            return None
        before, gap = self._known, now - self._looked
        self._looked = now
        if before is None or trigger == before:
            self._known = trigger
            return None
        measured, again = await self._read_values()
        if again != trigger:
            return None  # one more meanwhile, or no answer: the next look takes it
        self._known = trigger
        if trigger == 0.0:
            return None  # a controller that begins anew
        if gap > LONGEST_GAP:
            raise NotTakenError(
                f"it was measured while nobody looked, for {gap:.0f} s: the temperatures then are "
                "not known"
            )
        return MeasuredPoint(self.name, self._values(measured))

    async def _read_trigger(self) -> float | None:
        samples = await self._links[self._link].read([self._channel])
        sample = samples[self._channel]
        return sample.value if sample.good and math.isfinite(sample.value) else None

    async def _read_values(self) -> tuple[list[Sample], float | None]:
        """The values, and the trigger after them: of one question where they are of one link."""
        asked: dict[str, list[str]] = {}
        for link, name in self._sources:
            asked.setdefault(link, []).append(name)
        answers = {
            link: await self._links[link].read([*names, self._channel])
            if link == self._link
            else await self._links[link].read(names)
            for link, names in asked.items()
        }
        samples = [answers[link][name] for link, name in self._sources]
        if list(asked) == [self._link]:
            sample = answers[self._link][self._channel]
            return samples, sample.value if sample.good else None
        return samples, await self._read_trigger()

    def _values(self, samples: list[Sample]) -> tuple[float, ...]:
        for (link, name), sample in zip(self._sources, samples, strict=True):
            if not sample.good or not math.isfinite(sample.value):
                raise NotTakenError(f"{link}.{name}: {sample.reason or 'not a number'}")
        return tuple(sample.value for sample in samples)
