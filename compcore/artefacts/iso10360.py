"""E0, E150 and R0 of ISO 10360-2 from measured calibrated lengths, against stated limits.

Five lengths in seven positions, three times each (E0); five lengths in two positions with the tip
150 mm beside the ram's axis (E150). DecisionRule by ISO 14253-1, where asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from abbe.compcore.artefacts.decision_rule import DecisionRule, zone
from abbe.compcore.artefacts.measured_length import MeasuredLength
from abbe.compcore.artefacts.permissible import PermissibleError
from abbe.compcore.errors import InputError
from abbe.compcore.sentences import said

REPEATS = 3
AGAIN = 10
"""How often a length is measured again of which one value of three was outside."""
_LENGTHS = 5
_SAME = 1e-3
"""Calibrated lengths within this are one, mm."""
_LOW_EXPANSION = 2e-6
"""Below this the standard asks for a length of normal expansion besides, 1/K."""


@dataclass(frozen=True, slots=True)
class LengthTest:
    """The requirements of ISO 10360-2:2009 for one test: positions, lengths, repeats.

    Attributes
    ----------
    name, title
        ``E0``; for people.
    positions
        In how many positions five lengths are measured.
    allowances
        In how many of the sets of three repeats one value may lie outside, if ten more do not.
    """

    name: str
    title: str
    positions: int
    allowances: int


TESTS: Mapping[str, LengthTest] = {
    "E0": LengthTest("E0", "length measurement error, tip on the ram's axis", 7, 5),
    "E150": LengthTest("E150", "length measurement error, tip 150 mm beside the ram's axis", 2, 2),
}


class Outcome(StrEnum):
    """The outcome of a set of repeats, or of a test."""

    PASSES = "passes"
    AGAIN = "again"
    """One value of three is outside: to be measured ten times more."""
    FAILS = "fails"


@dataclass(frozen=True, eq=False)
class JudgedLength:
    """One measured length beside its limit.

    Attributes
    ----------
    length
        What was measured.
    permissible
        E_L,MPE at its length, mm.
    guard
        By how much the decision rule moves the limit, mm: k times the uncertainty, or 0.
    limit
        Greatest |error| inside the zone, mm; negative where the guard leaves no zone.
    """

    length: MeasuredLength
    permissible: float
    guard: float
    limit: float

    @property
    def inside(self) -> bool:
        """Whether the error lies in the zone."""
        return abs(self.length.error) <= self.limit

    @property
    def used(self) -> float:
        """The error's size as a part of what is permissible without guard."""
        return abs(self.length.error) / self.permissible


@dataclass(frozen=True, eq=False)
class RepeatSet:
    """The repeats of one length in one position.

    Attributes
    ----------
    position, nominal
        Where; the calibrated length, mm.
    repeats
        The first three.
    again
        What was measured after them.
    """

    position: str
    nominal: float
    repeats: tuple[JudgedLength, ...]
    again: tuple[JudgedLength, ...]

    @property
    def range(self) -> float | None:
        """Greatest less least of three errors, mm; None with fewer than three."""
        errors = [j.length.error for j in self.repeats]
        return max(errors) - min(errors) if len(errors) == REPEATS else None

    @property
    def outside(self) -> int:
        """The number of the first three values that lie outside the zone."""
        return sum(not j.inside for j in self.repeats)

    @property
    def outcome(self) -> Outcome:
        """One value outside may be measured again ten times, all of them inside."""
        if not self.outside:
            return Outcome.PASSES
        if self.outside > 1 or any(not j.inside for j in self.again):
            return Outcome.FAILS
        return Outcome.PASSES if len(self.again) >= AGAIN else Outcome.AGAIN


@dataclass(frozen=True, eq=False)
class LengthTestResult:
    """E0 or E150.

    Attributes
    ----------
    test
        Which.
    permissible
        The stated limit.
    sets
        In the order of the file.
    worst
        The value that uses most of what is permissible.
    outcome
        Of all sets together.
    notes
        What is not as the standard asks for.
    """

    test: LengthTest
    permissible: PermissibleError
    sets: tuple[RepeatSet, ...]
    worst: JudgedLength
    outcome: Outcome
    notes: tuple[str, ...]

    @property
    def judged(self) -> tuple[JudgedLength, ...]:
        """Every value, also those measured again."""
        return tuple(j for s in self.sets for j in (*s.repeats, *s.again))


@dataclass(frozen=True, eq=False)
class RepeatabilityResult:
    """R0: the greatest range of three repeats of a length.

    Attributes
    ----------
    value
        mm.
    at
        Where it is reached.
    limit
        R0,MPL, mm; None where none is stated.
    """

    value: float
    at: RepeatSet
    limit: float | None

    @property
    def outcome(self) -> Outcome | None:
        """Whether it keeps the limit; None where none is stated."""
        if self.limit is None:
            return None
        return Outcome.PASSES if self.value <= self.limit else Outcome.FAILS


@dataclass(frozen=True, eq=False)
class LengthEvaluation:
    """The results of a machine by ISO 10360-2."""

    decision: DecisionRule
    coverage: float
    tests: tuple[LengthTestResult, ...]
    repeatability: RepeatabilityResult | None


