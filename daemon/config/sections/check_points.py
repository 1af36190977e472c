"""The section ``[checks]``: check measurements of the machine. ``docs/check-points.md``."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from abbe.daemon.config.sections.section import ChannelName, Section

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
"""mm, or degrees"""
Place = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)]


class CheckPointSection(Section):
    """One artefact that the controller measures now and then: a sphere, a gauge, a laser line."""

    trigger: ChannelName
    """A number that the controller changes when a measurement is complete; 0 is none."""
    found: Annotated[tuple[ChannelName, ChannelName, ChannelName], Field(strict=False)] | None = (
        None
    )
    """Channels of where a sphere or master point was found: positions of X, Y, Z, mm."""
    nominal: Place | None = None
    """Where it is, mm; default: where it was found first."""
    value: ChannelName | None = None
    """Or the channel of an error, actual − indicated, in um or mm."""
    reference: str | None = None
    """Or the axis whose [reference] is measured, as it stands."""
    u: Annotated[str, Field(pattern=r"^-?[XYZ]$")] | Place | None = None
    """Of `value`: its direction."""
    at: dict[str, Coordinate] = Field(default_factory=dict)
    """Of `value`: axis → where it stood, mm (rotary: degrees); default: where it stands."""
    tool: Place | None = None
    """Tool or probe tip, mm; default: the present one."""
    sd: Annotated[float, Field(gt=0.0, le=1e5, allow_inf_nan=False)] | None = None
    """Standard uncertainty of the reading, µm; default: what the model's fit left over."""
    corrected: bool = False
    """Whether it was measured with corrected positions."""

    @model_validator(mode="after")
    def _one_of_three(self) -> CheckPointSection:
        if sum(x is not None for x in (self.found, self.value, self.reference)) != 1:
            raise ValueError("a check is read as one of found, value, reference")
        if (self.value is None) != (self.u is None):
            raise ValueError("value needs its direction u, and nothing else does")
        if isinstance(self.u, tuple) and not math.hypot(*self.u) > 0.0:
            raise ValueError("u is no direction")
        if self.nominal is not None and self.found is None:
            raise ValueError("nominal goes with found")
        if self.at and self.value is None:
            raise ValueError("at goes with value")
        if self.corrected and self.reference is not None:
            raise ValueError("a reference is compared with the indicated position")
        return self


class ChecksSection(Section):
    """Where check measurements are kept, and how often a sound machine may be accused."""

    file: Annotated[str, Field(pattern=r"^.+\.csv$", max_length=1000)] = "checks.csv"
    """Path, relative as the journal's; ends in ``.csv``."""
    false_alarm_every: Annotated[float, Field(ge=10.0, le=1e6)] = 5000.0
    """Checks in which a sound machine is accused once, at most, on average."""
    look_every: Annotated[float, Field(ge=0.05, le=60.0)] = 1.0
    """s between two looks at the triggers."""
    points: dict[Annotated[str, Field(pattern=r"^[^\s@=,\"]+$", max_length=100)],
                 CheckPointSection] = Field(default_factory=dict)  # fmt: skip
    """What the controller measures."""
