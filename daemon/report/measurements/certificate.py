"""The certificate of ``abbe verify``: what is proven, before and after, and how sure it is."""

from __future__ import annotations

from collections.abc import Iterator

from abbe.compcore.artefacts.decision_rule import Conformity
from abbe.compcore.campaign.measuring_conditions import of_files
from abbe.compcore.figures.figure import COLOURS, Figure, Trace, figure
from abbe.compcore.sentences import Sentence, as_it_stands, joined, said
from abbe.compcore.verification.budget import (
    CAUSES,
    EXPANSION,
    FIGURES,
    INSTRUMENT,
    REPEATABILITY,
    SETUP,
    combined,
)
from abbe.compcore.verification.lengths import LengthsVerified
from abbe.compcore.verification.line_test import LineTest
from abbe.compcore.verification.tolerance import JudgedState
from abbe.compcore.verification.verdict import check_verdict
from abbe.compcore.verification.verify import Verification, VerifiedLine
from abbe.daemon.answers.measurements.iso230 import MEANINGS, display
from abbe.daemon.answers.measurements.iso10360 import where
from abbe.daemon.answers.measurements.verified import VerificationAnswer
from abbe.daemon.answers.measurements.verify import (
    WORDS,
    figure_with_u,
    foretold_words,
    judged_unit,
    outcome_words,
    placed_rows,
    shown_with,
)
from abbe.daemon.report.head import FileOnPage, PageHead, facts_of, file_on_page
from abbe.daemon.report.language import PageLanguage
from abbe.daemon.report.page import Page, number, typeset

_BEFORE, _AFTER, _LIMIT = COLOURS[4], COLOURS[0], "#1b1f24"
_LINE, _SETUP, _FIGURE, _UNIT = said("Measured line"), said("Set-up"), said("Figure"), said("Unit")
_CAUSES = {
    INSTRUMENT: said("Instrument"),
    EXPANSION: said("Thermal expansion"),
    REPEATABILITY: said("Repeatability"),
    SETUP: _SETUP,
}
_BEFORE_U, _AFTER_U = said("Before ± U"), said("After ± U")


def certificate(answer: VerificationAnswer, language: PageLanguage | None = None) -> Page:
    """Lay out a verification, in English or another language."""
    found = answer.verification
    machine = answer.model.machine
    page = Page(
        said("Certificate of verification: {machine}", machine=machine.name or said("machine")),
        typeset(said("{structure}; {how}", structure=machine.structure, how=outcome_words(found))),
        _head(answer),
        language,
    )
    page.key_figures(list(_key(found)))
    page.text(
        said(
            "State after: {after}. State before: {before}. Errors are actual minus indicated "
            "(ISO 230-1); errors of indication of lengths are measured minus true (ISO 10360-2).",
            after=answer.after_words,
            before=answer.before_words,
        )
    )
    page.notes(list(map(typeset, answer.warnings())), warning=True)
    if found.figures:
        _judged(page, found)
    if found.lines:
        _figures(page, found)
    if found.placed:
        _placed(page, found)
    if found.lengths is not None:
        _lengths(page, found, found.lengths)
    if any(v.foretold is not None for v in found.lines):
        _foretold(page, found)
    if found.lines:
        _budget(page, found)
    page.section(said("Issued"))
    page.table(
        [said("Place and date"), said("Name"), said("Signature")], [["\u00a0", "\u00a0", "\u00a0"]]
    )
    return page


def _head(answer: VerificationAnswer) -> PageHead:
    files = [file_on_page("model", answer.named.path)]
    if answer.named.config is not None:
        files.append(file_on_page("configuration", answer.named.config))
    if answer.check is not None:
        files.append(file_on_page(said("check plan"), answer.check))
    files += [FileOnPage(said("campaign, after"), f, d) for f, d in answer.campaign.files.items()]
    if answer.before is not None:
        files += [
            FileOnPage(said("campaign, before"), f, d) for f, d in answer.before.files.items()
        ]
    if answer.tables is not None:
        files += [FileOnPage("table", f, d) for f, d in answer.tables.checksums.items()]
    return PageHead(facts_of(of_files(answer.campaign), answer.model.machine), files)


