"""What a page asks of the workbench: strict, so that what is no request is refused."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class AskedOfWorkbench(BaseModel):
    """A request's body; unknown keys and numbers that are none are errors."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Nothing(AskedOfWorkbench):
    """A request that says no more than its path."""
