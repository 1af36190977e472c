"""The answer of ``abbe iso10360`` as JSON and as text: errors µm, lengths mm."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from abbe.compcore.artefacts.decision_rule import DecisionRule
from abbe.compcore.artefacts.iso10360 import (
    JudgedLength,
    LengthEvaluation,
    LengthTestResult,
    Outcome,
    RepeatabilityResult,
    evaluate_lengths,
)
from abbe.compcore.artefacts.measured_length import MeasuredLength
from abbe.compcore.artefacts.permissible import PermissibleError
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.artefacts.lengths import read_lengths
from abbe.compcore.sentences import said

WORDS: Mapping[DecisionRule, Mapping[Outcome, str]] = {
    DecisionRule.SIMPLE: {
        Outcome.PASSES: "passes",
        Outcome.FAILS: "fails",
        Outcome.AGAIN: "not decided: one value of three is outside; measure it ten times more",
    },
    DecisionRule.ACCEPTANCE: {
        Outcome.PASSES: "conformity is proven",
        Outcome.FAILS: "conformity is not proven",
        Outcome.AGAIN: "not decided: one value of three is outside; measure it ten times more",
    },
    DecisionRule.REJECTION: {
        Outcome.PASSES: "non-conformity is not proven",
        Outcome.FAILS: "non-conformity is proven",
        Outcome.AGAIN: "not decided: one value of three is outside; measure it ten times more",
    },
}
ZONES: Mapping[DecisionRule, str] = {
    DecisionRule.SIMPLE: "the stated limits themselves",
    DecisionRule.ACCEPTANCE: "the stated limits less the uncertainty of the test (ISO 14253-1)",
    DecisionRule.REJECTION: "the stated limits and the uncertainty of the test (ISO 14253-1)",
}


@dataclass(frozen=True)
class LengthAnswer:
    """The evaluation of one or more files."""

    files: tuple[str, ...]
    evaluation: LengthEvaluation

    @property
    def words(self) -> Mapping[Outcome, str]:
        """What an outcome means under the decision rule."""
        return WORDS[self.evaluation.decision]


@dataclass(frozen=True)
class LengthLimits:
    """What is stated of a machine: limits of E0, E150 and R0 (mm), decision rule and factor k."""

    e0: PermissibleError
    e150: PermissibleError | None = None
    repeatability: float | None = None
    decision: DecisionRule = DecisionRule.SIMPLE
    coverage: float = 2.0


def evaluate(
    paths: Sequence[Path],
    limits: LengthLimits,
    *,
    reduced: bool | None = None,
    unit: str | None = None,
) -> LengthAnswer:
    """Read measured lengths and evaluate them by ISO 10360-2.

    Raises
    ------
    InputError
        For a bad file, and for a test whose limit is not stated.
    """
    lengths: list[MeasuredLength] = []
    for path in paths:
        own, _ = read_lengths(path, reduced=reduced, unit=unit)
        if not own:
            raise InputError("no measured length", file=path)
        lengths += own
    stated = {"E0": limits.e0}
    if limits.e150 is not None:
        stated["E150"] = limits.e150
    elif any(m.test == "E150" for m in lengths):
        raise InputError(
            "the limit of E150 is not stated",
            file=paths[0],
            field="mpe-150",
            expected='--mpe-150 "2.5+L/300"; it may be the same as that of E0',
        )
    try:
        evaluation = evaluate_lengths(
            lengths,
            stated,
            repeatability=limits.repeatability,
            decision=limits.decision,
            coverage=limits.coverage,
        )
    except InputError as error:
        raise error.at(file=paths[0]) from None
    return LengthAnswer(tuple(map(str, paths)), evaluation)


def as_json(answer: LengthAnswer) -> dict[str, Any]:
    """One object for ``--json``; what is not known is null."""
    evaluation = answer.evaluation
    return {
        "files": list(answer.files),
        "decision": evaluation.decision.value,
        "coverage_factor": evaluation.coverage,
        "tests": [_test(t, answer.words) for t in evaluation.tests],
        "R0": _repeatability(evaluation.repeatability),
    }


def _test(result: LengthTestResult, words: Mapping[Outcome, str]) -> dict[str, Any]:
    permissible = result.permissible
    return {
        "test": result.test.name,
        "unit": "um",
        "mpe": {
            "A": permissible.constant * 1e3,
            "per_mm": permissible.per_length * 1e3,
            "most": None if math.isinf(permissible.most) else permissible.most * 1e3,
            "text": str(permissible),
        },
        "outcome": result.outcome.value,
        "text": words[result.outcome],
        "worst": _value(result.worst),
        "sets": [
            {
                "position": s.position,
                "length": s.nominal,
                "range": None if s.range is None else s.range * 1e3,
                "outcome": s.outcome.value,
                "values": [_value(j) for j in (*s.repeats, *s.again)],
            }
            for s in result.sets
        ],
        "notes": list(result.notes),
    }


def _value(judged: JudgedLength) -> dict[str, Any]:
    length = judged.length
    return {
        "position": length.position,
        "length": length.calibrated.length,
        "run": length.run,
        "line": length.line,
        "error": length.error * 1e3,
        "mpe": judged.permissible * 1e3,
        "limit": judged.limit * 1e3,
        "sd": length.uncertainty * 1e3,
        "inside": judged.inside,
    }


def _repeatability(found: RepeatabilityResult | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "value": found.value * 1e3,
        "unit": "um",
        "limit": None if found.limit is None else found.limit * 1e3,
        "position": found.at.position,
        "length": found.at.nominal,
        "outcome": None if found.outcome is None else found.outcome.value,
    }


def as_text(answer: LengthAnswer) -> Iterator[str]:
    """Lines for people."""
    for result in answer.evaluation.tests:
        yield f"ISO 10360-2, {result.test.name}: {answer.words[result.outcome]}"
        yield f"  limit {result.permissible}; against {ZONES[answer.evaluation.decision]}"
        positions = len({s.position for s in result.sets})
        yield (
            f"  {len(result.judged)} values of {len(result.sets)} lengths in {positions} "
            f"position{'s' * (positions > 1)}; worst {where(result.worst)}"
        )
        for s in result.sets:
            for j in (*s.repeats, *s.again):
                if not j.inside:
                    yield f"  outside: {where(j)}"
        for note in result.notes:
            yield f"  {note}"
    found = answer.evaluation.repeatability
    if found is not None:
        text = f"R0 {found.value * 1e3:.2f} µm at {found.at.nominal:.6g} mm, {found.at.position}"
        if found.limit is not None and found.outcome is not None:
            text += f"; limit {found.limit * 1e3:g} µm: {WORDS[DecisionRule.SIMPLE][found.outcome]}"
        yield text


def where(judged: JudgedLength) -> str:
    """A value with its place: ``+3.10 µm of ±3.57 at 500 mm, x 1, run 2 (line 14)``."""
    length = judged.length
    limit: str = f"±{judged.permissible * 1e3:.2f}"
    if judged.guard:
        zone = f"±{judged.limit * 1e3:.2f}"
        limit = said("{limit} (zone {zone})", limit=limit, zone=zone)
    words: str = said(
        "{error} µm of {limit} at {length} mm, {place}, run {run}",
        error=f"{length.error * 1e3:+.2f}", limit=limit, length=f"{length.calibrated.length:.6g}",
        place=length.position, run=length.run,
    )  # fmt: skip
    return said("{where} (line {n})", where=words, n=length.line) if length.line else words