def evaluate_lengths(
    lengths: Sequence[MeasuredLength],
    limits: Mapping[str, PermissibleError],
    *,
    repeatability: float | None = None,
    decision: DecisionRule = DecisionRule.SIMPLE,
    coverage: float = 2.0,
) -> LengthEvaluation:
    """Evaluate measured lengths by ISO 10360-2:2009.

    Parameters
    ----------
    lengths
        What was measured.
    limits
        Test → its maximum permissible error.
    repeatability
        R0,MPL, mm.
    decision, coverage
        How the uncertainty enters, and the factor k by which it is multiplied.

    Raises
    ------
    InputError
        For a test without a limit, and for a decision by uncertainties that nobody stated.
    """
    results = []
    for name, test in TESTS.items():
        own = [m for m in lengths if m.test == name]
        if not own:
            continue
        if name not in limits:
            raise InputError("no maximum permissible error is stated", field="mpe", found=name)
        results.append(_test(test, own, limits[name], decision, coverage))
    sets = [s for r in results if r.test.name == "E0" for s in r.sets if s.range is not None]
    found = None
    if sets:
        widest = max(sets, key=lambda s: s.range or 0.0)
        found = RepeatabilityResult(widest.range or 0.0, widest, repeatability)
    return LengthEvaluation(decision, coverage, tuple(results), found)


def _test(
    test: LengthTest,
    lengths: Sequence[MeasuredLength],
    permissible: PermissibleError,
    decision: DecisionRule,
    coverage: float,
) -> LengthTestResult:
    if decision is not DecisionRule.SIMPLE and any(m.uncertainty == 0.0 for m in lengths):
        bare = next(m for m in lengths if m.uncertainty == 0.0)
        raise InputError(
            "a decision by ISO 14253-1 needs the uncertainty of every calibrated length",
            line=bare.line or None,
            field="sd",
            expected="a column sd (µm, k = 1) or expanded (k = 2), or --decision simple",
        )
    judged = [_judged(m, permissible, decision, coverage) for m in lengths]
    by_set: dict[tuple[str, int], list[JudgedLength]] = {}
    for j in judged:
        nominal = round(j.length.calibrated.length / _SAME)
        by_set.setdefault((j.length.position, nominal), []).append(j)
    sets = []
    for (position, _), own in by_set.items():
        own.sort(key=lambda j: j.length.run)
        nominal_length = own[0].length.calibrated.length
        sets.append(RepeatSet(position, nominal_length, tuple(own[:REPEATS]), tuple(own[REPEATS:])))
    return LengthTestResult(
        test,
        permissible,
        tuple(sets),
        max(judged, key=lambda j: j.used),
        _outcome(test, sets),
        tuple(_notes(test, sets)),
    )


def _judged(
    length: MeasuredLength, permissible: PermissibleError, decision: DecisionRule, coverage: float
) -> JudgedLength:
    permitted = permissible.at(length.calibrated.length)
    guard = 0.0 if decision is DecisionRule.SIMPLE else coverage * length.uncertainty
    return JudgedLength(length, permitted, guard, zone(permitted, guard, decision))


def _outcome(test: LengthTest, sets: Sequence[RepeatSet]) -> Outcome:
    outcomes = [s.outcome for s in sets]
    excused = sum(s.outside > 0 for s in sets)
    if Outcome.FAILS in outcomes or excused > test.allowances:
        return Outcome.FAILS
    return Outcome.AGAIN if Outcome.AGAIN in outcomes else Outcome.PASSES


def _notes(test: LengthTest, sets: Sequence[RepeatSet]) -> Iterator[str]:
    positions: dict[str, int] = {}
    for s in sets:
        positions[s.position] = positions.get(s.position, 0) + 1
    if len(positions) < test.positions:
        yield said(
            "{n} positions, the standard asks for {all}", n=len(positions), all=test.positions
        )
    few = [name for name, count in positions.items() if count < _LENGTHS]
    if few:
        yield said("fewer than {n} lengths in {places}", n=_LENGTHS, places=", ".join(few))
    short = sum(len(s.repeats) < REPEATS for s in sets)
    if short:
        yield said(
            "{n} of {all} lengths measured fewer than {times} times",
            n=short, all=len(sets), times=REPEATS,
        )  # fmt: skip
    excused = sum(s.outside == 1 for s in sets)
    if excused:
        yield said(
            "one value of three outside in {n} of {all} sets; the standard allows {allowed}, each "
            "measured {times} times more with no value outside",
            n=excused, all=len(sets), allowed=test.allowances, times=AGAIN,
        )  # fmt: skip
    if any(j.limit <= 0.0 for s in sets for j in s.repeats):
        yield said("the uncertainty is as large as what is permitted: nothing can be proven so")
    expansions = [j.length.calibrated.expansion for s in sets for j in s.repeats]
    if any(0.0 < e < _LOW_EXPANSION for e in expansions):
        yield said(
            "a standard of low expansion: a length of normal expansion (8 to 13 ppm/K) is to be "
            "measured besides"
        )
