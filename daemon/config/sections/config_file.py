"""A whole configuration file as a user writes it. ``docs/daemon.md`` is the page of its sections.

Lengths are in mm and times in s. Sources and targets are channels, ``"link.channel"``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from abbe.daemon.config.sections.check_points import ChecksSection
from abbe.daemon.config.sections.fleet import FleetSection
from abbe.daemon.config.sections.guard import GuardSection
from abbe.daemon.config.sections.http import HttpSection
from abbe.daemon.config.sections.measure import InstrumentSection, MeasureSection
from abbe.daemon.config.sections.mqtt import MqttSection
from abbe.daemon.config.sections.opcua_server import OpcuaServerSection
from abbe.daemon.config.sections.output import OutputSection
from abbe.daemon.config.sections.probing import ProbingSection
from abbe.daemon.config.sections.readings import (
    AxisSection,
    ControllerSection,
    ReferenceSection,
    SignalSection,
    ToolSection,
)
from abbe.daemon.config.sections.section import Section
from abbe.daemon.config.sections.upload import UploadSection

FORMAT = "abbe-config/1"


class CycleSection(Section):
    """How often the machine is asked."""

    period: Annotated[float, Field(ge=0.0, le=10.0)] = 0.02
    """s from one cycle to the next; 0: as fast as the links answer."""
    signals_every: Annotated[float, Field(ge=0.0, le=600.0)] = 0.25
    """s from one look at the signals (temperatures, …) to the next, and so of folding the model."""


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
    instrument: dict[str, InstrumentSection] = Field(default_factory=dict)
    measure: MeasureSection = MeasureSection()
    probing: ProbingSection | None = None
    control: ControlSection | None = None
    http: HttpSection | None = None
    mqtt: MqttSection | None = None
    opcua_server: OpcuaServerSection | None = None
    fleet: FleetSection | None = None
    upload: UploadSection | None = None
