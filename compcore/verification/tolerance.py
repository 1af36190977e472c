"""Stated tolerances, and figures of lines and ranges held against them by ISO 14253-1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from abbe.compcore.artefacts.decision_rule import Conformity, decided
from abbe.compcore.errors import InputError
from abbe.compcore.sentences import joined, said
from abbe.compcore.verification.fitted import FittedPart
from abbe.compcore.verification.line_test import AXIS, LineTest
from abbe.compcore.verification.placed import PlacedFigure

RANGE = "range"
"""The figure of a set-up that is no line: of a ball bar, a sphere, an R-test."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """A stated tolerance of one figure.

    Attributes
    ----------
    figure
        ``A``, ``R``, ``E``, ``M``, ``B``; ``range`` of set-ups that are no lines.
    of
        An axis, a diagonal as ``+X+Y+Z``, ``body`` or ``face``; empty: every axis of its unit. Of a
        range the set-up; empty: every one of its unit.
    limit
        mm, or rad.
    angle
        Whether it is an angle, of rotary axes.
    """

    figure: str
    of: str
    limit: float
    angle: bool = False

    def concerns(self, test: LineTest | PlacedFigure) -> bool:
        """Whether it is stated for a line, or a set-up that is none."""
        if isinstance(test, PlacedFigure):
            alike = self.figure == RANGE and (test.unit == "rad") is self.angle
            return alike and self.of in ("", test.setup)
        if test.rotary != self.angle or self.figure == RANGE:
            return False
        return test.kind == AXIS if not self.of else self.of in (test.name, test.kind)

    def __str__(self) -> str:
        return f"{self.of}.{self.figure}" if self.of else self.figure


@dataclass(frozen=True, slots=True)
class JudgedState:
    """A figure at one time beside its tolerance.

    Attributes
    ----------
    value
        mm or rad; None where the runs do not give it.
    expanded
        U = k·u, mm or rad; None likewise.
    outcome
        What is proven.
    reason
        Why nothing is proven, where that is not the uncertainty; else empty.
    """

    value: float | None
    expanded: float | None
    outcome: Conformity
    reason: str = ""


@dataclass(frozen=True, eq=False)
class JudgedFigure:
    """One figure of a line, or the range of a set-up that is none, beside its tolerance.

    Attributes
    ----------
    test
        The line or the set-up.
    tolerance
        What is stated.
    after, before
        How it stands; `before` None where nobody measured it before.
    """

    test: LineTest | PlacedFigure
    tolerance: Tolerance
    after: JudgedState
    before: JudgedState | None

    @property
    def name(self) -> str:
        """Of the line, for people; of a set-up that is none what it reads."""
        return self.test.what if isinstance(self.test, PlacedFigure) else self.test.name

    @property
    def outcome(self) -> Conformity:
        """What is proven of the state after."""
        return self.after.outcome


def judged_figures(
    lines: Sequence[tuple[LineTest | None, LineTest]],
    placed: Sequence[PlacedFigure],
    tolerances: Sequence[Tolerance],
    coverage: float,
    fitted: Mapping[str, FittedPart],
) -> Iterator[JudgedFigure]:
    """Every line's figures, and every range, against the tolerances that concern it.

    Parameters
    ----------
    lines
        Before, where it was measured, and after.
    coverage
        The factor k of U = k·u.
    fitted
        Set-ups to whose readings the model was fitted prove nothing when they pass.

    Raises
    ------
    InputError
        For a tolerance that concerns neither.
    """
    for tolerance in tolerances:
        concerned = [(b, a) for b, a in lines if tolerance.concerns(a)]
        ranges = [p for p in placed if tolerance.concerns(p)]
        if not concerned and not ranges:
            there = sorted({f"{a.name} ({a.kind})" for _, a in lines})
            there += sorted({f"{p.setup} ({RANGE})" for p in placed})
            raise InputError(
                "no line that was measured has this tolerance, nor any range",
                field="tolerance",
                found=str(tolerance),
                expected="one of " + ", ".join(there) if there else "campaigns with lines",
            )
        for before, after in concerned:
            then = None if before is None else _state(before, tolerance, coverage)
            now = _state(after, tolerance, coverage, fitted.get(after.setup))
            yield JudgedFigure(after, tolerance, now, then)
        for one in ranges:
            u = coverage * one.sd
            first = None if one.before is None else _decided(one.before, u, tolerance)
            now = _decided(one.after, u, tolerance, one.fitted)
            yield JudgedFigure(one, tolerance, now, first)


def _state(
    test: LineTest, tolerance: Tolerance, coverage: float, fitted: FittedPart | None = None
) -> JudgedState:
    value, sd = test.value(tolerance.figure), test.sd(tolerance.figure)
    if value is None or sd is None:
        notes = test.result.notes
        reason = joined(notes) if notes else said("the runs do not give it")
        return JudgedState(None, None, Conformity.NEITHER, reason)
    return _decided(value, coverage * sd, tolerance, fitted)


def _decided(
    value: float, expanded: float, tolerance: Tolerance, fitted: FittedPart | None = None
) -> JudgedState:
    outcome = decided(value, tolerance.limit, expanded)
    if outcome is Conformity.PASSES and fitted is FittedPart.ROWS:
        reason = said("the model was fitted to these readings")
        return JudgedState(value, expanded, Conformity.NEITHER, reason)
    return JudgedState(value, expanded, outcome)
