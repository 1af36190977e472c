"""The answer of ``abbe verify`` as JSON and as text: errors µm or µrad, lengths mm."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from abbe.compcore.artefacts.decision_rule import Conformity
from abbe.compcore.sentences import as_it_stands, counted, joined, said
from abbe.compcore.units import in_digits, with_uncertainty
from abbe.compcore.verification.budget import CAUSES, FIGURES
from abbe.compcore.verification.foretold import ForetoldLine
from abbe.compcore.verification.lengths import LengthsVerified
from abbe.compcore.verification.line_test import BODY, FACE, LineTest
from abbe.compcore.verification.placed import PlacedFigure
from abbe.compcore.verification.tolerance import JudgedFigure, JudgedState
from abbe.compcore.verification.verdict import check_verdict
from abbe.compcore.verification.verify import Verification, VerifiedLine
from abbe.daemon.answers.measurements import iso10360
from abbe.daemon.answers.measurements.iso230 import display
from abbe.daemon.answers.measurements.verified import VerificationAnswer

WORDS = {
    Conformity.PASSES: said("passes"),
    Conformity.FAILS: said("fails"),
    Conformity.NEITHER: said("neither is proven"),
    None: said("no tolerance is stated"),
}
STATUS = {Conformity.PASSES: 0, Conformity.FAILS: 3, Conformity.NEITHER: 4, None: 0}
"""Outcome → exit status."""


_AGREES = {
    True: said("as foretold"),
    False: said("differs from what is foretold"),
    None: said("not known"),
}
_ROUND_OFF = 1e-6
"""µm or µrad: nothing, but for rounding."""


def outcome_words(found: Verification) -> str:
    """The outcome for people: one that rests on a state that was computed is called so.

    Without a tolerance it is that of what was before and of what was foretold.
    """
    words: str = WORDS[found.outcome]
    if found.outcome is None:
        words = joined([words, check_verdict(found).text])
    if found.measured:
        return words
    return said("{outcome}, as computed, not as measured", outcome=words)


def scaled(value: float | None, factor: float) -> float | None:
    """A number in the unit of people; None stays."""
    return None if value is None or not math.isfinite(value) else value * factor


def as_json(answer: VerificationAnswer) -> dict[str, Any]:
    """One object for ``--json``; what is not known is null."""
    found = answer.verification
    machine = answer.model.machine
    outcome, verdict = found.outcome, check_verdict(found)
    left = found.comparison.lengths
    return {
        "machine": machine.name,
        "serial": machine.serial,
        "structure": str(machine.structure),
        "model": str(answer.named.path),
        "config": None if answer.named.config is None else str(answer.named.config),
        "campaigns": dict(answer.campaign.files),
        "campaigns_before": {} if answer.before is None else dict(answer.before.files),
        "outcome": None if outcome is None else outcome.value,
        "verdict": {"outcome": verdict.outcome.value, "reasons": list(verdict.reasons)},
        "coverage_factor": found.coverage,
        "after": "measured" if found.measured else "computed",
        "before": "measured" if found.before_measured else "put back",
        "warnings": list(answer.warnings()),
        "tolerances": [_judged(f) for f in found.figures],
        "lines": [_line(v, found.coverage) for v in found.lines],
        "placed": [_placed(p, found.coverage) for p in found.placed],
        "E_body": _greatest(found, BODY),
        "E_face": _greatest(found, FACE),
        "lengths": _lengths(answer, found.lengths),
        "lengths_before": _lengths(answer, found.lengths_before),
        "left": {
            "unit": "um",
            "rms": scaled(left.rms, 1e3),
            "max": scaled(left.max, 1e3),
            "chi2_per_dof": scaled(left.chi2_per_dof, 1.0),
            "model_holds": found.comparison.holds,
        },
    }


def _judged(one: JudgedFigure) -> dict[str, Any]:
    unit, factor = judged_unit(one)
    return {
        "tolerance": str(one.tolerance),
        "setup": one.test.setup,
        "line": one.name,
        "figure": one.tolerance.figure,
        "unit": unit.replace("µ", "u"),
        "limit": one.tolerance.limit * factor,
        **_judged_state(one.after, factor),
        "before": None if one.before is None else _judged_state(one.before, factor),
    }


def judged_unit(one: JudgedFigure) -> tuple[str, float]:
    """The unit of a judged figure for people, and what one mm or rad is in it."""
    return ("µrad", 1e6) if one.tolerance.angle else ("µm", 1e3)


def _judged_state(state: JudgedState, factor: float) -> dict[str, Any]:
    return {
        "value": scaled(state.value, factor),
        "U": scaled(state.expanded, factor),
        "outcome": state.outcome.value,
        "reason": state.reason,
    }


def _line(one: VerifiedLine, coverage: float) -> dict[str, Any]:
    unit, factor, position_unit, position_factor = display(one.after.result)
    return {
        "setup": one.after.setup,
        "line": one.after.name,
        "kind": one.after.kind,
        "unit": unit.replace("µ", "u"),
        "length": one.after.length * position_factor,
        "position_unit": {"°": "deg"}.get(position_unit, position_unit),
        "temperature": one.after.temperature,
        "fitted": None if one.fitted is None else one.fitted.value,
        "before": None if one.before is None else _figures(one.before, factor, coverage),
        "after": _figures(one.after, factor, coverage),
        "foretold": None if one.foretold is None else _foretold(one.foretold, factor),
        "notes": list(one.after.result.notes),
    }


def _placed(one: PlacedFigure, coverage: float) -> dict[str, Any]:
    unit, factor = ("urad", 1e6) if one.unit == "rad" else ("um", 1e3)
    return {
        "setup": one.setup,
        "what": one.what,
        "rows": one.rows,
        "unit": unit,
        "fitted": None if one.fitted is None else one.fitted.value,
        "range_before": scaled(one.before, factor),
        "range_after": one.after * factor,
        "U": coverage * one.sd * factor,
        "rms_before": scaled(one.rms_before, factor),
        "rms_after": one.rms_after * factor,
        "left_rms": scaled(one.left, factor),
        "expected_rms": scaled(one.expected, factor),
        "chance": one.chance,
        "agrees": one.agrees,
    }


def placed_rows(found: Verification) -> Iterator[tuple[str, ...]]:
    """Set-ups that are no lines: name, what is read, readings, ranges with U, unit, agreement.

    Then the tolerance and the outcome, where one is stated.
    """
    judged = {f.test.setup: f for f in found.figures if isinstance(f.test, PlacedFigure)}
    for one in found.placed:
        unit, factor = ("µrad", 1e6) if one.unit == "rad" else ("µm", 1e3)
        expanded = max(found.coverage * one.sd * factor, _ROUND_OFF)
        outcome: str = _AGREES[one.agrees]
        if one.fitted is not None:
            outcome = said("{outcome}; fitted ({what})", outcome=outcome, what=str(one.fitted))
        yield (
            one.setup,
            one.what,
            str(one.rows),
            "–" if one.before is None else with_uncertainty(one.before * factor, expanded),
            with_uncertainty(one.after * factor, expanded),
            unit,
            outcome,
            *_tolerance_words(judged.get(one.setup)),
        )


def _tolerance_words(one: JudgedFigure | None) -> tuple[str, str]:
    """A tolerance and what is proven of it; empty where none is stated."""
    if one is None:
        return "", ""
    unit, factor = judged_unit(one)
    return f"{one.tolerance.limit * factor:g} {unit}", WORDS[one.outcome]


def _foretold(told: ForetoldLine, factor: float) -> dict[str, Any]:
    return {
        "figures": {
            name: {"value": said.value * factor, "sd": scaled(said.sd, factor)}
            for name, said in told.figures.items()
        },
        "left_rms": told.left * factor,
        "expected_rms": told.expected * factor,
        "chance": told.chance,
        "agrees": told.agrees,
    }


def _figures(test: LineTest, factor: float, coverage: float) -> dict[str, Any]:
    return {
        name: None
        if (value := test.value(name)) is None
        else {
            "value": value * factor,
            "U": scaled(test.sd(name), coverage * factor),
            "budget": {cause: u * factor for cause, u in test.budgets[name].items()},
        }
        for name in FIGURES
    }


def _greatest(found: Verification, kind: str) -> float | None:
    """ISO 230-6: the greatest systematic error of the diagonals of a kind, after, µm."""
    values = [v.after.value("E") for v in found.lines if v.after.kind == kind]
    return max((v * 1e3 for v in values if v is not None), default=None)


def _lengths(answer: VerificationAnswer, found: LengthsVerified | None) -> dict[str, Any] | None:
    if found is None:
        return None
    files = tuple(answer.campaign.files)
    own = iso10360.as_json(iso10360.LengthAnswer(files, found.evaluation))
    return {"outcome": found.outcome.value, **own}


def as_text(answer: VerificationAnswer, say: Callable[[str], str] = as_it_stands) -> Iterator[str]:
    """Lines for people, in a language: `say` gives a text in it."""
    for part in _parts(answer):
        if isinstance(part, str):
            yield say(part)
        else:
            yield from in_columns([tuple(say(cell) for cell in row) for row in part])


def _parts(answer: VerificationAnswer) -> Iterator[str | list[tuple[str, ...]]]:
    """Lines, and rows of tables."""
    found = answer.verification
    machine = answer.model.machine
    yield said(
        "Verification of {name}, {structure}: {outcome}",
        name=machine.name or said("this machine"), structure=machine.structure,
        outcome=outcome_words(found),
    )  # fmt: skip
    yield said("  after: {after}; before: {before}", after=answer.after_words,
               before=answer.before_words)  # fmt: skip
    for warning in answer.warnings():
        yield said("  WARNING: {what}", what=warning)
    # lengths of gauges have none of these figures
    if found.lines and len(rows := _table(found)) > 1:
        yield rows
    if found.placed:
        yield said(
            "  what other set-ups show but for how they stand (largest range in one direction):"
        )
        stated = any(isinstance(f.test, PlacedFigure) for f in found.figures)
        heads: tuple[str, ...] = (
            said("set-up"), "", said("readings"), said("before"), said("after"), "", "",
            said("tolerance") if stated else "", "",
        )  # fmt: skip
        yield [heads, *placed_rows(found)]
    for judged in found.figures:
        if judged.after.reason:
            where = f"{judged.name} {judged.test.setup}, {judged.tolerance.figure}"
            yield said("  {where}: {why}", where=where, why=judged.after.reason)
    if found.lengths is not None:
        result = found.lengths.evaluation.tests[0]
        yield said(
            "lengths, ISO 10360-2 E0, limit {limit}: {outcome}",
            limit=result.permissible, outcome=WORDS[found.lengths.outcome],
        )  # fmt: skip
        if found.lengths_before is not None:
            yield said("  before: {outcome}", outcome=WORDS[found.lengths_before.outcome])
        worst = iso10360.where(result.worst)
        yield said(
            "  {values}; worst {where}",
            values=counted(len(result.judged), "1 value", "{n} values"), where=worst,
        )  # fmt: skip
        for note in result.notes:
            yield f"  {note}"
    left = found.comparison.summary()
    yield said("measured less foretold, without compensation: {left}", left=left)
    yield said(
        "± is U = {k} u: {causes}; passes where the figure and U keep the tolerance, fails where "
        "the figure less U does not (ISO 14253-1)",
        k=f"{found.coverage:g}", causes=joined(CAUSES, ", "),
    )  # fmt: skip


def _table(found: Verification) -> list[tuple[str, ...]]:
    """Heads, then a row for each figure of each line."""
    heads: tuple[str, ...] = (
        said("line"), "", said("before"), said("foretold"), said("after"), "", said("tolerance"), ""
    )  # fmt: skip
    rows = [heads]
    judged = {(f.test.setup, f.tolerance.figure): f for f in found.figures}
    k = found.coverage
    for one in found.lines:
        unit, factor, _, _ = display(one.after.result)
        stated = [name for name in FIGURES if (one.after.setup, name) in judged]
        usual = ["A" if "A" in one.after.figures else "E"] if found.figures else [*FIGURES]
        for i, figure in enumerate(stated or [n for n in usual if n in one.after.figures]):
            limit = judged.get((one.after.setup, figure))
            rows.append(
                (
                    "" if i else f"{one.after.name}  {one.after.setup}",
                    figure,
                    "–" if one.before is None else figure_with_u(one.before, figure, factor, k),
                    foretold_words(one, figure, factor, k),
                    figure_with_u(one.after, figure, factor, k),
                    unit,
                    *_tolerance_words(limit),
                )
            )
    return rows


def in_columns(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    """Rows of a table as lines, each column as wide as it has to be."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        last = max(i for i, cell in enumerate(row) if cell or not i)
        cells = [as_it_stands(c).padded(w) for c, w in zip(row[:last], widths, strict=False)]
        yield joined(["", *cells, row[last]], "  ")


def figure_with_u(test: LineTest, figure: str, factor: float, coverage: float) -> str:
    """``4.2 ± 1.1``: a figure with U; a dash where it is not known."""
    value, sd = test.value(figure), test.sd(figure)
    if value is None or sd is None:
        return "–"
    return shown_with(value * factor, coverage * sd * factor)


def shown_with(shown: float, expanded: float) -> str:
    """A figure with its U, both in the unit of people; alone where no cause of the budget acts.

    R is scatter, which a budget does not count twice, and reversal error: without this it has no U.
    """
    if expanded < _ROUND_OFF:
        return in_digits(shown if abs(shown) > _ROUND_OFF else 0.0, 3)
    return with_uncertainty(shown, expanded)


def foretold_words(one: VerifiedLine, figure: str, factor: float, coverage: float) -> str:
    """``23.0 ± 1.5``: what the model says of a figure before; empty where it says nothing."""
    found = None if one.foretold is None else one.foretold.figures.get(figure)
    if found is None:
        return ""
    value, expanded = found.value * factor, scaled(found.sd, coverage * factor)
    if max(abs(value), expanded or 0.0) < _ROUND_OFF:
        return "0"
    return with_uncertainty(value, expanded)
