"""The checker: the promises, judged from what was on the wire and when, and from nothing else.

Where several pictures of the machine could have been the source of what was written, the one that
speaks best for Abbe counts. What fell into a stall of this very process is not judged.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field

from abbe.drivers.simulated.torment.judge.evidence import AXES, ShownPicture, Taken
from abbe.drivers.simulated.torment.judge.promises import Promises, Tally, Violation
from abbe.drivers.simulated.torment.judge.steps import StepJudge
from abbe.drivers.simulated.torment.judge.words import (
    COMPENSATING,
    RUNNING,
    X_ACTIVE,
    Y_ACTIVE,
    Z_ACTIVE,
)
from abbe.drivers.simulated.torment.loop import Moment
from abbe.drivers.simulated.torment.machine import FAULT, POISON, REFERENCED

_REMEMBERED = 12.0
"""s for which pictures are kept."""
_ACTIVE = {"X": X_ACTIVE, "Y": Y_ACTIVE, "Z": Z_ACTIVE}


@dataclass
class Checker:
    """Takes what went out and came in, and finds violations.

    Parameters
    ----------
    promises
        What was promised.
    stalled
        Between two monotonic times: whether this process stood still in between.
    waited
        Between two monotonic times: how long Abbe was ready to run and did not get a processor, and
        how late anything else was that is this computer's business, s.

    Attributes
    ----------
    violations
        Found so far.
    tally
        How much was judged.
    ending
        Abbe was told to end at this monotonic time; infinite before.
    """

    promises: Promises
    stalled: Callable[[float, float], bool]
    waited: Callable[[float, float], float]
    violations: list[Violation] = field(default_factory=list)
    tally: Tally = field(default_factory=Tally)
    ending: float = math.inf

    def __post_init__(self) -> None:
        self._shown: deque[ShownPicture] = deque()
        self._steps = StepJudge(self.promises, self.tally, self._fail)
        self._beats: dict[int, float] = {}
        self._unfit_since = math.inf
        self._good_temperature = -math.inf
        self._abbe_beat = math.nan
        self._word = 0
        self._written: dict[str, float] = {}

    @property
    def word(self) -> int:
        """The status word that the controller has."""
        return self._word

    # What Abbe was sent

    def sent(self, shown: ShownPicture) -> None:
        """An answer that may be believed went out as a whole."""
        self.tally.pictures += 1
        self._shown.append(shown)
        while self._shown[0].sent < shown.sent - _REMEMBERED:
            self._shown.popleft()
        if "heartbeat" in shown.covers:
            self._beats.setdefault(shown.beat, shown.sent)
            while len(self._beats) > 3000:
                del self._beats[next(iter(self._beats))]
        if "status" in shown.covers:
            if _fit(shown):
                self._unfit_since = math.inf
            else:
                self._unfit_since = min(self._unfit_since, shown.sent)
        if "T_x" in shown.covers and not math.isnan(shown.temperature):
            self._good_temperature = shown.sampled

    def overwritten(self, now: float) -> None:
        """Somebody else wrote into Abbe's registers: their change is not Abbe's."""
        self._abbe_beat = math.nan

    def reborn(self) -> None:
        """Abbe was killed: the next one begins at zero, as a controller that watches it expects."""
        for axis in AXES:
            self._steps.forget(axis)
        self._written.clear()
        self._abbe_beat = math.nan

    # What Abbe wrote

    def taken(self, taken: Taken) -> None:
        """The controller took a message."""
        self.tally.messages += 1
        moment, values = taken.moment, taken.values
        if self.stalled(moment.early - 0.5, moment.late):
            self.tally.not_judged += 1
            self._abbe_beat = values.get("heartbeat", self._abbe_beat)
            self._word = int(values.get("status", self._word))
            for axis in AXES:
                if axis in values:
                    self._steps.forget(axis)
                    self._written.pop(axis, None)
            if "echo" in values:
                self._written.clear()
            return
        sources: dict[str, list[ShownPicture]] = {}
        for axis in AXES:
            if axis in values:
                found = self._sources(axis, values[axis], values.get("echo"), moment)
                if found:
                    sources[axis] = found
                    self._steps.judge(axis, values[axis], found, moment)
        self._written.update(values)
        if "echo" in values:
            self._echo(int(values["echo"]), values.keys(), moment)
            self._written.clear()
        if "status" in values:
            self._judge_word(int(values["status"]), values, sources, moment)

    def _fail(self, moment: Moment, promise: str, text: str) -> None:
        self.violations.append(Violation(moment.early, promise, text))

    def _fresh(self, shown: ShownPicture, moment: Moment) -> bool:
        """Whether a picture was young enough when the message can first have come."""
        p = self.promises
        slack = p.slack + p.blind + self.waited(shown.sampled, moment.late)
        if not shown.frozen and moment.early - shown.sampled > p.stale_after + slack:
            return False
        beat = self._beats.get(shown.beat)
        if beat is None:
            return not shown.frozen
        return moment.early - beat <= p.heartbeat_within + p.stale_after + slack

    def _sources(
        self, axis: str, value: float, echo: float | None, moment: Moment
    ) -> list[ShownPicture]:
        """The pictures that a position can belong to; judges their age and that there is one."""
        p = self.promises
        self.tally.positions += 1
        k = AXES.index(axis)
        reach = p.max_correction + 2.0 * p.resolution
        near = [
            s
            for s in reversed(self._shown)
            if axis in s.covers and abs(value - s.place[k]) <= reach and s.sent <= moment.late
        ]
        if not near:
            self._no_source(axis, value, moment)
            return []
        fit = [s for s in near if _fit(s)]
        if not fit:
            self._fail(
                moment, "position", f"{axis} = {value:.5f} written, shown only while not referenced"
            )
            return []
        fresh = [s for s in fit if self._fresh(s, moment)]
        if not fresh:
            best = max(fit, key=lambda s: (self._beats.get(s.beat, 0.0), s.sampled))
            age = moment.early - best.sampled
            still = moment.early - self._beats.get(best.beat, best.sent)
            self._fail(
                moment,
                "age",
                f"{axis} = {value:.5f} written {age:.3f} s after the machine was there (sample "
                f"{best.number} at {best.place[k]:.5f}, heartbeat first seen {still:.3f} s before"
                f"{', frozen' if best.frozen else ''}); promised {p.stale_after:g} s",
            )
            return []
        if echo is not None:
            named = [s for s in self._shown if s.number == int(echo)]
            if named and abs(value - named[-1].place[k]) <= reach:
                return named[-1:]
            there = f"at {named[-1].place[k]:.5f}" if named else "never shown"
            self._fail(
                moment,
                "position",
                f"{axis} = {value:.5f} with sample {echo:.0f}, which was {there}",
            )
            return []
        return fresh

    def _no_source(self, axis: str, value: float, moment: Moment) -> None:
        k = AXES.index(axis)
        if any(s.mirrored is not None for s in self._shown):
            return
        recent = [s for s in self._shown if axis in s.covers and s.sent <= moment.late]
        if not recent:
            self._fail(moment, "position", f"{axis} = {value:.5f} written, never shown")
            return
        nearest = min(recent, key=lambda s: abs(value - s.place[k]))
        off = value - nearest.place[k]
        poison = any(
            abs(abs(value - s.place[k]) - POISON) <= self.promises.max_correction + 3.0
            for s in list(recent)[-5:]
        )
        self._fail(
            moment,
            "position",
            f"{axis} = {value:.5f} written, {off:+.5f} mm from the nearest position shown (sample "
            f"{nearest.number}, {moment.early - nearest.sampled:.3f} s before)"
            + ("; a foreign answer was believed?" if poison else ""),
        )

    def _echo(self, number: int, judged: Collection[str], moment: Moment) -> None:
        """A sample number belongs to the positions that came before it in other messages, too."""
        named = [s for s in self._shown if s.number == number]
        if not named:
            self._fail(moment, "position", f"sample {number} echoed, which was never shown")
            return
        for axis in AXES:
            value = None if axis in judged else self._written.get(axis)
            place = named[-1].place[AXES.index(axis)]
            if value is not None and abs(value - place) > self.promises.max_correction + 2e-5:
                self._fail(
                    moment,
                    "position",
                    f"sample {number} echoed, which was at {axis} = {place:.5f}; the controller "
                    f"has {value:.5f}",
                )

    def _judge_word(
        self,
        word: int,
        values: dict[str, float],
        sources: dict[str, list[ShownPicture]],
        moment: Moment,
    ) -> None:
        p = self.promises
        self._word = word
        if word == 0 and moment.late >= self.ending:
            return
        if not word & RUNNING:
            self._fail(moment, "status", f"status word 0x{word:04x} without RUNNING")
        beat = values.get("heartbeat")
        if beat is not None:
            if beat == self._abbe_beat:
                self._fail(moment, "status", f"Abbe's heartbeat stands still at {beat:.0f}")
            self._abbe_beat = beat
        slack = p.slack + self.waited(moment.early - p.stale_after, moment.late)
        if not word & COMPENSATING:
            return
        self.tally.compensating += 1
        missing = [a for a in AXES if not word & _ACTIVE[a]]
        if missing:
            self._fail(
                moment, "status", f"COMPENSATING (0x{word:04x}) without {' '.join(missing)}_ACTIVE"
            )
        newest = max((s.sampled for s in self._shown if _fit(s)), default=-math.inf)
        if moment.early - newest > p.stale_after + p.hold + slack:
            self._fail(
                moment,
                "status",
                f"COMPENSATING, and no position came for {moment.early - newest:.3f} s",
            )
        if moment.early - self._unfit_since > p.hold + slack:
            self._fail(moment, "status", "COMPENSATING while the machine is not referenced")
        dumb = moment.early - self._good_temperature
        if dumb > p.signals_stale_after + p.hold + 0.5 + slack:
            self._fail(
                moment, "status", f"COMPENSATING, and X's thermometer sent nothing for {dumb:.2f} s"
            )
        for axis, found in sources.items():
            self._as_modelled(axis, values[axis], found, moment)

    def _as_modelled(
        self, axis: str, value: float, found: list[ShownPicture], moment: Moment
    ) -> None:
        """In full correction what is written is what the model says."""
        p = self.promises
        since = moment.early - p.signals_stale_after - 1.0
        temperatures = [
            s.temperature
            for s in self._shown
            if "T_x" in s.covers and s.sampled >= since and not math.isnan(s.temperature)
        ] or [20.0]
        text = ""
        for shown in found:
            position = shown.place[AXES.index(axis)]
            bounds = [p.error(axis, position, t) for t in (min(temperatures), max(temperatures))]
            got = value - position
            if shown.mirrored or min(bounds) - 1e-3 <= got <= max(bounds) + 1e-3:
                return
            text = f"{1e3 * got:.2f} µm, the model says {1e3 * bounds[0]:.2f} µm"
        self._fail(moment, "status", f"COMPENSATING, and {axis} is corrected by {text}")

    def ended(self, exit_status: int, now: float) -> None:
        """Abbe's process is over at a monotonic time, s, with an exit status."""
        if self._word != 0 and exit_status == 0:
            text = f"exit status 0, and the controller has status 0x{self._word:04x}"
            self._fail(Moment(now, now), "end", text)


def _fit(shown: ShownPicture) -> bool:
    """Whether a machine that shows this of itself may be believed."""
    return bool(shown.status & REFERENCED) and not shown.status & FAULT


def between(stalls: Iterable[tuple[float, float]], early: float, late: float) -> bool:
    """Whether any stall overlaps a time."""
    return any(begin < late and end > early for begin, end in stalls)
