"""Requests to a running correction, one JSON object a line, checked at the door."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from abbe.compcore.model.model import Switch

Name = Annotated[str, Field(min_length=1, max_length=300)]
Number = Annotated[float, Field(allow_inf_nan=False, ge=-1e9, le=1e9)]


class _Request(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class StateRequest(_Request):
    """What is switched, typed in and set at present; changes nothing."""

    do: Literal["state"] = "state"


class StatusRequest(_Request):
    """All that the run says of itself; changes nothing."""

    do: Literal["status"] = "status"


class SwitchRequest(_Request):
    """One compensation on, off, or only shown."""

    do: Literal["switch"] = "switch"
    effect: Name
    """Its spec, or as much of its beginning as is unique."""
    to: Switch
    table: Annotated[str, Field(max_length=100)] = ""
    """Name of one of its tables; empty: the whole effect."""


class EnterRequest(_Request):
    """A value that no sensor reads, as a person read it."""

    do: Literal["enter"] = "enter"
    signal: Name
    value: Number
    """In the signal's own unit."""
    seconds: Annotated[float, Field(gt=0.0, le=1e7)] | None = None
    """s for which it counts; default, and at most, what the configuration says."""


class DatumRequest(_Request):
    """Where an axis stands whose encoder does not know."""

    do: Literal["datum"] = "datum"
    axis: Name
    position: Number
    """mm (rotary: degrees)."""


Request = StateRequest | StatusRequest | SwitchRequest | EnterRequest | DatumRequest
REQUEST: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="do")])
"""Checks one request."""

LONGEST = 65_536
"""Bytes of a request."""
LONGEST_ANSWER = 16_000_000
"""Bytes of an answer."""


def changes(request: Request) -> bool:
    """Whether a request asks for a change."""
    return not isinstance(request, StateRequest | StatusRequest)
