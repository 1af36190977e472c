"""The guard: what stands between a computed correction and the controller.

A pure state machine: time and inputs are handed in, nothing is read or written, so every promise
below is checked by property tests (``tests/daemon/test_guard.py``) for any sequence of inputs.

- No correction handed out is larger than stated, per direction and in its length.
- From one step to the next it changes no faster than stated, in each direction.
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

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple

Vec3 = tuple[float, float, float]

DIRECTIONS = ("X", "Y", "Z")
"""The three directions of a correction, machine axes."""

ALL = 0b111
"""Mask of all directions: bit 0 is X, bit 1 Y, bit 2 Z."""

ZERO: Vec3 = (0.0, 0.0, 0.0)


class GuardState(enum.Enum):
    """What the guard does with one direction."""

    OFF = "off"
    """No correction: something is missing for longer than hold and ramp, or nothing began yet."""
    RISING = "rising"
    """Sound again; the correction is ramped in."""
    ACTIVE = "active"
    """The computed correction is handed out in full."""
    HOLDING = "holding"
    """Something is missing; the last good correction is held."""
    FALLING = "falling"
    """Missing for longer than the hold time; ramped to zero."""


@dataclass(frozen=True, slots=True)
class GuardLimits:
    """What the guard allows.

    Attributes
    ----------
    max_correction
        Largest correction in X, Y, Z, mm.
    max_norm
        Largest length of the correction vector, mm.
    max_rate
        Fastest change of the correction in each direction, mm/s.
    hold
        How long the last good correction is held, s.
    ramp
        Time in which a full correction is then ramped to zero, and later back in, s.
    longest_step
        Time between two steps that still counts as time for a change, s: after a longer pause
        the correction moves no further than in this time.

    Raises
    ------
    ValueError
        When a limit is not positive and finite, or `max_rate` does not allow `max_correction` to
        be ramped to zero within `ramp`.
    """

    max_correction: Vec3
    max_norm: float
    max_rate: float
    hold: float
    ramp: float
    longest_step: float = 0.2

    def __post_init__(self) -> None:
        named = {
            **{
                f"max_correction {d}": v
                for d, v in zip(DIRECTIONS, self.max_correction, strict=True)
            },
            "max_norm": self.max_norm,
            "max_rate": self.max_rate,
            "ramp": self.ramp,
            "longest_step": self.longest_step,
        }
        for name, value in named.items():
            if not (value > 0.0 and math.isfinite(value)):
                raise ValueError(f"{name} must be a positive number, found {value}")
        if not (self.hold >= 0.0 and math.isfinite(self.hold)):
            raise ValueError(f"hold must be 0 s or more, found {self.hold}")
        needed = max(self.max_correction) / self.ramp
        if self.max_rate < needed * (1.0 - 1e-9):
            raise ValueError(
                f"max_rate = {self.max_rate:g} mm/s cannot ramp the largest correction "
                f"({max(self.max_correction):g} mm) to zero in ramp = {self.ramp:g} s; "
                f"expected at least {needed:g} mm/s"
            )


class Decision(NamedTuple):
    """What the guard hands out at one step.

    Attributes
    ----------
    correction
        Correction in X, Y, Z, mm: within all limits.
    states
        What the guard does with each direction.
    size_limited, rate_limited
        Whether the computed correction was larger, or changed faster, than allowed.
    """

    correction: Vec3
    states: tuple[GuardState, GuardState, GuardState]
    size_limited: bool
    rate_limited: bool

    @property
    def compensating(self) -> bool:
        """Whether every direction is corrected in full."""
        return self.states == _ALL_ACTIVE and not (self.size_limited or self.rate_limited)


_ALL_ACTIVE = (GuardState.ACTIVE, GuardState.ACTIVE, GuardState.ACTIVE)


class _Direction:
    """One direction's share and, while something is missing, since when."""

    __slots__ = ("fault_since", "share", "share_at_fault", "state")

    def __init__(self) -> None:
        self.state = GuardState.OFF
        self.share = 0.0
        self.share_at_fault = 0.0
        self.fault_since = math.nan

    def sound(self, dt: float, limits: GuardLimits) -> None:
        self.fault_since = math.nan
        if self.share < 1.0:
            self.share = min(1.0, self.share + dt / limits.ramp)
        self.state = GuardState.ACTIVE if self.share == 1.0 else GuardState.RISING

    def faulty(self, now: float, hold: float, ramp: float) -> None:
        if self.fault_since != self.fault_since:
            self.fault_since = now
            self.share_at_fault = self.share
        over = now - self.fault_since - hold
        if over > 0.0:
            self.share = max(0.0, min(self.share, self.share_at_fault - over / ramp))
        if self.share == 0.0:
            self.state = GuardState.OFF
        else:
            self.state = GuardState.FALLING if over > 0.0 or hold == 0.0 else GuardState.HOLDING


class Guard:
    """Bounds and ramps corrections; see the module.

    Parameters
    ----------
    limits
        What is allowed.
    """

    def __init__(self, limits: GuardLimits) -> None:
        self._limits = limits
        self._directions = (_Direction(), _Direction(), _Direction())
        self._last = math.nan
        self._held = ZERO
        self._applied = ZERO
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
        """Whether, after `release`, the correction has come down to zero."""
        return self._releasing and self._applied == ZERO

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
        self._last = now
        if computed is not None and not _finite(computed):
            computed = None
        if computed is None or self._releasing:
            faulty = ALL
        if computed is not None:
            self._held = computed
            if self._steady and not faulty and self._allowed(computed, limits.max_rate * dt):
                self._applied = computed
                return Decision(computed, _ALL_ACTIVE, False, False)
        hold = 0.0 if self._releasing else limits.hold
        target = [0.0, 0.0, 0.0]
        size_limited = False
        for i, direction in enumerate(self._directions):
            if faulty >> i & 1:
                direction.faulty(now, hold, limits.ramp)
            else:
                direction.sound(dt, limits)
            value, most = direction.share * self._held[i], limits.max_correction[i]
            if abs(value) > most:
                value, size_limited = math.copysign(most, value), True
            target[i] = value
        norm = math.hypot(*target)
        if norm > limits.max_norm:
            size_limited = True
            shrink = limits.max_norm / norm
            target = [shrink * value for value in target]
        self._applied, rate_limited = self._approach(target, limits.max_rate * dt)
        x, y, z = self._directions
        states = (x.state, y.state, z.state)
        self._steady = states == _ALL_ACTIVE
        return Decision(self._applied, states, size_limited, rate_limited)

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

    def _approach(self, target: list[float], reach: float) -> tuple[Vec3, bool]:
        """The correction after a step towards `target` of at most `reach` mm per direction."""
        now = self._applied
        moved = (
            _towards(now[0], target[0], reach),
            _towards(now[1], target[1], reach),
            _towards(now[2], target[2], reach),
        )
        arrived = moved == tuple(target)
        if not arrived and math.hypot(*moved) > self._limits.max_norm:
            # directions that arrive before others may pass through a longer vector; a step
            # on the straight line between two allowed vectors never does
            part = reach / max(abs(t - n) for t, n in zip(target, now, strict=True))
            x, y, z = (n + part * (t - n) for t, n in zip(target, now, strict=True))
            moved = (x, y, z)
        return moved, not arrived


def _towards(start: float, end: float, reach: float) -> float:
    way = end - start
    return end + 0.0 if abs(way) <= reach else start + math.copysign(reach, way)  # no −0


def _finite(vector: Vec3) -> bool:
    return math.isfinite(vector[0] + vector[1] + vector[2])
