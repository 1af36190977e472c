"""How the uncertainty of a test enters the decision about conformity (ISO 14253-1)."""

from __future__ import annotations

from enum import StrEnum


class DecisionRule(StrEnum):
    """How the uncertainty of the test enters the decision."""

    SIMPLE = "simple"
    """Not at all: the error against the limit itself."""
    ACCEPTANCE = "acceptance"
    """Who proves conformity bears it: the zone is smaller by it (ISO 14253-1)."""
    REJECTION = "rejection"
    """Who proves non-conformity bears it: the zone is larger by it (ISO 14253-1)."""