def _key(found: Verification) -> Iterator[tuple[str, str, str]]:
    yield (
        said("outcome") if found.measured else said("outcome, computed"),
        WORDS[found.outcome] if found.outcome else as_it_stands(check_verdict(found).outcome.value),
        "",
    )
    outcomes = [f.outcome for f in found.figures]
    if found.lengths is not None:
        outcomes.append(found.lengths.outcome)
    if outcomes:
        kept = sum(o is Conformity.PASSES for o in outcomes)
        yield (
            said("proven to be kept") if found.measured else said("kept, as computed"),
            said("{n} of {all}", n=kept, all=len(outcomes)),
            said("tolerances"),
        )
    pairs = [(v.before, v.after) for v in found.lines if v.before and not v.after.rotary]
    worst = [
        (max(values), name)
        for name, values in (
            (said("before"), [b.figures.get("E", 0.0) for b, _ in pairs]),
            (said("after"), [a.figures.get("E", 0.0) for _, a in pairs]),
        )
        if values
    ]
    ranges = [p for p in found.placed if p.unit == "mm"]
    if ranges and not pairs:
        for name, sizes in (
            (said("before"), [p.before for p in ranges if p.before is not None]),
            (said("after"), [p.after for p in ranges]),
        ):
            if sizes:
                what = said("greatest range of readings, {state}", state=name)
                yield what, number(max(sizes) * 1e3, 3), "µm"
    if not any(value for value, _ in worst) and not ranges and "mm" in found.left:
        states = (said("before"), said("after"))
        for name, size in zip(states, found.left["mm"], strict=False):
            yield said("all readings, rms, {state}", state=name), number(size * 1e3, 3), "µm"
        return
    for value, name in worst:
        what = said("greatest systematic error E, {state}", state=name)
        yield what, number(value * 1e3, 3), "µm"


def _judged(page: Page, found: Verification) -> None:
    page.section(said("Stated tolerances"))
    rows = []
    for one in found.figures:
        unit, factor = judged_unit(one)
        rows.append(
            [
                one.name,
                one.test.setup,
                one.tolerance.figure,
                f"{one.tolerance.limit * factor:g} {unit}",
                *_judged_state(one.before, factor),
                *_judged_state(one.after, factor),
            ]
        )
    states = [_BEFORE_U, said("Outcome before"), _AFTER_U, said("Outcome")]
    heads = [_LINE, _SETUP, _FIGURE, said("Tolerance"), *states]
    page.table(heads, rows)
    page.text(
        said(
            "Decision rule (ISO 14253-1): guard band U = k·u on either side, k = {k}. A tolerance "
            "is proven to be kept where the figure and U together do not exceed it, proven not to "
            "be kept where the figure less U exceeds it; between the two neither is proven.",
            k=f"{found.coverage:g}",
        )
    )


def _meaning(figure_name: str) -> Sentence:
    return as_it_stands(MEANINGS[figure_name])


def _judged_state(state: JudgedState | None, factor: float) -> tuple[str, str]:
    """A figure with U, and what is proven of it; of what nobody measured nothing."""
    if state is None:
        return "–", said("not measured")
    words = WORDS[state.outcome]
    if state.reason:
        words = said("{outcome} ({why})", outcome=words, why=state.reason)
    if state.value is None or state.expanded is None:
        return "–", words
    shown, expanded = state.value * factor, state.expanded * factor
    return typeset(shown_with(shown, expanded)), words


