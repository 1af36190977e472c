"""The status of a run: what ``abbe status --json`` prints and the HTTP interface hands out.

Lengths are in mm, rotary axes in degrees, corrections in µm (rotary: µrad), ages in s; a value that
is not known is null, never a number. Field names are a promise: they are added to, not renamed.
"""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)


class CycleStatus(_Part):
    """The cycle: how far it is, how long it takes, how old its positions are."""

    number: int
    """Cycles since the start."""
    running_s: float
    """Time since the start."""
    age_s: float | None
    """Time since the last cycle had its positions; null before the first."""
    period_ms: float
    """As configured; 0: as fast as the links answer."""
    last_ms: float | None
    """The last cycle, from the poll to the write-back."""
    median_ms: float | None
    """Of all cycles since the start."""
    p99_ms: float | None
    """99 % of all cycles were no longer than this."""
    total_s: float
    """All cycles together."""
    within_ms: dict[str, int]
    """Limit in ms → how many cycles were no longer."""
    missed: int
    """Cycles left out because one before took longer than a period."""
    position_age_ms: float | None
    """How old the oldest position can have been when it was about to be written."""


class StatusWord(_Part):
    """Abbe's status word of the last cycle."""

    word: int = Field(ge=0, le=0xFFFF)
    bits: list[str]
    """Names of the bits that are 1."""


class AxisStatus(_Part):
    """One axis: where the controller says it is, where it really is, and how sure that is."""

    unit: Literal["mm", "deg"]
    """Of `indicated`, `corrected`, `reference`."""
    indicated: float | None
    """The last one that was to be believed."""
    corrected: float | None
    """Indicated + correction; null where the axis is not corrected, and while its position is not
    to be believed."""
    stale: bool
    """Whether `indicated` is old: the axis has no sound position."""
    age_s: float | None
    """Age of `indicated`."""
    fault: str
    """Why its position is not to be believed; empty where it is."""
    correction: float | None
    """As handed out by the guard, in `correction_unit`."""
    correction_unit: Literal["um", "urad"]
    uncertainty: float | None
    """± of the correction, k = 2, µm; null where the model has no covariance."""
    guard: Literal["off", "rising", "active", "holding", "falling"] | None
    """What the guard does with it; null where the axis is not corrected."""
    written: bool
    """Whether its corrected position goes to the controller."""
    reference: float | None
    """An independent measurement, where there is one."""


class SignalStatus(_Part):
    """One signal: a temperature, a load, …"""

    value: float | None
    """The last good one, in `unit`; null before the first."""
    unit: str
    temperature: bool
    stale: bool
    """Whether it is not fresh and good; `fault` says why."""
    age_s: float | None
    """Age of `value`."""
    fault: str
    typed_in: bool
    """Whether a person types it in."""


class LinkHealth(_Part):
    """One link to a device."""

    driver: str
    state: Literal["closed", "connecting", "up", "degraded", "down"]
    for_s: float
    """How long it has been in this state."""
    detail: str
    round_trip_ms: float | None
    """Of the last request that was answered."""
    requests: int
    failures: int
    reconnects: int
    quarantined: dict[str, str]
    """Unit → why it is left alone for now."""


class RunningFile(_Part):
    """A file that the run was made from."""

    role: Literal["configuration", "model", "grid"]
    path: str
    sha256: str
    differs: bool
    """Whether the file on disk is not what runs any more."""


class CheckSeries(_Part):
    """One place that is checked in one direction, at the last check."""

    unit: Literal["um", "urad"]
    surprise: float | None
    """What was read beyond what was expected; null where the last check did not read it."""
    uncertainty: float | None
    """± of that, k = 2."""
    full: float
    """How full its fuller chart is: 1 at the limit."""


class CheckStatus(_Part):
    """What check measurements say of the machine."""

    verdict: Literal["unknown", "sound", "changed"]
    checks: int
    """So many count."""
    last: datetime | None
    """The last of them."""
    learning: int
    """Checks that are still missing until it is known how the machine scatters."""
    words: list[str]
    """What they say, in sentences."""
    component: list[str]
    """Of a change: in what."""
    along: list[str]
    """Growing with what."""
    next: str | None
    """The commands that hand the readings to a diagnosis."""
    series: dict[str, CheckSeries]
    refused: dict[str, str]
    """Check point → why its last measurement was not recorded."""
    problem: str
    """Why nothing can be judged."""


class RunOwner(_Part):
    """The process that corrects, and what it holds."""

    user: str
    pid: int
    host: str
    since: datetime
    holds: list[str]
    """What no other Abbe may write to meanwhile."""


class StatusEvent(_Part):
    """One event of the journal."""

    time: datetime
    level: str
    text: str


class RunStatus(_Part):
    """All that a run says of itself at one moment."""

    abbe: str
    """Version."""
    machine: str
    at: datetime
    """When this was asked."""
    state: str
    """The state of the correction in words."""
    in_full: bool
    """Whether every direction is corrected in full, and the controller took it."""
    computed_in_full: bool
    """Whether every direction's correction is handed out in full, written or not."""
    alive: bool
    """Whether the cycle goes round."""
    ending: bool
    """Whether it was asked to end."""
    writes: bool
    """Whether corrected positions are written at all."""
    cycle: CycleStatus
    status_word: StatusWord
    axes: dict[str, AxisStatus]
    signals: dict[str, SignalStatus]
    links: dict[str, LinkHealth]
    faults: dict[str, str]
    """What is wrong → why."""
    beyond: list[str]
    """What lies outside of what was measured."""
    outside: list[str] = []
    """Names of it: axes, signals, ``tool x`` …"""
    checks: CheckStatus | None = None
    """Where check points are configured: whether the model is still true."""
    tool_mm: tuple[float, float, float]
    switches: dict[str, str]
    """Compensation → on, off or shown."""
    files: list[RunningFile]
    owner: RunOwner
    event_counts: dict[str, int]
    """Events since the start, by level."""
    events: list[StatusEvent]
    """The last ones, oldest first."""
