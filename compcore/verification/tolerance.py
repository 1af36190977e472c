"""Stated tolerances, and figures of lines held against them by ISO 14253-1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from abbe.compcore.artefacts.decision_rule import Conformity, decided
from abbe.compcore.errors import InputError
from abbe.compcore.verification.fitted import FittedPart
from abbe.compcore.verification.line_test import AXIS, LineTest


@dataclass(frozen=True, slots=True)
class Tolerance:
    """A stated tolerance of one figure.

    Attributes
    ----------
    figure
        ``A``, ``R``, ``E``, ``M`` or ``B``.
    of
        An axis, a diagonal as ``+X+Y+Z``, ``body`` or ``face``; empty: every axis of its unit.
    limit
        mm, or rad.
    angle
        Whether it is an angle, of rotary axes.
    """

    figure: str
    of: str
    limit: float
    angle: bool = False

    def concerns(self, test: LineTest) -> bool:
        """Whether it is stated for a line."""
        if test.rotary != self.angle:
            return False
        return test.kind == AXIS if not self.of else self.of in (test.name, test.kind)

    def __str__(self) -> str:
        return f"{self.of}.{self.figure}" if self.of else self.figure


@dataclass(frozen=True, eq=False)
class JudgedFigure:
    """One figure of a line beside its tolerance.

    Attributes
    ----------
    test
        The line.
    tolerance
        What is stated.
    value
        mm or rad; None where the runs do not give it.
    expanded
        U = k·u, mm or rad; None likewise.
    outcome
        What is proven.
    reason
        Why nothing is proven, where that is not the uncertainty; else empty.
    """

    test: LineTest
    tolerance: Tolerance
    value: float | None
    expanded: float | None
    outcome: Conformity
    reason: str = ""


def judged_figures(
    tests: Sequence[LineTest],
    tolerances: Sequence[Tolerance],
    coverage: float,
    fitted: Mapping[str, FittedPart],
) -> Iterator[JudgedFigure]:
    """Every line's figures against the tolerances that concern it.

    Parameters
    ----------
    coverage
        The factor k of U = k·u.
    fitted
        Set-ups to whose readings the model was fitted prove nothing when they pass.

    Raises
    ------
    InputError
        For a tolerance that concerns no line.
    """
    for tolerance in tolerances:
        concerned = [t for t in tests if tolerance.concerns(t)]
        if not concerned:
            there = sorted({f"{t.name} ({t.kind})" for t in tests})
            raise InputError(
                "no line that was measured has this tolerance",
                field="tolerance",
                found=str(tolerance),
                expected="one of " + ", ".join(there) if there else "campaigns with lines",
            )
        for test in concerned:
            yield _judged(test, tolerance, coverage, fitted.get(test.setup))


def _judged(
    test: LineTest, tolerance: Tolerance, coverage: float, fitted: FittedPart | None
) -> JudgedFigure:
    value, sd = test.value(tolerance.figure), test.sd(tolerance.figure)
    if value is None or sd is None:
        reason = "; ".join(test.result.notes) or "the runs do not give it"
        return JudgedFigure(test, tolerance, None, None, Conformity.NEITHER, reason)
    expanded = coverage * sd
    outcome = decided(value, tolerance.limit, expanded)
    if outcome is Conformity.PASSES and fitted is FittedPart.ROWS:
        reason = "the model was fitted to these readings"
        return JudgedFigure(test, tolerance, value, expanded, Conformity.NEITHER, reason)
    return JudgedFigure(test, tolerance, value, expanded, outcome)
