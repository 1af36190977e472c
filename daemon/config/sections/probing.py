"""The section ``[probing]``: what `abbe measure` has the machine touch. ``docs/measure.md``.

Lengths in mm, speeds in mm/s.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from abbe.daemon.config.sections.section import Positive, Section

Length = Annotated[float, Field(gt=0.0, le=1000.0)]


class ProbingSection(Section):
    """How the machine touches spheres by itself. Without it Abbe moves no machine."""

    link: Annotated[str, Field(min_length=1)]
    """The link by which the machine is moved."""
    plate: Annotated[str, Field(min_length=1)] | None = None
    """File of the calibrated ball plate, relative to the configuration."""
    gauge: Annotated[str, Field(min_length=1)] | None = None
    """File of the calibrated gauge block or step gauge, relative to the configuration."""
    sphere: Length | None = None
    """Diameter of the sphere on the table."""
    table_radius: Annotated[float, Field(ge=0.0, le=10_000.0)] = 0.0
    """Of the rotary table with what is on it lower than the sphere, for `abbe calibrate`."""
    tool_radius: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    """Of probe and spindle, likewise."""
    tip: Length
    """Diameter of the stylus's ball."""
    shaft: tuple[float, float, float] = Field(default=(0.0, 0.0, 1.0), strict=False)
    """From the tip to the probe, machine axes."""
    points: Annotated[int, Field(ge=5, le=100)] = 9
    """Touches of a sphere."""
    approach: Length = 3.0
    """From the surface, where a touch begins."""
    search: Length = 3.0
    """Beyond where the surface is expected, where a touch ends at the latest."""
    clearance: Length = 50.0
    """From the spheres' middles to the way from one to the next."""
    placing: Length = 5.0
    """By which spheres may lie off the plan before the first ones are found."""
    off: Length = 0.5
    """By which a touch may come too early or too late afterwards."""
    max_form: Positive = 10.0
    """Form deviation above which a sphere does not count, µm."""
    speed: Annotated[float, Field(gt=0.0, le=500.0)] = 50.0
    touch_speed: Annotated[float, Field(gt=0.0, le=50.0)] = 3.0
    missed: Literal["stop", "leave out"] = "stop"
    """What is done where nothing is touched."""
    plate_temperature: str | None = None
    """The signal that is the plate's temperature; none: it counts as 20 °C."""

    @model_validator(mode="after")
    def _something(self) -> ProbingSection:
        if self.plate is None and self.sphere is None and self.gauge is None:
            raise ValueError("nothing to touch: plate, gauge or sphere")
        return self

    @field_validator("shaft")
    @classmethod
    def _not_nothing(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if sum(v * v for v in value) < 1e-6:
            raise ValueError("not a direction")
        return value
