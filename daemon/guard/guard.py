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
- A change of what is computed that a person made (`Guard.change`) is no step: what was handed out
  before is let go as a ramp.
- Where rotary axes are corrected, all directions go together: a turn moves the tool's tip, and what
  takes that back is a part of the others. They are held, ramped and cut by one share.

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
from abbe.daemon.guard.limits import Correction, GuardLimits


class Decision(NamedTuple):
    """The guard's decision at one step: the corrections that may be used.

    Attributes
    ----------
    correction
        Correction in X, Y, Z (mm), then of the rotary axes that are corrected (rad): within all
        limits.
    states
        What the guard does with each direction.
    size_limited, rate_limited
        Whether the computed correction was larger, or changed faster, than allowed.
    limited
        Mask of the directions to which that happened.
    """

    correction: Correction
    states: tuple[GuardState, ...]
    size_limited: bool
    rate_limited: bool
    limited: int = 0

    @property
    def compensating(self) -> bool:
        """Whether every direction is corrected in full."""
        full = self.states == _ALL_ACTIVE or self.states.count(_ACTIVE) == len(self.states)
        return full and not (self.size_limited or self.rate_limited)


_ACTIVE = GuardState.ACTIVE
_ALL_ACTIVE = (GuardState.ACTIVE, GuardState.ACTIVE, GuardState.ACTIVE)


_Sent = tuple[float, float]
"""A correction in one direction that the controller may have (mm or rad), and when it was handed
out, s."""
_MayHave = tuple[tuple[_Sent, ...], ...]
"""By direction, what the controller may have in place of what was handed out last."""


