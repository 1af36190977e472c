"""Encoder counts to mm or rad and back, with counters that wrap around.

A 16- or 32-bit counter that passes its last number starts again at its first. What the
position then is can be known in one of two ways:

- **By the travel.** Where the axis's whole travel (and 5 % beyond each end) spans fewer counts than
  the counter has, each raw number stands for exactly one place on the axis. Nothing is remembered
  and nothing can be lost: gaps and restarts do no harm. Give `travel` whenever this holds; it does
  for nearly every 32-bit counter.
- **By following.** Otherwise the count is unwrapped from sample to sample: the shorter way round
  is taken, which is right as long as the axis moves less than half the range in between. A step
  of more than `max_jump` of the range, or a pause of more than `max_gap`, is not guessed: the
  sample is bad, says why, and so are all that follow until `Encoder.reference` is called, because
  a wrong guess is an error of a whole counter range that nothing later reveals. The first
  sample is taken as the device sends it (no turn before it), or as `reference` says.

64-bit counters do not wrap in any machine's life and are taken as they are.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from abbe.compcore.units import in_digits
from abbe.drivers.link import Quality, Sample
from abbe.drivers.transducers.base import (
    SensorFaultError,
    Transducer,
    TransducerConfig,
    TransducerFault,
    require_number,
)

OVERTRAVEL = 0.05
"""Share of the travel by which an axis may stand beyond either end (limit switches do)."""

_GOOD = Quality.GOOD  # a live cycle looks it up for every axis

EXACT = float(1 << 53)
"""Beyond this a float no longer holds every whole count."""

DEFAULT_GAP = 1.0
"""Longest pause (s) while following, where neither `max_gap` nor `max_speed` is given."""


class EncoderConfig(TransducerConfig):
    """An incremental or absolute encoder behind a counter.

    Attributes
    ----------
    counts_per_mm, counts_per_rev
        Exactly one: counts per mm (a linear axis; positions in mm) or per revolution (a rotary
        axis; positions in rad).
    direction
        +1 where counts rise with the position, −1 where they fall.
    zero
        Count at position 0.
    bits
        Width of the counter.
    signed
        Whether the register is signed; decides which numbers `Encoder.inverse` may write. Both
        readings of the same bits are accepted.
    travel
        Ends of the axis's travel, mm or rad.
    max_jump
        Longest step between two samples that is followed, as a share of the counter's range.
    max_gap
        Longest pause between two samples that is followed, s. Default: as long as
        `max_speed` needs for `max_jump`, else 1 s.
    max_speed
        The axis's fastest motion, mm/s or rad/s.
    """

    type: Literal["encoder"] = "encoder"
    counts_per_mm: float | None = Field(default=None, gt=0)
    counts_per_rev: float | None = Field(default=None, gt=0)
    direction: Literal[1, -1] = 1
    zero: int = 0
    bits: Literal[16, 32, 64] = 32
    signed: bool = True
    travel: Annotated[tuple[float, float], Field(strict=False)] | None = None
    max_jump: float = Field(default=0.25, gt=0, lt=0.5)
    max_gap: float | None = Field(default=None, gt=0)
    max_speed: float | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _valid(self) -> Self:
        if (self.counts_per_mm is None) == (self.counts_per_rev is None):
            raise ValueError("expected exactly one of counts_per_mm and counts_per_rev")
        if self.travel is not None and self.travel[0] >= self.travel[1]:
            raise ValueError(f"travel must rise, found {list(self.travel)}")
        if self.follows and self.max_gap is not None and self.max_speed is not None:
            limit = self._gap_at(self.max_speed)
            if self.max_gap > limit:
                raise ValueError(
                    f"max_gap = {self.max_gap:g} s: at {self.max_speed:g} {self.unit}/s this "
                    f"{self.bits}-bit counter passes max_jump = {self.max_jump:g} of its range in "
                    f"{in_digits(limit)} s; expected at most that"
                )
        return self

    @property
    def unit(self) -> str:
        """Unit of the position."""
        return "mm" if self.counts_per_mm is not None else "rad"

    @property
    def counts_per_unit(self) -> float:
        """Counts per mm or per rad."""
        if self.counts_per_mm is not None:
            return self.counts_per_mm
        return (self.counts_per_rev or 0.0) / math.tau

    @property
    def follows(self) -> bool:
        """Whether the count must be followed: it wraps, and the travel does not tell the turn."""
        if self.bits == 64:
            return False
        if self.travel is None:
            return True
        span = (self.travel[1] - self.travel[0]) * (1.0 + 2.0 * OVERTRAVEL)
        return span * self.counts_per_unit >= float(1 << self.bits)

    @property
    def longest_gap(self) -> float:
        """Longest pause (s) that is followed."""
        if self.max_gap is not None:
            return self.max_gap
        return DEFAULT_GAP if self.max_speed is None else self._gap_at(self.max_speed)

    def _gap_at(self, speed: float) -> float:
        return self.max_jump * float(1 << self.bits) / (speed * self.counts_per_unit)


class Encoder(Transducer):
    """One axis's counter. Stateful only where the count must be followed (see the module)."""

    raw_unit = "count"

    def __init__(self, config: EncoderConfig) -> None:
        self._c = config
        self.unit = config.unit
        self._range = float(1 << config.bits)
        self._lowest, self._highest = -0.5 * self._range, self._range - 1.0
        if config.bits == 64:
            self._lowest, self._highest = -EXACT, EXACT
        self._zero = config.zero
        self._follows = config.follows
        self._turns = config.bits != 64 and config.travel is not None
        self._per_count = config.direction / config.counts_per_unit
        self._low, self._high = -math.inf, math.inf
        self._middle = 0.0
        if config.travel is not None:
            low, high = config.travel
            beyond = OVERTRAVEL * (high - low)
            self._low, self._high = low - beyond, high + beyond
            self._middle = config.zero + 0.5 * (low + high) / self._per_count
        self._longest_step = config.max_jump * self._range
        self._longest_gap = config.longest_gap
        self._count: float | None = None  # unwrapped; None before the first sample
        self._time = math.nan
        self._wanted: float | None = None  # position given by `reference`
        self._lost = ""  # why the count is no longer known

    @property
    def referenced(self) -> bool:
        """False after a step or a pause that could not be followed."""
        return not self._lost

    def reference(self, position: float | None = None) -> None:
        """Start anew with the next sample.

        Parameters
        ----------
        position
            Where the axis is (mm or rad), to better than half the counter's range: the turn that
            puts it nearest is taken. Without it the next sample is taken as the device sends it.
        """
        self._count = None
        self._time = math.nan
        self._wanted = position
        self._lost = ""

    def value(self, raw: float) -> float:
        """Position in mm or rad; see `Transducer.value`. Advances a count that is followed."""
        if not self._lowest <= raw <= self._highest or raw != math.floor(raw):
            self._refuse(raw)
        if self._follows:
            count = self._follow(raw)
        elif self._turns:
            count = raw + self._range * round((self._middle - raw) / self._range)
        else:
            count = raw
        position = (count - self._zero) * self._per_count
        if not self._low <= position <= self._high:
            low, high = self._c.travel or (self._low, self._high)
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE,
                f"{position:.4f} {self.unit}, outside the travel {low:g} to {high:g} {self.unit}",
            )
        return position

    def convert(self, raw: Sample) -> Sample:
        """Convert a sample, and notice pauses too long to follow; see `Transducer.convert`."""
        if raw.quality is not _GOOD:
            return raw
        if self._follows:
            gap = raw.time - self._time  # NaN before the first sample: not a gap
            self._time = raw.time
            if gap > self._longest_gap and not self._lost:
                self._lost = (
                    f"no count for {in_digits(gap)} s, longer than "
                    f"{in_digits(self._longest_gap)} s: the "
                    f"{self._c.bits}-bit counter may have wrapped unseen"
                )
        try:
            return Sample(self.value(raw.value), raw.time)
        except SensorFaultError as fault:
            return Sample(math.nan, raw.time, Quality.BAD, str(fault))

    def inverse(self, value: float) -> float:
        """Whole count for a position (mm or rad), rounded to nearest, for writing back.

        Raises
        ------
        SensorFaultError
            When the count does not fit the register.
        """
        require_number(value)
        c = self._c
        count = round(c.zero + value / self._per_count)
        half = 1 << (c.bits - 1)
        low, high = (-half, half - 1) if c.signed else (0, 2 * half - 1)
        if not low <= count <= high:
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE,
                f"{value:g} {self.unit} is count {count}, outside {low} to {high}",
            )
        return float(count)

    def _refuse(self, raw: float) -> None:
        """Say why a raw number is no count of this counter."""
        require_number(raw)
        if raw != math.floor(raw):
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE,
                f"{raw!r} is not a whole count: is it scaled twice?",
            )
        if self._c.bits == 64:
            raise SensorFaultError(TransducerFault.OUT_OF_RANGE, f"count {raw:.0f} is beyond 2^53")
        raise SensorFaultError(
            TransducerFault.OUT_OF_RANGE, f"count {raw:.0f} does not fit {self._c.bits} bits"
        )

    def _follow(self, raw: float) -> float:
        """Unwrapped count after a raw one, by the shorter way round."""
        if self._lost:
            raise SensorFaultError(TransducerFault.NOT_REFERENCED, self._lost)
        if self._count is None:
            turns = 0
            if self._wanted is not None:
                wanted = self._c.zero + self._wanted / self._per_count
                turns = round((wanted - raw) / self._range)
            self._count = raw + self._range * turns
            self._wanted = None
            return self._count
        step = (raw - self._count + 0.5 * self._range) % self._range - 0.5 * self._range
        if abs(step) > self._longest_step:
            self._lost = (
                f"the count jumped by {step:+.0f}, more than {self._c.max_jump:g} of the "
                f"{self._c.bits}-bit range: the way it went is not known"
            )
            raise SensorFaultError(TransducerFault.COUNT_JUMP, self._lost)
        self._count += step
        return self._count
