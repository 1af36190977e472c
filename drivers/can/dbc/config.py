"""The configuration section of a CAN link whose frames are described by a DBC file.

::

    [links.can]
    driver = "can"
    interface = "socketcan"
    channel = "can0"
    dbc = "machine.dbc"
    [links.can.channels.position_x]
    message = "POSITION"
    unit = "mm"
    [links.can.messages.POSITION_Z]
    request = "remote"

``docs/can.md`` is the user's page on each key.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from abbe.drivers.can.interface import InterfaceConfig
from abbe.drivers.scaled import ScaledNumber

_STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class RequestConfig(BaseModel):
    """A frame that asks for another one."""

    model_config = _STRICT

    id: Annotated[int, Field(ge=0, le=0x1FFFFFFF)]
    data: str = ""
    """Bytes in hexadecimal, e.g. ``"40 04 60 00"``."""
    extended: bool = False
    """Whether the id has 29 bits."""

    @field_validator("data")
    @classmethod
    def _is_hexadecimal(cls, data: str) -> str:
        digits = data.replace(" ", "")
        if not re.fullmatch(r"([0-9A-Fa-f]{2}){0,8}", digits):
            raise ValueError(f"data is {data!r}, expected up to eight bytes in hexadecimal")
        return digits


class DbcMessageConfig(BaseModel):
    """One message: what the DBC file does not say of it."""

    model_config = _STRICT

    within: Annotated[float, Field(gt=0)] | None = None
    """s after which a message that did not come again counts as missing; default three of the
    file's cycle times, at least 0.1 s, or 1 s where it says none."""
    request: Literal["remote"] | RequestConfig | None = None
    """Ask for it at each read: by a remote frame, or by another frame."""
    every: Annotated[float, Field(ge=0)] = 0.0
    """With a request: s between two; 0 asks at every call."""


class DbcChannelConfig(ScaledNumber):
    """One value: a signal of a message."""

    model_config = _STRICT

    message: str
    """Its name in the DBC file."""
    signal: str | None = None
    """Its name in the message; default the channel's own."""
    unit: str | None = None
    """For people; default the file's. The scale is on top of the file's own."""
    writable: bool = False
    """Whether Abbe sends the message."""


class DbcConfig(InterfaceConfig):
    """A CAN bus and the signals on it. Times are in s."""

    model_config = _STRICT

    dbc: Annotated[str, Field(min_length=1)]
    """The file; relative to the configuration."""
    late_reply_max: Annotated[float, Field(gt=0)] = 0.5
    """s after a request beyond which its answer cannot come any more."""
    max_waiting: Annotated[int, Field(ge=1)] = 16
    """Calls that may wait for the bus; one more is turned away at once."""
    messages: dict[str, DbcMessageConfig] = Field(default_factory=dict)
    channels: Annotated[dict[str, DbcChannelConfig], Field(min_length=1)]

    @field_validator("dbc")
    @classmethod
    def _beside_the_configuration(cls, dbc: str, info: ValidationInfo) -> str:
        folder = (info.context or {}).get("folder")
        return dbc if folder is None else str(Path(folder) / dbc)