class Guard:
    """Bounds and ramps corrections; see the module.

    Parameters
    ----------
    limits
        What is allowed.

    Attributes
    ----------
    every
        Mask of all directions: bit 0 X, 1 Y, 2 Z, then the rotary axes.
    """

    def __init__(self, limits: GuardLimits) -> None:
        self._limits = limits
        self._most, self._rates = limits.most, limits.rates
        count = len(self._most)
        self._together = count > 3
        self.every = (1 << count) - 1
        self._directions = tuple(Direction() for _ in range(count))
        self._full = (GuardState.ACTIVE,) * count
        self._zero: Correction = (0.0,) * count
        self._sure: _MayHave = tuple(() for _ in range(count))
        self._last = math.nan
        # when the controller had what was handed out last, at the latest
        self._taken = -math.inf
        self._computed = self._applied = self._zero
        # what the controller may have in place of `_applied`, by direction
        self._else = self._sure
        self._before: tuple[Correction, float, _MayHave] = self._applied, -math.inf, self._else
        self._too_large_since = [math.inf] * count
        self._steady = False
        self._releasing = False
        # what is still let go of a correction from before a change, and since when
        self._changed = False
        self._let_go, self._let_go_since = self._zero, -math.inf

    def allow(self, limits: GuardLimits) -> None:
        """Change what is allowed, from the next step on.

        A correction that is larger than the new limits is led back to them, no faster than they
        allow.
        """
        self._limits = limits
        self._most, self._rates = limits.most, limits.rates
        self._steady = False

    def release(self) -> None:
        """Begin to end: from the next step on, ramp everything to zero without holding."""
        self._releasing = True

    def change(self) -> None:
        """Take note that from the next step on something else is computed: a person said so.

        The difference to what was computed before is let go within `ramp`.
        """
        self._changed, self._steady = True, False

    @property
    def longest_release(self) -> float:
        """Time after `release` in which steps bring any correction to zero, s."""
        limits = self._limits
        slowest = max(m / r for m, r in zip(self._most, self._rates, strict=True))
        return limits.ramp + slowest + limits.longest_step

    @property
    def released(self) -> bool:
        """Whether, after `release`, the correction has come down to zero in the controller."""
        return self._releasing and self._applied == self._zero and self._else is self._sure

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
        applied, others = list(self._applied), [*self._else]
        applied_before, at_before, else_before = self._before
        for i in range(len(applied)):
            if untouched >> i & 1:
                # it counts from now on: a controller that refuses is given no larger steps later
                applied[i], others[i] = applied_before[i], else_before[i]
            elif unknown >> i & 1:
                others[i] = self._still(else_before[i], (applied_before[i], at_before))
        self._applied = tuple(applied)
        self._else = tuple(others) if any(others) else self._sure
        # the short way asks only where it stands, so what it stands on must be sure
        self._steady = self._steady and not (untouched | unknown)

    def _still(self, sent: tuple[_Sent, ...], one_more: _Sent) -> tuple[_Sent, ...]:
        """What may be held, without what makes no difference: of what is old only the extremes."""
        since = self._last - self._limits.longest_step
        old = sorted(item for item in (*sent, one_more) if item[1] <= since)
        young = tuple(item for item in (*sent, one_more) if item[1] > since)
        return (*old[:1], *old[1:][-1:], *young)

    def step(self, now: float, computed: Correction | None, faulty: int = 0) -> Decision:
        """Take in what was computed and hand out what may be applied.

        Parameters
        ----------
        now
            Monotonic time, s; must not run backwards.
        computed
            The compensator's correction in X, Y, Z (mm) and of the rotary axes (rad) for the
            present position; None when there is none, because a position is missing or the
            compensator failed: then all directions are held.
        faulty
            Mask of directions (bit 0 X, 1 Y, 2 Z, then the rotary axes) whose correction rests on a
            signal that is missing. Their `computed` is taken with the signal's last value.
        """
        limits = self._limits
        elapsed = now - self._last
        dt = min(elapsed, limits.longest_step) if elapsed > 0.0 else 0.0
        self._before = self._applied, self._taken, self._else
        since = now - self._taken
        span = min(since, limits.longest_step) if dt and since > 0.0 else 0.0
        self._last = self._taken = now
        if computed is not None and not math.isfinite(sum(computed)):
            computed = None
        if computed is None or self._releasing or (faulty and self._together):
            faulty = self.every
        if computed is not None:
            if self._changed:
                self._begin_to_let_go(now, computed)
            self._computed = computed
            if self._steady and not faulty and self._allowed(computed, span):
                self._applied = computed
                return Decision(computed, self._full, False, False)
        target, limited, going = self._target(now, dt, faulty)
        self._applied, behind = self._approach(target, now, span)
        self._else = self._sure
        states = tuple(direction.state for direction in self._directions)
        if going:
            states = tuple(
                GuardState.RISING if going >> i & 1 and state is GuardState.ACTIVE else state
                for i, state in enumerate(states)
            )
        self._steady = states == self._full and not limited
        return Decision(self._applied, states, bool(limited), bool(behind), limited | behind)

    def _begin_to_let_go(self, now: float, computed: Correction) -> None:
        """Keep what was computed before, to be let go from `now` on."""
        left = self._left_of_change(now)
        self._let_go = tuple(
            (was + left * still) - is_now
            for was, still, is_now in zip(self._computed, self._let_go, computed, strict=True)
        )
        self._let_go_since, self._changed = now, False

    def _left_of_change(self, now: float) -> float:
        """The part of a change that is not let go yet, 1 to 0."""
        return max(0.0, 1.0 - (now - self._let_go_since) / self._limits.ramp)

    def _target(self, now: float, dt: float, faulty: int) -> tuple[list[float], int, int]:
        """The correction to go to, and the masks of directions in which that is cut, or let go."""
        limits = self._limits
        hold = 0.0 if self._releasing else limits.hold
        limited, too_long = self._too_large(now)
        left = self._left_of_change(now)
        target, going = [0.0] * len(self._most), 0
        for i, direction in enumerate(self._directions):
            if faulty >> i & 1:
                direction.faulty(now, hold, limits.ramp)
            elif too_long >> i & 1:
                direction.faulty(now, 0.0, limits.ramp)
            else:
                direction.sound(dt, limits)
            value = self._computed[i]
            if left and self._let_go[i]:
                value += left * self._let_go[i]
                going |= 1 << i
            target[i] = direction.share * value
        if self._together:
            shrink = min(
                m / abs(v) if abs(v) > m else 1.0 for v, m in zip(target, self._most, strict=True)
            )
        else:
            shrink = 1.0
            target = [
                math.copysign(min(abs(v), m), v) for v, m in zip(target, self._most, strict=True)
            ]
        norm = math.hypot(*target[:3])
        if norm > limits.max_norm:
            shrink = min(shrink, limits.max_norm / norm)
        if shrink < 1.0:
            first = len(target) if self._together else 3
            target[:first] = [shrink * value for value in target[:first]]
        return target, limited, going

    def _too_large(self, now: float) -> tuple[int, int]:
        """Masks of the directions whose computed correction is too large, and for too long."""
        limits, since = self._limits, self._too_large_since
        too_long_together = math.hypot(*self._computed[:3]) > limits.max_norm
        mask = too_long = 0
        for i, value in enumerate(self._computed):
            if abs(value) <= self._most[i] and not (too_long_together and value and i < 3):
                since[i] = math.inf
                continue
            mask |= 1 << i
            since[i] = min(since[i], now)
            if now - since[i] > limits.hold:
                too_long |= 1 << i
        if self._together:
            return (self.every if mask else 0), (self.every if too_long else 0)
        return mask, too_long

    def _allowed(self, wanted: Correction, span: float) -> bool:
        """Whether a full correction needs no limit: by far the most frequent step, so a short way.

        Where it is False the long way decides, and comes to the same where nothing is limited.
        """
        if self._together:
            return math.hypot(*wanted[:3]) <= self._limits.max_norm and all(
                -most <= new <= most and -rate * span <= new - old <= rate * span
                for new, old, most, rate in zip(
                    wanted, self._applied, self._most, self._rates, strict=True
                )
            )
        x, y, z = wanted
        x0, y0, z0 = self._applied
        most_x, most_y, most_z = self._limits.max_correction
        reach = self._limits.max_rate * span
        return (
            -most_x <= x <= most_x
            and -most_y <= y <= most_y
            and -most_z <= z <= most_z
            and -reach <= x - x0 <= reach
            and -reach <= y - y0 <= reach
            and -reach <= z - z0 <= reach
            and math.hypot(x, y, z) <= self._limits.max_norm
        )

    def _approach(self, target: list[float], now: float, span: float) -> tuple[Correction, int]:
        """The correction after a step towards `target`, and the mask of what did not arrive.

        In each direction a step of what may change since it was handed out, from all that the
        controller may have.
        """
        applied = self._applied
        moved = tuple(self._towards(i, end, now, span) for i, end in enumerate(target))
        most = self._limits.max_norm
        longer = math.hypot(*moved[:3]) > most >= math.hypot(*applied[:3])
        if longer or (self._together and moved != tuple(target)):
            # directions that arrive before others may pass through a longer vector, or turn the
            # tool before its tip follows; a step on the straight line between the two never does
            count = len(moved) if self._together else 3
            part = min(
                (m - n) / (t - n)
                for t, n, m in zip(target[:count], applied[:count], moved[:count], strict=True)
                if t != n
            )
            moved = tuple(n + part * (t - n) for t, n in zip(target, applied, strict=True))
        return moved, sum(1 << i for i, value in enumerate(moved) if value != target[i])

    def _towards(self, i: int, end: float, now: float, span: float) -> float:
        """Where a step to `end` may go in one direction, in `span` s.

        To stay is always allowed: what was handed out last was near enough to all the others.
        """
        rate, longest = self._rates[i], self._limits.longest_step
        applied = self._applied[i]
        reach = rate * span
        first, last = applied - reach, applied + reach
        for value, at in self._else[i]:
            reach = rate * min(now - at, longest)
            first, last = max(first, value - reach), min(last, value + reach)
        if first <= end <= last:
            return end + 0.0  # no −0
        return min(max(end, min(first, applied)), max(last, applied))