def _figures(page: Page, found: Verification) -> None:
    page.section(said("Before and after"))
    named = [n for n in FIGURES if n in MEANINGS]
    meanings = joined(said("{figure}: {what}", figure=n, what=_meaning(n)) for n in named)
    page.text(said("{meanings} (ISO 230-2; diagonals 230-6).", meanings=meanings))
    bars = [
        (
            _bars(found, figure_name),
            said(
                "{figure}, {what}; U at the bars' ends.",
                figure=figure_name,
                what=_meaning(figure_name),
            ),
        )
        for figure_name in ("A", "E", "R")
        if any(figure_name in v.after.figures and not v.after.rotary for v in found.lines)
    ]
    page.figures(bars)
    rows = []
    for one in found.lines:
        unit, factor, _, _ = display(one.after.result)
        for name in FIGURES:
            if one.after.value(name) is None:
                continue
            before = one.before
            rows.append(
                [
                    one.after.name,
                    one.after.setup,
                    name,
                    "–" if before is None else _with_u(found, before, name, factor),
                    _with_u(found, one.after, name, factor),
                    unit,
                    "" if one.fitted is None else said("fitted ({what})", what=str(one.fitted)),
                ]
            )
    page.table([_LINE, _SETUP, _FIGURE, _BEFORE_U, _AFTER_U, _UNIT, ""], rows)
    page.notes(
        list(dict.fromkeys(n for v in found.lines for n in _notes(v))),
        warning=True,
    )


def _with_u(found: Verification, test: LineTest, name: str, factor: float) -> str:
    """A figure of a line with its U."""
    return typeset(figure_with_u(test, name, factor, found.coverage))


def _placed(page: Page, found: Verification) -> None:
    page.section(said("Other set-ups, before and after"))
    page.text(
        said(
            "What ball bars, spheres, R-tests, trackers, straightness and angles show but for how "
            "instrument and artefact stand: the range of the readings in one direction, the "
            "largest of all directions (of a ball bar the radial range about the circle that fits "
            "best). U is that of two readings. Whether it is as foretold: by all readings, and "
            "the model's covariance."
        )
    )
    read = (said("Read"), said("Readings"))
    heads = [_SETUP, *read, _BEFORE_U, _AFTER_U, _UNIT, "", said("Tolerance"), ""]
    rows = [list(map(typeset, row)) for row in placed_rows(found)]
    if not any(row[7] for row in rows):
        heads, rows = heads[:7], [row[:7] for row in rows]
    page.table(heads, rows)


def _notes(one: VerifiedLine) -> Iterator[str]:
    for note in one.after.result.notes:
        where = f"{one.after.name}, {one.after.setup}"
        yield said("{where}: {why}", where=where, why=note)


def _bars(found: Verification, name: str) -> Figure:
    """A figure of every line before and after, with U, and the tolerance where one is stated."""
    lines = [v for v in found.lines if not v.after.rotary and v.after.value(name) is not None]
    labels = [f"{v.after.name}<br>{v.after.setup}" for v in lines]
    at = list(range(len(lines)))
    traces: list[Trace] = []
    for title, colour, tests in (
        (said("before"), _BEFORE, [v.before for v in lines]),
        (said("after"), _AFTER, [v.after for v in lines]),
    ):
        values = [None if t is None else t.value(name) for t in tests]
        spread = [None if t is None else t.sd(name) for t in tests]
        traces.append(
            {
                "type": "bar",
                "x": at,
                "y": [None if v is None else v * 1e3 for v in values],
                "name": title,
                "marker": {"color": colour},
                "error_y": {
                    "type": "data",
                    "array": [0.0 if s is None else found.coverage * s * 1e3 for s in spread],
                    "color": "#57606a",
                    "thickness": 1,
                },
            }
        )
    x: list[float | None] = []
    y: list[float | None] = []
    stated = {f.test.setup: f.tolerance.limit for f in found.figures if f.tolerance.figure == name}
    for i, v in enumerate(lines):
        if v.after.setup in stated:
            level = stated[v.after.setup] * 1e3
            x += [i - 0.45, i + 0.45, None]
            y += [level, level, None]
    if x:
        style = {"color": _LIMIT, "width": 2, "dash": "dash"}
        traces.append({"type": "scatter", "mode": "lines", "x": x, "y": y,
                       "name": said("tolerance"), "line": style})  # fmt: skip
    return figure(
        traces,
        "",
        said("{figure} in µm", figure=name),
        height=360,
        xaxis={"tickvals": at, "ticktext": labels, "showgrid": False,
               "range": [-0.6, len(lines) - 0.4]},
        yaxis={"rangemode": "tozero"},
    )  # fmt: skip


