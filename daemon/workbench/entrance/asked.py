"""What a page asks of the workbench: strict, what is no request is refused; and who asks."""

from __future__ import annotations

from typing import Annotated

from fastapi import Request
from pydantic import BaseModel, ConfigDict, Field

BROWSER = "abbe.browser"
"""Key of a request's scope: which of the browsers that have entered sent it, counted from 1."""
PersonName = Annotated[str, Field(max_length=200)]


class AskedOfWorkbench(BaseModel):
    """A request's body; unknown keys and numbers that are none are errors."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Nothing(AskedOfWorkbench):
    """A request that says no more than its path."""


class AskedByPerson(AskedOfWorkbench):
    """A change, with the name that was typed, if one was."""

    by: PersonName = ""


def who_asks(by: str, request: Request) -> str:
    """Who changes something, for the journal: the name, and which browser."""
    browser = f"browser {request.scope.get(BROWSER, 0)}"
    said = " ".join(by.split())
    return f"{said}, {browser}" if said else browser
