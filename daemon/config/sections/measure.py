"""The sections ``[instrument.NAME]`` and ``[measure]`` of `abbe measure`. ``docs/measure.md``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from abbe.compcore.campaign.measuring_conditions import STATED
from abbe.daemon.config.sections.section import ChannelName, Positive, Section

Span = Annotated[float, Field(ge=0.0, le=3600.0, allow_inf_nan=False)]
"""s"""


class InstrumentSection(Section):
    """An instrument whose readings follow a plan."""

    source: (
        ChannelName
        | Annotated[tuple[ChannelName, ...], Field(strict=False, min_length=1, max_length=6)]
        | None
    ) = None
    """Channel of its reading; several where a set-up reads several directions, in the plan's order.
    None where it writes a file of its own.
    """
    reads: Literal["length", "error", "distance", "file"]
    """``length``: how far the point has come along the measured direction, from any zero (a laser).
    ``error``: actual − indicated as it stands (straightness, angles, levels, indicators, ball bars,
    R-tests). ``distance``: the distance from the base point (a tracker). ``file``: it cannot be
    linked; the machine is followed, and its readings are matched afterwards."""
    measures: Annotated[tuple[str, ...], Field(strict=False, min_length=1)] | None = None
    """The plan's instruments that it stands for; default: the one of its name."""
    sign: Literal[1, -1] = 1
    """−1 where the reading falls when the point moves along the measured direction."""
    beam: ChannelName | None = None
    """A number that is not 0 while the instrument measures; default: it measures while it has a
    reading."""
    incremental: bool | None = None
    """Whether it counts from wherever it was reset: after a lost beam its zero is another one.
    Default: where it reads a length."""
    stale_after: Annotated[float, Field(gt=0.0, le=60.0)] = 1.0
    """s after which a reading is too old."""
    jump: Positive = 200.0
    """µm or µrad by which two targets' values may differ; more is a new zero."""
    slip: Positive = 20.0
    """µm or µrad by which what a repeated target differs by may change from one target to the next;
    more is a count that was lost."""
    sd: Positive | None = None
    """Standard uncertainty of a reading, µm or µrad; default what the plan counts on."""

    @property
    def sources(self) -> tuple[str, ...]:
        """The channels, one for each direction that is read."""
        return (self.source,) if isinstance(self.source, str) else tuple(self.source or ())

    @property
    def linked(self) -> bool:
        """Whether it is read while the machine is followed."""
        return self.reads != "file"

    @property
    def loses_zero(self) -> bool:
        """Whether its zero is another one after it was interrupted."""
        return self.reads == "length" if self.incremental is None else self.incremental

    @model_validator(mode="after")
    def _source_where_linked(self) -> InstrumentSection:
        if self.linked and self.source is None:
            raise ValueError('no source: the channel of its reading, or reads = "file"')
        if not self.linked and (self.source is not None or self.beam is not None):
            raise ValueError('reads = "file" has neither source nor beam')
        return self

    @model_validator(mode="after")
    def _length_is_incremental(self) -> InstrumentSection:
        if self.reads == "length" and self.incremental is False:
            raise ValueError("a length counts from any zero: incremental cannot be false")
        return self


class MeasureSection(Section):
    """When a machine stands at a target, and when a reading counts."""

    within: Annotated[float, Field(gt=0.0, le=10.0)] = 0.1
    """mm from a target within which the machine is meant to be there."""
    within_turn: Annotated[float, Field(gt=0.0, le=5.0)] = 0.05
    """Of rotary axes, degrees."""
    still: Annotated[float, Field(gt=0.0, le=1.0)] = 0.003
    """mm by which positions may vary while the machine stands."""
    still_turn: Annotated[float, Field(gt=0.0, le=1.0)] = 0.002
    """Of rotary axes, degrees."""
    still_for: Span = 0.5
    """s without motion after which it stands."""
    settle: Span = 1.0
    """s then waited until it has settled."""
    average: Annotated[float, Field(gt=0.0, le=3600.0)] = 1.0
    """s over which readings are averaged."""
    max_drift: Positive = 1.0
    """µm or µrad by which the mean may change from the first to the second half of them."""
    max_spread: Positive | None = None
    """Standard deviation of single readings, µm or µrad, above which they do not count; None: 3, or
    what the instrument is unsure by, where that is more."""
    signals_held: Annotated[float, Field(ge=0.0, le=3600.0)] = 60.0
    """s for which the last value of a signal counts that is not read any more."""
    active: str | None = None
    """The compensation that acts meanwhile, as the model file that it was made from; ``none``."""
    active_turns: list[str] | None = None
    """Rotary axes whose own angle it corrects; none: those for which the controller has tables."""
    conditions: dict[str, Annotated[str, Field(max_length=1000)]] = Field(default_factory=dict)
    """What ISO/TR 16907, 9.1, asks to be written down: operator, serial, environment, …"""

    @field_validator("conditions")
    @classmethod
    def _known(cls, value: dict[str, str]) -> dict[str, str]:
        for key in value:
            if key not in STATED:
                raise ValueError(f"unknown condition {key!r}; there are: {', '.join(STATED)}")
        return value
