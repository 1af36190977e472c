"""Judgement of steps: how large and how fast the corrections are that the controller has."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from abbe.drivers.simulated.torment.judge.evidence import AXES, ShownPicture
from abbe.drivers.simulated.torment.judge.promises import Promises, Tally
from abbe.drivers.simulated.torment.loop import Moment
from abbe.drivers.simulated.torment.machine import TRUE_TEMPERATURES
from abbe.drivers.simulated.torment.motion import TRAVEL

_BACK = (1, 10, 50)
"""Against which earlier messages a correction's change is judged."""


@dataclass(slots=True)
class _Step:
    """One correction that the controller had, as far as it can be seen, and since when at least.

    `low`, `high` in mm; `since` is when the picture that it is for went out, monotonic, s.
    """

    since: float
    low: float
    high: float


class StepJudge:
    """Judges corrections, each from one message to the next.

    Parameters
    ----------
    promises
        What was promised.
    tally
        Counts what is judged.
    fail
        Called with violations: when, which promise, what was seen.
    """

    def __init__(
        self, promises: Promises, tally: Tally, fail: Callable[[Moment, str, str], None]
    ) -> None:
        self._promises = promises
        self._tally = tally
        self._fail = fail
        self._steps: dict[str, deque[_Step]] = {a: deque(maxlen=max(_BACK)) for a in AXES}

    def forget(self, axis: str) -> None:
        """The next correction of this axis is judged against none before."""
        self._steps[axis].clear()

    def judge(self, axis: str, value: float, sources: list[ShownPicture], moment: Moment) -> None:
        """How fast the correction that the controller has changed."""
        p = self._promises
        k = AXES.index(axis)
        mirrored = [s.mirrored[k] for s in sources if s.mirrored is not None]
        if mirrored:
            self._steps[axis].clear()
            off = value - mirrored[0]
            if abs(off) > 3.0 * p.max_correction:
                self._fail(
                    moment,
                    "position",
                    f"{axis} = {value:.5f} has walked {off:+.3f} mm while the machine stands: it "
                    "follows what was written",
                )
            return
        corrections = [value - s.place[k] for s in sources]
        low, high = min(corrections), max(corrections)
        least = min(corrections, key=abs)
        if abs(least) > p.max_correction + 1.5 * p.resolution:
            self._fail(moment, "step", f"{axis}: a correction of {1e3 * least:.2f} µm")
        elif abs(least) > self._largest(axis):
            self._fail(
                moment,
                "position",
                f"{axis}: a correction of {1e3 * least:.2f} µm, more than the model gives at "
                "any temperature that can be believed",
            )
        steps = self._steps[axis]
        for back in _BACK:
            if len(steps) < back:
                break
            before = steps[-back]
            time = moment.late - before.since
            if back == 1:
                time = min(time, p.stale_after)
            allowed = p.max_rate * time + 2.5 * p.resolution
            change = max(low - before.high, before.low - high, 0.0)
            self._tally.steps += 1
            if change > allowed:
                self._fail(
                    moment,
                    "step",
                    f"{axis}: the correction that the controller has went from "
                    f"{1e3 * before.low:.2f} to {1e3 * low:.2f} µm in "
                    f"{moment.late - before.since:.3f} s; promised at most {1e3 * allowed:.2f} µm",
                )
                break
        steps.append(_Step(min(s.sent for s in sources), low, high))

    def _largest(self, axis: str) -> float:
        """The model's largest error anywhere in the travel at any true temperature, mm."""
        p, ends = self._promises, TRAVEL[AXES.index(axis)]
        errors = [abs(p.error(axis, end, t)) for end in ends for t in TRUE_TEMPERATURES]
        return max(errors) + 2e-3
