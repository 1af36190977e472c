"""What a run knows of its machine by check points, as the status, the screen and metrics ask it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol


@dataclass(frozen=True)
class LiveChecksState:
    """What is known of the machine by its checks.

    Attributes
    ----------
    answer
        As ``abbe check-point --json``; None before anything was judged.
    problem
        Why nothing can be judged; empty where it can, or where there was no check.
    last
        Check point → when it was last recorded, s since 1970.
    refused
        Check point → why its last measurement was not.
    """

    answer: Mapping[str, Any] | None = None
    problem: str = ""
    last: Mapping[str, float] = field(default_factory=dict)
    refused: Mapping[str, str] = field(default_factory=dict)

    @property
    def changed(self) -> bool:
        """Whether the machine has changed since its model was fitted."""
        return self.answer is not None and self.answer["verdict"] == "changed"


class AskedChecks(Protocol):
    """Check points of a run, as far as somebody who only looks asks them."""

    @property
    def wanted(self) -> bool:
        """Whether the configuration has any."""

    @property
    def state(self) -> LiveChecksState:
        """What is known now."""
