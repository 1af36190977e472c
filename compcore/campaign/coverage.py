"""Coverage: what a campaign recorded and varied, so that effects can propose themselves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class SetupCoverage:
    """What one set-up recorded and varied.

    Attributes
    ----------
    kinds
        What its rows measure: ``displacement``, ``rotation``, ``distance``, ``base_distance``.
    rows
        Number of rows.
    duration
        From its first to its last row, s.
    along, across
        Travel of the linear axes along the measured direction, and greatest distance across it
        from the first row, mm.
    free
        What its placing leaves unknown.
    spread
        Dimensions of the space that its measured directions span, 0 … 3.
    toward
        The direction in which it measures, in tenths; empty where it measures in several.
    all_round
        Whether it touches something small from all round: in the order of its points time and
        direction are one.
    """

    kinds: frozenset[str]
    rows: int
    duration: float = 0.0
    along: float = 0.0
    across: float = 0.0
    free: tuple[str, ...] = ()
    spread: int = 0
    toward: tuple[float, ...] = ()
    all_round: bool = False


@dataclass(frozen=True)
class Coverage:
    """What one or more campaigns recorded and varied.

    Attributes
    ----------
    moving
        Axes that stood at more than one position.
    reversing
        Axes with rows from both approach directions.
    signals
        Recorded signals that varied → (least, greatest), in the signal's unit.
    setups
        Set-up names in order of appearance.
    bases
        Base points of distances.
    duration
        From the first to the last row, s (the longest campaign's).
    rotations
        Whether any row measures an angle.
    tool_varies
        Whether more than one tool offset was used.
    setup_details
        Set-up name → what it saw.
    runs
        Number of campaigns with a clock of their own.
    interval
        Time between readings that follow one another, s: a quarter of the time lies between nearer
        ones. A shorter lag cannot be distinguished from none.
    steps
        Axis → the step of the one lattice on which it was read, mm or rad (`even_steps`). A wave
        shorter than two of it is not told from a longer one.
    places
        Axis → at how many places it was read.
    ends
        Axis → the least and the greatest place at which it was read, mm or rad.
    stretch
        From the first to the last row between which no night lies, s (the longest such).
    """

    moving: frozenset[str] = frozenset()
    reversing: frozenset[str] = frozenset()
    signals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    setups: tuple[str, ...] = ()
    bases: tuple[str, ...] = ()
    duration: float = 0.0
    rotations: bool = False
    tool_varies: bool = False
    setup_details: Mapping[str, SetupCoverage] = field(default_factory=dict)
    runs: int = 1
    interval: float = 0.0
    steps: Mapping[str, float] = field(default_factory=dict)
    places: Mapping[str, int] = field(default_factory=dict)
    ends: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    stretch: float = 0.0

    def shows(self, axis: str, numbers: int) -> bool:
        """Whether an axis was read at places enough to see a form with so many numbers.

        Through fewer than twice as many places as it has numbers, a zero counted with them, goes
        any form: what five targets show is a table.
        """
        return self.places.get(axis, 2 * (numbers + 1)) >= 2 * (numbers + 1)

    def span(self, axis: str, unknown: float) -> float:
        """From the least to the greatest place at which an axis was read, mm or rad."""
        low, high = self.ends.get(axis, (0.0, unknown))
        return high - low

    @property
    def levers(self) -> bool:
        """Whether anything shows an angle: an axis or the tool that varied, or measured angles."""
        return bool(self.moving) or self.rotations or self.tool_varies
