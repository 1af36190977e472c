"""The report of ``abbe iso10360``: errors of indication over length, between their limits."""

from __future__ import annotations

import numpy as np

from abbe.compcore.artefacts.iso10360 import LengthTestResult
from abbe.compcore.figures.figure import COLOURS, Figure, Trace, figure, line, points
from abbe.daemon.answers.measurements.iso10360 import ZONES, LengthAnswer, where
from abbe.daemon.report.measurements.sheet_head import sheet_head
from abbe.daemon.report.page import Page, number


def page(answer: LengthAnswer) -> Page:
    """Lay out an evaluation."""
    evaluation = answer.evaluation
    made = Page("Length measurement errors, ISO 10360-2", head=sheet_head("measured", answer.files))
    made.text(
        "An error is the measured less the calibrated length, at the temperature that the length "
        f"had. Every value is held against {ZONES[evaluation.decision]}"
        + (
            f", k = {evaluation.coverage:g}."
            if any(j.guard for t in evaluation.tests for j in t.judged)
            else "."
        )
    )
    for result in evaluation.tests:
        made.section(f"{result.test.name}: {answer.words[result.outcome]}")
        worst = result.worst
        figures = [
            ("worst error", number(worst.length.error * 1e3), "µm"),
            ("of what is permitted", f"{worst.used * 100:.0f}", "%"),
            ("values", str(len(result.judged)), ""),
        ]
        found = evaluation.repeatability
        if found is not None and result.test.name == "E0":
            figures.append(("R0, greatest range of three", number(found.value * 1e3, 3), "µm"))
            if found.limit is not None:
                figures.append(("R0, limit", number(found.limit * 1e3, 3), "µm"))
        made.key_figures(figures)
        made.text(f"{result.test.title.capitalize()}. Limit {result.permissible}.")
        outside = [f"outside: {where(j)}" for j in result.judged if not j.inside]
        made.notes([*outside, *result.notes], warning=True)
        made.figure(
            _picture(result),
            "Errors of indication over length, every repeat; limits dashed"
            + (
                ", the zone of the decision dotted." if any(j.guard for j in result.judged) else "."
            ),
        )
        made.table(
            ["Position", "Length, mm", *(f"run {k}" for k in (1, 2, 3)), "Range", "MPE"],
            [
                [
                    s.position,
                    s.nominal,
                    *(
                        s.repeats[k].length.error * 1e3 if k < len(s.repeats) else None
                        for k in range(3)
                    ),
                    None if s.range is None else s.range * 1e3,
                    result.permissible.at(s.nominal) * 1e3,
                ]
                for s in result.sets
            ],
            caption="Errors of indication, µm",
            digits=3,
        )
    return made


def _picture(result: LengthTestResult) -> Figure:
    longest = max(j.length.calibrated.length for j in result.judged)
    over = np.linspace(0.0, 1.05 * longest, 200)
    limit = np.array([result.permissible.at(float(x)) for x in over]) * 1e3
    dashed = {"color": "#57606a", "width": 1.5, "dash": "dash"}
    traces: list[Trace] = [
        line(over, limit, "MPE", line=dashed),
        line(over, -limit, showlegend=False, line=dashed),
    ]
    if any(j.guard for j in result.judged):
        ordered = sorted(result.judged, key=lambda j: j.length.calibrated.length)
        at = [j.length.calibrated.length for j in ordered]
        zone = np.array([j.limit for j in ordered]) * 1e3
        dotted = {"color": "#cf222e", "width": 1, "dash": "dot"}
        traces += [
            line(at, zone, "zone", line=dotted),
            line(at, -zone, showlegend=False, line=dotted),
        ]
    for i, name in enumerate(dict.fromkeys(s.position for s in result.sets)):
        own = [j.length for j in result.judged if j.length.position == name]
        marker = {"size": 6, "color": COLOURS[i % len(COLOURS)]}
        lengths = [m.calibrated.length for m in own]
        errors = [m.error * 1e3 for m in own]
        traces.append(points(lengths, errors, name, marker=marker))
    return figure(traces, "length in mm", "error of indication in µm")
