"""A step of a calibration, the files between the steps, and a step as it stands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

MODEL, PLAN, PROGRAM, CAMPAIGN = "start.toml", "plan.toml", "program.nc", "campaign.csv"
FITTED, CALIBRATED, TABLES, LIVE = "fitted.toml", "calibrated.toml", "tables", "live.toml"
CHECK_PLAN, CHECK_PROGRAM, CHECK = "check.toml", "check.nc", "check.csv"
VISITS, READINGS, TARGETS = "visits.csv", "readings", "targets.csv"
CHECK_VISITS, CHECK_READINGS, CHECK_TARGETS = (
    "check-visits.csv", "check-readings", "check-targets.csv",
)  # fmt: skip
"""Of instruments that write files: where the machine stood, their files, what to measure."""
CERTIFICATE = "certificate.html"
NOT_VERIFIED = "live-not-verified.toml"
"""In place of `LIVE` where no check has shown that the model holds."""


@dataclass(frozen=True)
class CalibrationStep:
    """One step.

    Attributes
    ----------
    name, title
        Its name in the state, and what it does for people.
    made_from, makes
        Files that it reads, by which it is known to be up to date, and that it writes.
    run
        Does it; what it returns is kept as the outcome.
    settings
        What else it is made by; with others it is done again.
    """

    name: str
    title: str
    made_from: tuple[Path, ...]
    makes: tuple[Path, ...]
    run: Callable[[], str | None]
    settings: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class StepNow:
    """A step as it stands: `at` and `note` of its record where it is done, else empty."""

    step: CalibrationStep
    at: str
    note: str
