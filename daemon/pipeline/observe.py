"""Observe: what is wrong at present, by name; transitions are logged once."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping

from abbe.daemon.guard import DIRECTIONS, Decision, GuardState
from abbe.daemon.pipeline.faults import StandingFaults
from abbe.daemon.pipeline.plan import PipelinePlan
from abbe.daemon.pipeline.reading.convert import SignalReading
from abbe.drivers.link import Link, LinkState

logger = logging.getLogger("abbe.pipeline")

# Looking a member up in an Enum costs more than a comparison, and this runs in every cycle.
_ACTIVE = GuardState.ACTIVE
_UP, _DEGRADED = LinkState.UP, LinkState.DEGRADED
_LOST = (LinkState.DOWN, LinkState.CONNECTING, LinkState.CLOSED)
_NOTHING: Mapping[str, str] = {}
_WORDS = {
    GuardState.OFF: "no correction",
    GuardState.RISING: "correction ramped in",
    GuardState.ACTIVE: "corrected in full",
    GuardState.HOLDING: "last good correction held",
    GuardState.FALLING: "correction ramped to zero",
}
_COMPUTED = {**_WORDS, GuardState.ACTIVE: "computed in full, not written"}
_LIMITED = "as far as the guard allows, not in full"
_CALM = (_WORDS[GuardState.ACTIVE], _COMPUTED[GuardState.ACTIVE], _WORDS[GuardState.RISING])
_UNSAID = _WORDS[GuardState.OFF]


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
    writes
        Whether corrected positions are written; else nothing is said to be corrected.
    lead_back
        s within which, after something was missing, the correction is led back to what is computed.
    settles
        s that a link which has come back is given until what it carries is sound.
    """

    def __init__(
        self,
        links: Mapping[str, Link],
        plan: PipelinePlan,
        directions: tuple[str, ...] = DIRECTIONS,
        *,
        writes: bool = True,
        lead_back: float = 0.0,
        settles: float = 0.0,
    ) -> None:
        self._links = dict(links)
        self._statuses = [link.status for link in links.values()]
        self._plan = plan
        self._standing = StandingFaults()
        self._limits = StandingFaults(linger=5.0)
        self._directions = directions
        self._states = (GuardState.OFF,) * len(directions)
        self._words = _WORDS if writes else _COMPUTED
        # what the journal said last of each direction
        self._said = [_UNSAID] * len(directions)
        # directions that were cut or behind since that began, for as long as it stands
        self._cut = 0
        self._lead_back, self._led_back_until = lead_back, -math.inf
        self._behind = False
        self._steady: tuple[GuardState, ...] | None = None
        self._settles = settles
        self._carried_by = _carried_by(plan)
        # what an outage may have left behind, and since when; None before the first cycle
        self._left_behind: dict[str, float] | None = None

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
        taken: bool = True,
    ) -> None:
        """Log what has changed since the last cycle.

        Parameters
        ----------
        decision
            The guard's.
        faults
            From `faults`.
        now
            Monotonic, s.
        ending
            Whether Abbe was asked to end.
        oriented
            Whether the rotary axes do all that they can to the tool's direction.
        taken
            Whether the controller took the last correction in every direction.
        """
        news = self._news(faults, now) if faults or self._left_behind != {} else faults
        self._standing.update(news, now)
        states = decision.states
        if states is self._steady and taken and oriented and not decision.limited:
            self._limits.update(_NOTHING, now)
            if not self._cut:
                return
        if not taken or states.count(_ACTIVE) < len(states):
            self._led_back_until = now + self._lead_back
        elif not decision.limited:
            self._led_back_until = -math.inf
        limited = self._limited(decision, now)
        self._limits.update(limited if oriented else {**limited, **_AT_A_POLE}, now)
        if limited or self._cut:
            self._cut = (self._cut | decision.limited) if self._limits.stands("guard") else 0
        elif states == self._states and not self._behind:
            return
        self._states = states
        self._say_states(decision, ending)
        in_full = states.count(_ACTIVE) == len(states) and not decision.limited
        self._steady = states if in_full else None

    def _news(self, faults: Mapping[str, str], now: float) -> Mapping[str, str]:
        """Faults without those that an outage has left behind, unless they last.

        A heartbeat has to be seen to beat again, a sensor to be read: that is no news.
        """
        if self._left_behind is None:
            left_behind = dict.fromkeys(self._carried_by, now)
        else:
            left_behind = {
                what: since
                for what, since in self._left_behind.items()
                if what in faults and now - since < self._settles
            }
        down = {n for n, s in zip(self._links, self._statuses, strict=True) if s.state in _LOST}
        if down:
            left_behind |= {what: now for what, by in self._carried_by.items() if by & down}
        self._left_behind = left_behind
        return {what: why for what, why in faults.items() if what not in left_behind}

    def _limited(self, decision: Decision, now: float) -> Mapping[str, str]:
        """Limits that somebody should know of.

        To be led back to what is computed, after something was missing or was not taken, is none.
        """
        if decision.size_limited:
            return {"guard": "the computed correction is larger than allowed and was cut"}
        if decision.rate_limited and now > self._led_back_until:
            return {"guard": "the computed correction changes faster than allowed"}
        return _NOTHING

    def _say_states(self, decision: Decision, ending: bool) -> None:
        """Log what is new of each direction: never in full beside a limit that still stands."""
        changed: dict[str, list[str]] = {}
        behind = decision.limited & ~self._cut
        self._behind = bool(behind)
        for i, (name, state) in enumerate(zip(self._directions, decision.states, strict=True)):
            words = self._words[state]
            limited = state is _ACTIVE and (self._cut | behind) >> i & 1
            if limited and words != self._said[i]:
                words = _LIMITED if self._cut >> i & 1 else self._words[GuardState.RISING]
            if words != self._said[i]:
                self._said[i] = words
                changed.setdefault(words, []).append(name)
        for words, names in changed.items():
            level = logging.INFO if words in _CALM or ending else logging.WARNING
            event = {"event": "correction changed", "about": {"AXIS": names}}
            logger.log(level, "guard: %s: %s", ", ".join(names), words, extra=event)


def _carried_by(plan: PipelinePlan) -> Mapping[str, frozenset[str]]:
    """By what a fault is named after → the links that carry what it needs."""
    watched = {channel[0] for channel in plan.watch.channels if channel is not None}
    tool = frozenset(link for link, _ in plan.tool)
    written = frozenset(target.channel[0] for target in plan.targets)
    return {
        **{f"axis {s.name}": frozenset(watched | {s.channel[0]}) for s in plan.positions},
        **{f"signal {s.name}": frozenset((s.channel[0],)) for s in plan.signals},
        "tool": tool,
        "write-back": written,
    }


_AT_A_POLE = {
    "orientation": "a rotary axis stands too near to the tool's direction to turn all of it back"
}
