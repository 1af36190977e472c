"""The base of all sections of a configuration, and the kinds of values that several have."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from abbe.compcore.errors import InputError

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
