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


class Conformity(StrEnum):
    """What a test proves of a stated limit (ISO 14253-1): that it is kept, or not, or neither."""

    PASSES = "passes"
    FAILS = "fails"
    NEITHER = "neither"


def zone(limit: float, expanded: float, rule: DecisionRule) -> float:
    """The greatest size of an error inside a decision rule's zone, in the unit of the limit.

    Parameters
    ----------
    limit
        What is stated, for the error's size.
    expanded
        U = k·u, the guard band.

    >>> zone(8.0, 1.5, DecisionRule.ACCEPTANCE), zone(8.0, 1.5, DecisionRule.REJECTION)
    (6.5, 9.5)
    """
    if rule is DecisionRule.SIMPLE:
        return limit
    return limit - expanded if rule is DecisionRule.ACCEPTANCE else limit + expanded


def decided(value: float, limit: float, expanded: float) -> Conformity:
    """Whether a size is proven to keep a limit, proven not to, or neither (ISO 14253-1).

    Conformity is proven inside the zone that is smaller by U on both sides, non-conformity outside
    the one that is larger by U.

    >>> [str(decided(v, 8.0, 1.5)) for v in (6.5, 6.51, 9.5, 9.51)]
    ['passes', 'neither', 'neither', 'fails']
    """
    if value <= zone(limit, expanded, DecisionRule.ACCEPTANCE):
        return Conformity.PASSES
    if value > zone(limit, expanded, DecisionRule.REJECTION):
        return Conformity.FAILS
    return Conformity.NEITHER
