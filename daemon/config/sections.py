"""The sections of a configuration file, as a user writes them. ``docs/daemon.md`` is their page.

Lengths are in mm and times in s. Sources and targets are channels, ``"link.channel"``.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from abbe.compcore.errors import InputError
from abbe.daemon.config.check_points import ChecksSection
from abbe.daemon.config.http import HttpSection
from abbe.daemon.config.upload import UploadSection
from abbe.drivers.transducers import AnyTransducerConfig

FORMAT = "abbe-config/1"

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Length = Annotated[float, Field(gt=0.0, le=10.0, allow_inf_nan=False)]
"""mm; no machine errs by more than a centimetre, and no guard that allows more guards anything."""
Rate = Annotated[float, Field(gt=0.0, le=1000.0, allow_inf_nan=False)]
"""mm/s"""
Turn = Annotated[float, Field(gt=0.0, le=0.3, allow_inf_nan=False)]
"""degrees; no rotary axis is turned by more for the sake of orientation"""
TurnRate = Annotated[float, Field(gt=0.0, le=100.0, allow_inf_nan=False)]
"""degrees/s"""
Seconds = Annotated[float, Field(gt=0.0, le=3600.0, allow_inf_nan=False)]
"""s; an hour is longer than anything that is waited for"""


def _channel(name: str) -> str:
    if not re.fullmatch(r"[^.\s]+\.\S+", name):
        raise InputError("not a channel", found=name, expected='"link.channel"')
    return name


ChannelName = Annotated[str, AfterValidator(_channel)]
"""``link.channel``"""
Word = Annotated[int, Field(ge=0, le=0xFFFF)]


class Section(BaseModel):
    """Base of all sections; unknown keys and wrong types are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class CycleSection(Section):
    """How often the machine is asked."""

    period: Annotated[float, Field(ge=0.0, le=10.0)] = 0.02
    """s from one cycle to the next; 0: as fast as the links answer."""
    signals_every: Annotated[float, Field(ge=0.0, le=600.0)] = 0.25
    """s from one look at the signals (temperatures, …) to the next, and so of folding the model."""


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
    deadband: Length = 0.01
    """Way back from the farthest point that counts as a change of direction, mm (rotary: rad)."""


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


class OutputAxisSection(Section):
    """Where an axis's corrected position goes."""

    target: ChannelName
    transducer: AnyTransducerConfig | None = None
    """mm → counts (rotary: rad or degrees → counts), read backwards; none where the channel takes
    mm (rotary: deg or rad)."""


class EchoSection(Section):
    """A number that is written back as it was read in the same cycle (a sample number)."""

    source: ChannelName
    target: ChannelName


class OutputSection(Section):
    """What is written to the controller. Without this section nothing is."""

    axes: dict[str, OutputAxisSection] = Field(default_factory=dict)
    status: ChannelName | None = None
    """Abbe's status word, `abbe.daemon.status_word`."""
    heartbeat: ChannelName | None = None
    """Counts cycles, from 0 to 65535 or as far as its channel holds, over and over; written after
    everything else."""
    read_back: Annotated[float, Field(ge=0.0, le=600.0)] = 1.0
    """s between two looks at what the controller holds of what was written, where its channels can
    be read: somebody else may write there too. 0: never."""
    echo: Annotated[tuple[EchoSection, ...], Field(strict=False)] = ()
    plus_minus: dict[str, ChannelName] = Field(default_factory=dict)
    """Axis → channel, in mm or um, that receives ± of its correction, k = 2."""
    outside: ChannelName | None = None
    """Channel that receives whether a position, a signal or the tool was never measured:
    `abbe.daemon.pipeline.live_uncertainty.Outside`."""


class PerDirection(Section):
    """A number for each direction, mm."""

    X: Length
    Y: Length
    Z: Length


def _alike(value: object) -> object:
    return value if isinstance(value, dict) else dict.fromkeys("XYZ", value)


