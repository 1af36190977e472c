"""Decision rules of ISO 14253-1: the uncertainty of a test in the decision on conformity."""

from __future__ import annotations

from enum import StrEnum


class DecisionRule(StrEnum):
    """A decision rule of ISO 14253-1: simple acceptance, proof of conformity or of the contrary."""

    SIMPLE = "simple"
    """Not at all: the error against the limit itself."""
    ACCEPTANCE = "acceptance"
    """Who proves conformity bears it: the zone is smaller by it (ISO 14253-1)."""
    REJECTION = "rejection"
    """Who proves non-conformity bears it: the zone is larger by it (ISO 14253-1)."""
