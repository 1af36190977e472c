"""The page of ``abbe diagnose --report``: how wrong, where, why, what else, what to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.diagnosis.explain import (
    amount,
    description,
    explanation,
    formula,
    headline,
    parameter,
)
from abbe.compcore.diagnosis.measure_next import Advice
from abbe.compcore.diagnosis.uncatalogued.residual_pattern import ResidualPattern
from abbe.compcore.diagnosis.verdict import Diagnosis
from abbe.compcore.figures.figure import COLOURS, Trace, figure, line, points
from abbe.daemon.answers.diagnose import advice_text, noise_of, thinned_words
from abbe.daemon.answers.typed import Adding
from abbe.daemon.report.page import Page, number

F64 = NDArray[np.float64]

_TITLES = {
    "complete": "Nothing is missing",
    "missing": "A cause is missing",
    "unexplained": "Something is left that no effect of the catalogue explains",
}
_BARS = 12


def page(
    diagnosis: Diagnosis,
    noise: NoiseFloor,
    advice: Sequence[Advice],
    subtitle: str,
    adding: Adding,
) -> Page:
    """The whole story on one page."""
    out = Page(_TITLES[diagnosis.verdict], subtitle)
    _how_wrong(out, diagnosis, noise)
    _where(out, diagnosis)
    if diagnosis.established:
        _why(out, diagnosis)
    if diagnosis.structure:
        _structure(out, diagnosis, adding)
    _candidates(out, diagnosis)
    _what_to_do(out, diagnosis, advice, adding)
    return out


def _how_wrong(out: Page, diagnosis: Diagnosis, noise: NoiseFloor) -> None:
    level = noise_of(diagnosis, noise)
    unit, _, factor = diagnosis.unit
    value = "unknown" if level is None else number(level * factor, 3)
    figures = [
        ("residuals", number(diagnosis.rms * factor, 3), f"{unit} rms"),
        ("noise floor", value, "(no repeats)" if level is None else unit),
        ("χ² per degree of freedom", number(diagnosis.whole.chi2_per_dof, 3), ""),
    ]
    if diagnosis.established:
        last = number(diagnosis.left, 3)
        figures.append(("… once the causes are added", last, ""))
    out.section("How wrong")
    out.key_figures(figures)
    out.text(
        "χ² per degree of freedom compares the residuals with the stated uncertainty of each row; "
        "1 means that nothing but noise is left."
    )
    if diagnosis.result is not diagnosis.whole:
        out.text(f"Pictures show those rows only: {thinned_words(diagnosis)}.")


def _where(out: Page, diagnosis: Diagnosis) -> None:
    campaign = diagnosis.result.problem.campaign
    conditions = campaign.conditions
    rows = np.flatnonzero(campaign.kind == Kind.DISPLACEMENT)
    if not rows.size or conditions.u is None:
        return
    residual = diagnosis.result.residual[rows] * 1e3
    out.section("Where")
    point = diagnosis.result.problem.observation(diagnosis.result.theta).chain.point[rows]
    out.figure(
        _vectors(point, conditions.u[rows], residual),
        "Residuals in the volume: each line points along the measured direction and is as long as "
        "the residual, enlarged. Turn the picture with the mouse.",
    )
    traces: list[Trace] = []
    hours = conditions.time[rows] / 3600.0
    for k, letter in enumerate("XYZ"):
        mine = np.abs(conditions.u[rows][:, k]) > 0.9
        if mine.any():
            traces.append(
                points(
                    hours[mine],
                    residual[mine],
                    f"along {letter}",
                    marker={"size": 4, "color": COLOURS[k]},
                )
            )
    mixed = np.abs(conditions.u[rows]).max(axis=1) <= 0.9
    if mixed.any():
        traces.append(
            points(hours[mixed], residual[mixed], "diagonals", marker={"size": 4, "color": "#777"})
        )
    out.figure(
        figure(traces, "time in h", "residual in µm", height=320),
        "Residuals over time, by measured direction: a slope or a wave in time is no noise.",
    )


def _vectors(point: F64, u: F64, residual: F64) -> dict[str, object]:
    size = float(np.ptp(point, axis=0).max()) or 1.0
    largest = float(np.abs(residual).max()) or 1.0
    ends = point + u * residual[:, None] / largest * 0.08 * size
    gaps = np.full((len(point), 3), np.nan)
    segments = np.stack([point, ends, gaps], axis=1).reshape(-1, 3)
    colour = np.repeat(residual, 3)
    trace: Trace = {
        "type": "scatter3d",
        "mode": "lines",
        "x": segments[:, 0],
        "y": segments[:, 1],
        "z": segments[:, 2],
        "line": {
            "width": 4,
            "color": colour,
            "colorscale": "RdBu",
            "cmin": -largest,
            "cmax": largest,
            "showscale": True,
            "colorbar": {"title": {"text": "µm"}, "thickness": 14},
        },
        "hoverinfo": "skip",
    }
    axes = {f"{k}axis": {"title": {"text": f"{k.upper()} in mm"}} for k in "xyz"}
    camera = {"eye": {"x": 1.7, "y": 1.7, "z": 1.1}}
    scene = {**axes, "aspectmode": "data", "camera": camera}
    out = figure([trace], height=520, scene=scene)
    out["layout"].pop("xaxis")
    out["layout"].pop("yaxis")
    return out


def _why(out: Page, diagnosis: Diagnosis) -> None:
    out.section("Why")
    for i, established in enumerate(diagnosis.established, start=1):
        effect = established.found.candidate.effect
        out.subsection(f"{i}. {effect.spec}")
        out.text(explanation(established, diagnosis))
        out.table(
            ["parameter", "fitted", "plausible", "what it is"],
            [
                [
                    e.name,
                    parameter(e).split(" = ", 1)[1],
                    f"{amount(e.range[0], e.unit)} … {amount(e.range[1], e.unit)}"
                    + ("" if e.plausible else "  ← outside"),
                    e.description,
                ]
                for e in established.estimates
            ],
        )
        spec = effect.spec
        out.figure(
            _signature(diagnosis, established.signature, "what the cause would add"),
            f"Residuals of the model without '{spec}' against what it would add. Means on the "
            "dashed line: it explains them.",
        )


def _signature(diagnosis: Diagnosis, signature: F64, what: str) -> dict[str, object]:
    """Residual against a signature, (n,), mm or rad: on the diagonal what it explains."""
    campaign = diagnosis.result.problem.campaign
    rows = campaign.kind == Kind.DISPLACEMENT
    factor, unit = 1e3, "µm"
    if not rows.any():
        rows, factor, unit = campaign.kind == Kind.ROTATION, 1e6, "µrad"
    x = signature[rows] * factor
    y = diagnosis.result.residual[rows] * factor
    order = np.argsort(x)
    count = max(1, min(24, len(x) // 25))
    bins = np.array_split(order, count)
    middle = np.array([x[b].mean() for b in bins])
    mean = np.array([y[b].mean() for b in bins])
    ends = np.array([x.min(), x.max()])
    return figure(
        [
            points(x, y, "rows", marker={"size": 3, "color": "#9aa4ae"}),
            line(ends, ends, "explained fully", line={"color": COLOURS[0], "dash": "dash"}),
            points(middle, mean, "mean of residuals", marker={"size": 9, "color": COLOURS[1]}),
        ],
        f"{what}, {unit}",
        f"residual without it, {unit}",
        height=380,
    )


def _structure(out: Page, diagnosis: Diagnosis, adding: Adding) -> None:
    out.section("What no cause explains")
    for s in diagnosis.structure:
        share = s.drop / diagnosis.basis.chi2
        words = description(s)
        out.text(
            f"{words[0].upper()}{words[1:]}. It makes up {share:.0%} of the residuals' χ²; depends "
            f"on {', '.join(s.depends_on)}."
        )
        out.figure(
            _signature(diagnosis, _described(diagnosis, s), "what is described"),
            "Residuals of the model as it is against what this describes. Means on the dashed "
            "line: it says all of it.",
        )
        if spec := formula(s):
            out.notes([f"Empirical, describes without explaining: {adding.command(spec)}"])


def _described(diagnosis: Diagnosis, structure: ResidualPattern) -> F64:
    """What a description says of each row, beyond what the model can imitate, (n,), mm or rad."""
    basis = diagnosis.basis
    columns = basis.project(structure.columns)
    fitted = columns @ np.linalg.lstsq(columns, basis.residual, rcond=1e-10)[0]
    return np.asarray(fitted / diagnosis.result.problem.weight)


def _candidates(out: Page, diagnosis: Diagnosis) -> None:
    leading = [f for f in diagnosis.ranked if np.isfinite(f.evidence.value)][:_BARS]
    if not leading:
        return
    out.section("What else it could be")
    out.text(
        f"{diagnosis.tests} candidates were tested at once. Evidence is in units of "
        "−2·ln(likelihood), after the price of each coefficient: 12 is convincing, a lead of 10 "
        "over the next is a clear distinction."
    )
    names = [f.candidate.effect.spec for f in leading][::-1]
    values = [f.evidence.value for f in leading][::-1]
    bar: Trace = {
        "type": "bar",
        "orientation": "h",
        "x": values,
        "y": names,
        "marker": {"color": [COLOURS[0] if v > 12.0 else "#c3cad1" for v in values]},
    }
    out.figure(
        figure([bar], "evidence", height=60 + 26 * len(leading), yaxis={"automargin": True}),
        "The strongest single candidates against the model as it is.",
    )
    for established in diagnosis.established:
        if not established.aliases:
            continue
        out.subsection(f"not to be told from '{established.found.candidate.effect.spec}'")
        out.table(
            ["candidate", "what it is", "χ² that tells them apart (14 is certain)"],
            [
                [
                    a.found.candidate.effect.spec,
                    headline(a.found.candidate.effect),
                    float(a.separation),
                ]
                for a in established.aliases[:10]
            ],
            digits=3,
        )


def _what_to_do(out: Page, diagnosis: Diagnosis, advice: Sequence[Advice], adding: Adding) -> None:
    out.section("What to do")
    if diagnosis.established:
        first = diagnosis.established[0].found.candidate.effect.spec
        out.text(
            "Add the first cause, look whether campaigns that were not fitted agree, and diagnose "
            "again:"
        )
        out.notes([f"{adding.command(first)} --holdout OTHER.csv"])
    elif diagnosis.structure:
        out.text(
            "Look for the physics behind what is described above: what was switched, moved, heated "
            "or loaded in that rhythm? Record it as a signal and measure again."
        )
    else:
        out.text("Nothing. The model explains these measurements down to their noise.")
    if advice:
        out.subsection("what to measure next")
        out.notes([advice_text(a) for a in advice])