def _lengths(page: Page, found: Verification, lengths: LengthsVerified) -> None:
    result = lengths.evaluation.tests[0]
    page.section(said("Lengths, ISO 10360-2 E0: {outcome}", outcome=WORDS[lengths.outcome]))
    page.text(said("Limit {limit}, L in mm.", limit=str(result.permissible).partition(",")[0]))
    states = [(said("before"), found.lengths_before), (said("after"), lengths)]
    page.table(
        [said("State"), said("Outcome"), said("Values"), said("Worst of all")],
        [
            [name, said("not measured"), "–", "–"]
            if one is None
            else [
                name,
                WORDS[one.outcome],
                str(len(one.evaluation.tests[0].judged)),
                typeset(where(one.evaluation.tests[0].worst)),
            ]
            for name, one in states
        ],
    )
    rows = [
        [
            s.position,
            s.nominal,
            *(s.repeats[k].length.error * 1e3 if k < len(s.repeats) else None for k in range(3)),
            s.repeats[0].guard * 1e3,
            s.repeats[0].permissible * 1e3,
        ]
        for s in result.sets
    ]
    runs = [said("run {n}", n=k) for k in (1, 2, 3)]
    heads = [said("Position"), said("Length, mm"), *runs, "U", "MPE"]
    page.table(heads, rows, caption=said("Errors of indication after, µm"), digits=3)
    page.notes(list(result.notes), warning=True)


def _foretold(page: Page, found: Verification) -> None:
    page.section(said("Measured against foretold"))
    page.text(
        said(
            "What the model says of each line without compensation, by its error motions and their "
            "covariance, beside what was measured; ± U, k = {k}. Left is measured less foretold, "
            "root of the mean square; expected is what readings, instrument, expansion and the "
            "model's own uncertainty would leave.",
            k=f"{found.coverage:g}",
        )
    )
    rows = []
    for one in found.lines:
        told, before = one.foretold, one.before
        if told is None or before is None:
            continue
        unit, factor, _, _ = display(one.after.result)
        agrees = {True: said("agrees"), False: said("differs"), None: said("not known")}
        outcome = agrees[told.agrees]
        rows += [
            [
                one.after.name,
                one.after.setup,
                name,
                _with_u(found, before, name, factor),
                typeset(foretold_words(one, name, factor, found.coverage)),
                number(told.left * factor, 3),
                number(told.expected * factor, 3),
                unit,
                outcome,
            ]
            for name in told.figures
        ]
    heads = [_LINE, _SETUP, _FIGURE, said("Measured"), said("Foretold"), said("Left of it")]
    page.table([*heads, said("Expected"), _UNIT, ""], rows)
    left = found.comparison.summary()
    page.text(typeset(said("All rows, measured less foretold: {left}.", left=left)))


def _budget(page: Page, found: Verification) -> None:
    page.section(said("Uncertainty budget"))
    page.text(
        said(
            "Standard uncertainties of each figure after, by cause: the instrument's scale; the "
            "thermal expansion of the length (coefficient and temperature); what means of few runs "
            "are unsure by; the line of the instrument beside that of the axis. The scatter itself "
            "is in A and R by their definition and does not count twice: of R the reversal error "
            "alone is unsure."
        )
    )
    rows: list[list[str | float | None]] = []
    for one in found.lines:
        unit, factor, _, _ = display(one.after.result)
        for name, budget in one.after.budgets.items():
            parts = [number(budget[c] * factor, 2) if c in budget else "–" for c in CAUSES]
            u = combined(budget) * factor
            total = [number(u, 2), number(found.coverage * u, 2)]
            warmth = one.after.temperature
            warm = "–" if warmth is None else f"{warmth:.1f}"
            rows.append([one.after.name, one.after.setup, name, warm, *parts, *total, unit])
    heads = [_LINE, _SETUP, _FIGURE, "°C", *(_CAUSES[c] for c in CAUSES), "u"]
    page.table([*heads, f"U, k = {found.coverage:g}", _UNIT], rows)
