"""The guard between a computed correction and the controller: bounds, ramps, time limits.

A pure state machine: time and inputs are handed in, nothing is read or written, so every promise
below is checked by property tests (``tests/daemon/guard/test_guard.py``) for any inputs.

- No correction handed out is larger than stated, per direction and in its length.
- From one step to the next it changes no faster than stated, in each direction; counted from what
  the *controller has*: what it did not take was no step, and where nobody knows whether it took a
  value, the next one is near enough to both.
- A computed correction that is larger than allowed is cut; for longer than the hold time it is a
  fault like a missing sensor.
- What is not finite never passes.
- While something that a direction's correction rests on is missing, the last good correction is
  held for a stated time and then ramped to zero in a stated time; other directions go on. When
  it is back, the correction comes back as a ramp.

The states of one direction (``docs/daemon.md`` draws them)::

    OFF ──sound──► RISING ──► ACTIVE ──fault──► HOLDING ──hold over──► FALLING ──► OFF
                     ▲                            │ sound                │ sound
                     └──────── share < 1 ─────────┴──────────────────────┘

Each direction has a *share* between 0 and 1; the correction handed out is share × computed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from abbe.daemon.guard.direction import Direction, GuardState
from abbe.daemon.guard.limits import ALL, ZERO, GuardLimits, Vec3


class Decision(NamedTuple):
    """The guard's decision at one step: the corrections that may be used.

    Attributes
    ----------
    correction
        Correction in X, Y, Z, mm: within all limits.
    states
        What the guard does with each direction.
    size_limited, rate_limited
        Whether the computed correction was larger, or changed faster, than allowed.
    limited
        Mask of the directions to which that happened.
    """

    correction: Vec3
    states: tuple[GuardState, GuardState, GuardState]
    size_limited: bool
    rate_limited: bool
    limited: int = 0

    @property
    def compensating(self) -> bool:
        """Whether every direction is corrected in full."""
        return self.states == _ALL_ACTIVE and not (self.size_limited or self.rate_limited)


_ALL_ACTIVE = (GuardState.ACTIVE, GuardState.ACTIVE, GuardState.ACTIVE)


_Sent = tuple[float, float]
"""A correction in one direction that the controller may have, mm, and when it was handed out, s."""

_SURE: tuple[tuple[_Sent, ...], ...] = ((), (), ())


class Guard:
    """Bounds and ramps corrections; see the module.

    Parameters
    ----------
    limits
        What is allowed.
    """

    def __init__(self, limits: GuardLimits) -> None:
        self._limits = limits
        self._directions = (Direction(), Direction(), Direction())
        self._last = math.nan
        # when the controller had what was handed out last, at the latest
        self._taken = -math.inf
        self._computed = ZERO
        self._applied = ZERO
        # what the controller may have in place of `_applied`, by direction
        self._else = _SURE
        self._before = self._applied, -math.inf, self._else
        self._too_large_since = [math.inf, math.inf, math.inf]
        self._steady = False
        self._releasing = False

    def release(self) -> None:
        """Begin to end: from the next step on, ramp everything to zero without holding."""
        self._releasing = True

    @property
    def longest_release(self) -> float:
        """Time after `release` in which steps bring any correction to zero, s."""
        limits = self._limits
        return limits.ramp + max(limits.max_correction) / limits.max_rate + limits.longest_step

    @property
    def released(self) -> bool:
        """Whether, after `release`, the correction has come down to zero in the controller."""
        return self._releasing and self._applied == ZERO and self._else is _SURE

    def taken(self, by: float) -> None:
        """Take note that what was handed out last was on its way until `by`, monotonic, s.

        A controller that takes it late and the next in time sees the step between the two in less
        time than has passed here; so what may change counts from `by`. Without a call it counts
        from the step.
        """
        self._taken = max(self._taken, by)

    def not_taken(self, untouched: int, unknown: int = 0) -> None:
        """Take note of what the controller did not take of the last step's correction.

        Without a call between two steps, all of it was taken.

        Parameters
        ----------
        untouched
            Mask of the directions that certainly still have the correction of before.
        unknown
            Mask of those of which nobody knows whether they have the new one.
        """
        applied, others = list(self._applied), list(self._else)
        applied_before, at_before, else_before = self._before
        for i in range(3):
            if untouched >> i & 1:
                # it counts from now on: a controller that refuses is given no larger steps later
                applied[i], others[i] = applied_before[i], else_before[i]
            elif unknown >> i & 1:
                others[i] = self._still(else_before[i], (applied_before[i], at_before))
        self._applied = applied[0], applied[1], applied[2]
        self._else = tuple(others) if any(others) else _SURE
        # the short way asks only where it stands, so what it stands on must be sure
        self._steady = self._steady and not (untouched | unknown)

    def _still(self, sent: tuple[_Sent, ...], one_more: _Sent) -> tuple[_Sent, ...]:
        """What may be held, without what makes no difference: of what is old only the extremes."""
        since = self._last - self._limits.longest_step
        old = sorted(item for item in (*sent, one_more) if item[1] <= since)
        young = tuple(item for item in (*sent, one_more) if item[1] > since)
        return (*old[:1], *old[1:][-1:], *young)

    def step(self, now: float, computed: Vec3 | None, faulty: int = 0) -> Decision:
        """Take in what was computed and hand out what may be applied.

        Parameters
        ----------
        now
            Monotonic time, s; must not run backwards.
        computed
            The compensator's correction in X, Y, Z (mm) for the present position; None when there
            is none, because a position is missing or the compensator failed: then all directions
            are held.
        faulty
            Mask of directions (bit 0 X, 1 Y, 2 Z) whose correction rests on a signal that is
            missing. Their `computed` is taken with the signal's last value.
        """
        limits = self._limits
        elapsed = now - self._last
        dt = min(elapsed, limits.longest_step) if elapsed > 0.0 else 0.0
        self._before = self._applied, self._taken, self._else
        since = now - self._taken
        reach = limits.max_rate * min(since, limits.longest_step) if dt and since > 0.0 else 0.0
        self._last = self._taken = now
        if computed is not None and not _finite(computed):
            computed = None
        if computed is None or self._releasing:
            faulty = ALL
        if computed is not None:
            self._computed = computed
            if self._steady and not faulty and self._allowed(computed, reach):
                self._applied = computed
                return Decision(computed, _ALL_ACTIVE, False, False)
        target, limited = self._target(now, dt, faulty)
        self._applied, behind = self._approach(target, now, reach)
        self._else = _SURE
        along_x, along_y, along_z = self._directions
        states = (along_x.state, along_y.state, along_z.state)
        self._steady = states == _ALL_ACTIVE and not limited
        return Decision(self._applied, states, bool(limited), bool(behind), limited | behind)

    def _target(self, now: float, dt: float, faulty: int) -> tuple[list[float], int]:
        """The correction to go to, and the mask of directions in which that is cut."""
        limits = self._limits
        hold = 0.0 if self._releasing else limits.hold
        limited, too_long = self._too_large(now)
        target = [0.0, 0.0, 0.0]
        for i, direction in enumerate(self._directions):
            if faulty >> i & 1:
                direction.faulty(now, hold, limits.ramp)
            elif too_long >> i & 1:
                direction.faulty(now, 0.0, limits.ramp)
            else:
                direction.sound(dt, limits)
            value, most = direction.share * self._computed[i], limits.max_correction[i]
            target[i] = math.copysign(min(abs(value), most), value)
        norm = math.hypot(*target)
        if norm > limits.max_norm:
            shrink = limits.max_norm / norm
            target = [shrink * value for value in target]
        return target, limited

    def _too_large(self, now: float) -> tuple[int, int]:
        """Masks of the directions whose computed correction is too large, and for too long."""
        limits, since = self._limits, self._too_large_since
        together = math.hypot(*self._computed) > limits.max_norm
        mask = too_long = 0
        for i, value in enumerate(self._computed):
            if abs(value) <= limits.max_correction[i] and not (together and value):
                since[i] = math.inf
                continue
            mask |= 1 << i
            since[i] = min(since[i], now)
            if now - since[i] > limits.hold:
                too_long |= 1 << i
        return mask, too_long

    def _allowed(self, wanted: Vec3, reach: float) -> bool:
        """Whether a full correction needs no limit: by far the most frequent step, so a short way.

        Where it is False the long way decides, and comes to the same where nothing is limited.
        """
        x, y, z = wanted
        x0, y0, z0 = self._applied
        most_x, most_y, most_z = self._limits.max_correction
        return (
            -most_x <= x <= most_x
            and -most_y <= y <= most_y
            and -most_z <= z <= most_z
            and -reach <= x - x0 <= reach
            and -reach <= y - y0 <= reach
            and -reach <= z - z0 <= reach
            and math.hypot(x, y, z) <= self._limits.max_norm
        )

    def _approach(self, target: list[float], now: float, reach: float) -> tuple[Vec3, int]:
        """The correction after a step towards `target`, and the mask of what did not arrive.

        In each direction a step of what may change since it was handed out, from all that the
        controller may have.
        """
        applied = self._applied
        moved = tuple(self._towards(i, target[i], now, reach) for i in range(3))
        most = self._limits.max_norm
        if math.hypot(*moved) > most >= math.hypot(*applied):
            # directions that arrive before others may pass through a longer vector; a step
            # on the straight line between two allowed vectors never does
            part = min(
                (m - n) / (t - n) for t, n, m in zip(target, applied, moved, strict=True) if t != n
            )
            moved = tuple(n + part * (t - n) for t, n in zip(target, applied, strict=True))
        x, y, z = moved
        return (x, y, z), sum(1 << i for i in range(3) if moved[i] != target[i])

    def _towards(self, i: int, end: float, now: float, reach: float) -> float:
        """Where a step to `end` may go in one direction, no further than `reach` (mm).

        To stay is always allowed: what was handed out last was near enough to all the others.
        """
        limits = self._limits
        rate, longest = limits.max_rate, limits.longest_step
        applied = self._applied[i]
        first, last = applied - reach, applied + reach
        for value, at in self._else[i]:
            reach = rate * min(now - at, longest)
            first, last = max(first, value - reach), min(last, value + reach)
        if first <= end <= last:
            return end + 0.0  # no −0
        return min(max(end, min(first, applied)), max(last, applied))


def _finite(vector: Vec3) -> bool:
    return math.isfinite(vector[0] + vector[1] + vector[2])
