"""Observe: what is wrong at present, by name; transitions are logged once."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from abbe.daemon.faults import StandingFaults
from abbe.daemon.guard import DIRECTIONS, Decision, GuardState
from abbe.daemon.pipeline.plan import PipelinePlan
from abbe.daemon.pipeline.reading.convert import SignalReading
from abbe.drivers.link import Link, LinkState

logger = logging.getLogger("abbe.pipeline")

# Looking a member up in an Enum costs more than a comparison, and this runs in every cycle.
_UP, _DEGRADED = LinkState.UP, LinkState.DEGRADED
_NOTHING: Mapping[str, str] = {}
_WORDS = {
    GuardState.OFF: "no correction",
    GuardState.RISING: "correction ramped in",
    GuardState.ACTIVE: "corrected in full",
    GuardState.HOLDING: "last good correction held",
    GuardState.FALLING: "correction ramped to zero",
}
_CALM = (GuardState.ACTIVE, GuardState.RISING)


class Observer:
    """Names what is wrong and keeps the log.

    Parameters
    ----------
    links
        All links.
    plan
        What is read from them.
    directions
        X, Y, Z and the rotary axes that are corrected.
    """

    def __init__(
        self,
        links: Mapping[str, Link],
        plan: PipelinePlan,
        directions: tuple[str, ...] = DIRECTIONS,
    ) -> None:
        self._links = dict(links)
        self._statuses = [link.status for link in links.values()]
        self._plan = plan
        self._standing = StandingFaults()
        self._limits = StandingFaults(linger=5.0)
        self._directions = directions
        self._states = (GuardState.OFF,) * len(directions)

    @property
    def all_up(self) -> bool:
        """Whether every link is up, and none degraded."""
        for status in self._statuses:  # noqa: SIM110  (a generator costs more, in every cycle)
            if status.state is not _UP:
                return False
        return True

    def faults(
        self,
        *,
        axes: Mapping[str, str],
        readings: Mapping[str, SignalReading],
        tool: str,
        compensator: str,
        write_back: str,
        foreign: str = "",
    ) -> Mapping[str, str]:
        """What is wrong: what → why. A link that is down stands for all that it carries.

        Parameters
        ----------
        axes
            Axis → why its position is not to be believed.
        readings
            Signals as they were last read.
        tool, compensator, write_back, foreign
            Why the tool's offset is not known, why there is no correction, why it was not written,
            who else writes; empty when all is well.
        """
        found: dict[str, str] = {}
        lost: set[str] = set()
        for name, link in self._links.items():
            state = link.status.state
            if state is not _UP:
                found[f"link {name}"] = f"{state.value}: {link.status.detail}".rstrip(": ")
                if state is not _DEGRADED:
                    lost.add(name)
        for source in self._plan.positions:
            if source.name in axes and source.channel[0] not in lost:
                found[f"axis {source.name}"] = axes[source.name]
        for source in self._plan.signals:
            reading = readings[source.name]
            if reading.fault and source.channel[0] not in lost:
                found[f"signal {source.name}"] = reading.fault
        read = {source.name for source in self._plan.signals}
        for name, reading in readings.items():
            if reading.fault and name not in read:
                found[f"signal {name}"] = reading.fault
        if tool and not any(link in lost for link, _ in self._plan.tool):
            found["tool"] = tool
        if compensator:
            found["compensator"] = compensator
        if write_back and not lost:
            found["write-back"] = write_back
        if foreign:
            found["controller"] = foreign
        return found

    def log(
        self,
        decision: Decision,
        faults: Mapping[str, str],
        now: float,
        ending: bool,
        *,
        oriented: bool = True,
    ) -> None:
        """Log what has changed since the last cycle; `now` is monotonic, s."""
        self._standing.update(faults, now)
        limited = _limited(decision)
        self._limits.update(limited if oriented else {**limited, **_AT_A_POLE}, now)
        if decision.states is self._states or decision.states == self._states:
            return
        changed: dict[GuardState, list[str]] = {}
        for name, before, after in zip(
            self._directions, self._states, decision.states, strict=True
        ):
            if after is not before:
                changed.setdefault(after, []).append(name)
        self._states = decision.states
        for state, names in changed.items():
            level = logging.INFO if state in _CALM or ending else logging.WARNING
            logger.log(level, "guard: %s: %s", ", ".join(names), _WORDS[state])


_AT_A_POLE = {
    "orientation": "a rotary axis stands too near to the tool's direction to turn all of it back"
}


def _limited(decision: Decision) -> Mapping[str, str]:
    if decision.size_limited:
        return {"guard": "the computed correction is larger than allowed and was cut"}
    if decision.rate_limited:
        return {"guard": "the computed correction changes faster than allowed"}
    return _NOTHING
