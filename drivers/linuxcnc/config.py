"""The configuration section of a LinuxCNC link: pins that are read, axes that are offset.

::

    [links.mill]
    driver = "linuxcnc"
    [links.mill.channels.x]
    pin = "joint.0.pos-fb"
    unit = "mm"
    [links.mill.channels.offset_x]
    offset = "X"
    max = 0.1                     # mm
    [links.mill.channels.state]
    word = "state"

``docs/linuxcnc.md`` is the user's page on each key.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from abbe.drivers.reconnect import ReconnectConfig
from abbe.drivers.scaled import Scale, ScaledNumber

_STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

STATE_BITS = {
    "motion.motion-enabled": 0,
    "motion.is-all-homed": 1,
    "motion.in-position": 2,
    "motion.eoffset-active": 3,
    "motion.eoffset-limited": 4,
}
"""Pin → bit of the state word."""


class LinuxCncChannelConfig(BaseModel):
    """One value: a pin, an axis's external offset, or the state word."""

    model_config = _STRICT

    pin: str | None = None
    """Any pin or signal of HAL, e.g. ``joint.0.motor-pos-cmd``."""
    offset: Literal["X", "Y", "Z", "A", "B", "C", "U", "V", "W"] | None = None
    """Axis whose external offset is written, in mm (degrees); read, it is what is applied."""
    word: Literal["state"] | None = None
    """Bits: 0 machine on, 1 all joints homed, 2 in position, 3 an offset is active, 4 an offset is
    held back by a soft limit."""
    max: Annotated[float, Field(gt=0)] | None = None
    """Largest offset either way, mm (degrees); required for an offset."""
    resolution: Annotated[float, Field(gt=0)] = 1e-5
    """Step of an offset, mm (degrees)."""
    scale: Scale = 1.0
    """For a pin: value = pin · scale."""
    unit: str = ""
    """Unit of a pin's value, for people."""

    @property
    def scaled(self) -> ScaledNumber:
        """How a pin's number becomes the value."""
        return ScaledNumber(scale=self.scale, unit=self.unit)

    @model_validator(mode="after")
    def _consistent(self) -> LinuxCncChannelConfig:
        if [self.pin, self.offset, self.word].count(None) != 2:
            raise ValueError("needs one of pin, offset and word")
        if (self.max is None) != (self.offset is None):
            raise ValueError("max belongs to an offset, and every offset needs it")
        if self.offset is None and "resolution" in self.model_fields_set:
            raise ValueError("resolution: only for an offset")
        if self.pin is None and {"scale", "unit"} & self.model_fields_set:
            raise ValueError("scale and unit: only for a pin")
        if self.max is not None and self.max / self.resolution > 1e9:
            raise ValueError("max is more than 1e9 steps of resolution: LinuxCNC counts in 32 bits")
        return self


class LinuxCncConfig(ReconnectConfig):
    """A LinuxCNC on this computer. Times are in s."""

    model_config = _STRICT

    python: str = "/usr/bin/python3"
    """The Python to which LinuxCNC's modules belong."""
    timeout: Annotated[float, Field(gt=0, le=60)] = 0.5
    """Longest wait for an answer of the bridge process."""
    lease: Annotated[float, Field(gt=0)] = 2.0
    """When no offset is written for so long, all are taken back to zero."""
    ramp: Annotated[float, Field(gt=0)] = 1.0
    """How long taking them back takes."""
    servo_silence: Annotated[float, Field(gt=0)] = 0.5
    """LinuxCNC counts as dead when its servo thread stood still for so long."""
    max_waiting: Annotated[int, Field(ge=1)] = 16
    """Calls that may wait; one more is turned away at once."""

    channels: Annotated[dict[str, LinuxCncChannelConfig], Field(min_length=1)]

    @model_validator(mode="after")
    def _one_channel_for_an_offset(self) -> LinuxCncConfig:
        seen: dict[str, str] = {}
        for name, channel in self.channels.items():
            if channel.offset is not None:
                if channel.offset in seen:
                    raise ValueError(
                        f"channels {seen[channel.offset]!r} and {name!r} are both the offset of "
                        f"axis {channel.offset}"
                    )
                seen[channel.offset] = name
        return self
