"""The sections of what is read: axes, signals, reference, tool, controller."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from abbe.compcore.machine.structure import is_rotary
from abbe.daemon.config.sections.section import (
    ChannelName,
    Finite,
    Length,
    Positive,
    Seconds,
    Section,
    Word,
)
from abbe.drivers.transducers import AnyTransducerConfig

_DEADBAND = 0.01
"""mm or degrees."""


class AxisSection(Section):
    """Where an axis's indicated position comes from."""

    source: ChannelName
    transducer: AnyTransducerConfig | None = None
    """Counts → mm (rotary: rad); none where the channel is in mm (rotary: rad) already."""
    direction: ChannelName | None = None
    """Channel that says in which direction the axis moved last (1, −1, 0); default: it follows
    from the positions."""
    datum: bool = False
    """Whether the encoder is not absolute: nothing is corrected before `abbe datum` has said where
    the axis stands."""
    deadband: Length | None = None
    """Way back from the farthest point that counts as a change of direction, mm (rotary: rad);
    default 0.01 mm or 0.01°."""

    def turns_after(self, axis: str) -> float:
        """The way back that counts as a change of direction of the axis, mm (rotary: rad)."""
        if self.deadband is not None:
            return self.deadband
        return math.radians(_DEADBAND) if is_rotary(axis) else _DEADBAND


class SignalSection(Section):
    """Where a signal of the model (a temperature, a load, …) comes from."""

    source: ChannelName | None = None
    entered_for: Annotated[float, Field(gt=0.0, le=1e7, allow_inf_nan=False)] | None = None
    """In place of `source`: no sensor reads it, a person types it in (`abbe enter`); s for which
    that counts at most."""
    transducer: AnyTransducerConfig | None = None
    """Ohms, mA, … → the signal's unit; none where the channel is in that unit already."""
    minus: str | None = None
    """Axis whose position at the same moment is taken off: of the encoder of a second drive, how
    far it is ahead of the first."""
    range: Annotated[tuple[Finite, Finite], Field(strict=False)] | None = None
    """Least and greatest value that is believed, in the signal's unit; default by its role."""
    max_rate: Positive | None = None
    """Fastest change that is believed, in the signal's unit per s; default by its role."""

    @model_validator(mode="after")
    def _read_or_entered(self) -> SignalSection:
        if (self.source is None) == (self.entered_for is None):
            raise ValueError("a signal is either read (source) or typed in (entered_for)")
        if self.entered_for is not None and (self.transducer or self.max_rate):
            raise ValueError("what a person types in has no transducer and no max_rate")
        return self

    @model_validator(mode="after")
    def _range_rises(self) -> SignalSection:
        if self.range is not None and not self.range[0] < self.range[1]:
            raise ValueError(f"range goes from {self.range[0]:g} to {self.range[1]:g}")
        return self


class ReferenceSection(Section):
    """An independent measurement of where an axis really is: shown and recorded, never used."""

    source: ChannelName
    transducer: AnyTransducerConfig | None = None


class ToolSection(Section):
    """The tool's or probe tip's offset from the functional point with tool length zero, mm."""

    offset: Annotated[tuple[Finite, Finite, Finite], Field(strict=False)] = (0.0, 0.0, 0.0)
    """Where it is fixed."""
    sources: Annotated[tuple[ChannelName, ChannelName, ChannelName], Field(strict=False)] | None = (
        None
    )
    """Channels of x, y, z in mm, where the controller knows it: nothing is corrected before they
    are read."""
    longest: Positive | None = None
    """Farthest that a tool read from `sources` reaches in x, y and z, either way, mm; default the
    longest axis of the machine."""

    @model_validator(mode="after")
    def _one_of_both(self) -> ToolSection:
        if self.sources is not None and "offset" in self.model_fields_set:
            raise ValueError("the tool's offset is either fixed (offset) or read (sources)")
        return self


class ControllerSection(Section):
    """What tells that the controller lives, and that its positions mean something."""

    heartbeat: ChannelName | None = None
    """A number that changes while the controller lives; the positions count as stale when it stands
    still for longer than `heartbeat_within`."""
    heartbeat_within: Seconds = 1.0
    status: ChannelName | None = None
    """Status word."""
    require: Word = 0
    """Bits that must be 1 for positions to be believed (e.g. referenced)."""
    forbid: Word = 0
    """Bits that must be 0 (e.g. fault)."""
    sample: ChannelName | None = None
    """A number that changes with every new sample of the positions: their age counts from then."""
    clock: ChannelName | None = None
    """The controller's own time stamp of the positions: their age counts from then."""
    clock_tick: Seconds = 1.0
    """What `clock` counts, s: 0.001 where it counts milliseconds."""
