"""Answers of the HTTP interface that are no part of a run's status."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class _Answer(BaseModel):
    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)


class HttpProblem(_Answer):
    """Why something was not done."""

    detail: str
    """One sentence for people."""


class TypedInValue(_Answer):
    """A value that a person typed in."""

    value: float | None
    """In `unit`; null before the first."""
    unit: str
    age_s: float | None
    fault: str
    """Why it does not count; empty where it does."""


class ChangeableState(_Answer):
    """What can be changed while the correction runs, and what was said of a change."""

    said: str
    """What has changed; empty where nothing has."""
    switches: dict[str, str]
    """Compensation → on, off or shown."""
    in_file: dict[str, str]
    """Compensations that were switched while it runs → what the model file says."""
    until: str
    """Until when what was switched while it runs counts; empty where nothing was."""
    entered: dict[str, TypedInValue]
    """Signals that a person types in."""
    datums: dict[str, str]
    """Axis → what is wrong with its datum; empty where it is set."""