class GuardSection(Section):
    """What the guard allows; `abbe.daemon.guard`."""

    max_correction: Annotated[PerDirection, BeforeValidator(_alike)]
    """Largest correction, mm: one number, or one for each of X, Y, Z."""
    max_norm: Length | None = None
    """Largest length of the correction vector, mm; default what `max_correction` allows."""
    max_rate: Rate
    """Fastest change of a correction, mm/s."""
    max_turn: Turn | dict[str, Turn] | None = None
    """Largest correction of a rotary axis, degrees: one number, or one for each of them."""
    max_turn_rate: TurnRate | None = None
    """Fastest change of such a correction, degrees/s."""
    stale_after: Seconds = 0.2
    """s after which a position counts as stale."""
    signals_stale_after: Seconds = 5.0
    """s after which a signal counts as stale."""
    max_lag: Length | None = None
    """How far an axis may have moved while its position was under way (age × measured speed), mm
    (rotary: rad), for it to be used; default: no such limit but `stale_after`."""
    hold: Annotated[float, Field(ge=0.0, le=3600.0)] = 1.0
    """s for which the last good correction is held."""
    ramp: Seconds = 2.0
    """s in which it is then ramped to zero, and later back in."""

    @property
    def vector(self) -> tuple[float, float, float]:
        """Largest correction in X, Y, Z, mm."""
        return self.max_correction.X, self.max_correction.Y, self.max_correction.Z

    def turn(self, axis: str) -> float | None:
        """Largest correction of a rotary axis, degrees; None where it is not stated."""
        return self.max_turn.get(axis) if isinstance(self.max_turn, dict) else self.max_turn

    @property
    def norm(self) -> float:
        """Largest length of the correction vector, mm."""
        return math.hypot(*self.vector) if self.max_norm is None else self.max_norm


class ControlSection(Section):
    """Where a person may switch, type in and set what runs. Without this section nobody can."""

    socket: Annotated[str, Field(min_length=1)] = "control.sock"
    """Path relative to the configuration; only the user who runs the correction may use it."""


class JournalSection(Section):
    """Where events (links lost and found, guard transitions, …) are written."""

    file: str | None = None
    """Path, relative to the configuration (of a service: to its state folder); none: standard error
    only."""
    max_bytes: Annotated[int, Field(ge=10_000)] = 5_000_000
    """The file is put aside (``.1``, ``.2``, …) when it has grown to this."""
    keep: Annotated[int, Field(ge=0, le=100)] = 5
    """How many files put aside are kept."""


class RecordsSection(Section):
    """Where a machine's records are kept: positions, corrections, signals, events."""

    file: Annotated[str, Field(pattern=r"^.+\.sqlite$", max_length=1000)] = "records.sqlite"
    """Path, relative as the journal's; ends in ``.sqlite``."""
    every: Annotated[float, Field(ge=0.1, le=3600.0)] = 1.0
    """s from one cycle that is kept to the next; every change of the status word is kept too."""
    full_days: Annotated[float, Field(ge=0.01, le=36500.0)] = 7.0
    """Days for which every value is kept; then least, mean and greatest of each minute."""
    minute_days: Annotated[float, Field(ge=0.01, le=36500.0)] = 90.0
    """Days for which minutes are kept; then hours."""
    hour_days: Annotated[float, Field(ge=0.01, le=36500.0)] = 3650.0
    """Days for which hours and events are kept."""
    max_bytes: Annotated[int, Field(ge=1_000_000)] = 2_000_000_000
    """Size of the file beyond which the oldest goes."""

    @model_validator(mode="after")
    def _ages_rise(self) -> RecordsSection:
        if not self.full_days <= self.minute_days <= self.hour_days:
            raise ValueError("full_days, minute_days and hour_days must not fall")
        return self


class ConfigFile(Section):
    """A whole configuration file; links are checked by their own classes afterwards."""

    format: Literal["abbe-config/1"]
    model: str
    """Model file, relative to the configuration."""
    links: Annotated[dict[str, dict[str, Any]], Field(min_length=1)]
    axes: dict[str, AxisSection]
    guard: GuardSection
    cycle: CycleSection = CycleSection()
    signals: dict[str, SignalSection] = Field(default_factory=dict)
    reference: dict[str, ReferenceSection] = Field(default_factory=dict)
    tool: ToolSection = ToolSection()
    controller: ControllerSection = ControllerSection()
    output: OutputSection = OutputSection()
    journal: JournalSection = JournalSection()
    records: RecordsSection | None = None
    checks: ChecksSection = ChecksSection()
    control: ControlSection | None = None
    http: HttpSection | None = None
    upload: UploadSection | None = None
