"""A line of the journal of uploads: which keys it has, and of which type."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]


class EntryShape(BaseModel):
    """The keys that are read again; others are kept as they are."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True)

    upload: str
    step: str
    outcome: str
    previous: str
    time: str
    old: str
    new: str
    torn: str = ""
    who: str | None = None
    abbe: str | None = None
    active: str | None = None
    backup: str | None = None
    model: dict[str, Any] | None = None
    puts_back: bool = False
    tool_mm: Annotated[list[Finite], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
