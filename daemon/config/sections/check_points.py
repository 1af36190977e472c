"""The section ``[checks]``: check measurements of the machine. ``docs/check-points.md``."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from abbe.daemon.config.sections.section import Section


class ChecksSection(Section):
    """Where check measurements are kept, and how often a sound machine may be accused."""

    file: Annotated[str, Field(pattern=r"^.+\.csv$", max_length=1000)] = "checks.csv"
    """Path, relative as the journal's; ends in ``.csv``."""
    false_alarm_every: Annotated[float, Field(ge=10.0, le=1e6)] = 5000.0
    """Checks in which a sound machine is accused once, at most, on average."""
