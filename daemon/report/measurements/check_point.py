"""The report of ``abbe check-point``: what has changed, and the control charts of all series."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from abbe.compcore.figures.figure import COLOURS, band, figure, line, points
from abbe.compcore.model.model import Model
from abbe.compcore.monitoring.judgement import Judgement
from abbe.compcore.monitoring.words import judgement_words
from abbe.daemon.answers.measurements.check_point import CheckAnswer, day
from abbe.daemon.report.head import file_on_page, head_of
from abbe.daemon.report.page import Page, number


def page(answer: CheckAnswer, model: Model, model_path: Path) -> Page:
    """Lay out a machine's checks."""
    found = answer.judgement
    head = head_of(model, [file_on_page("model", model_path)], found.readings.campaign)
    made = Page("Is the model still true?", head=head)
    for text in judgement_words(found, day):
        made.text(text)
    if found.change is not None:
        made.text(f"What lies behind it: {answer.diagnosing}")
    full = found.charts.fullness[-1]
    fullest = int(full.argmax())
    made.key_figures(
        [
            ("checks", str(len(found.readings.times)), ""),
            (f"fullest chart ({found.readings.series[fullest].name})", f"{full[fullest]:.0%}", ""),
            ("a false alarm in", f"{found.design.false_alarm_every:g}", "checks"),
        ]
    )
    made.section("All charts")
    made.figure(*_all(found))
    made.table(
        ["series", "readings", "scatters by, k = 1", "unit", "chart"],
        [
            [
                s.name,
                int(np.isfinite(found.expected.sd[:, k]).sum()),
                number(float(found.usual[k]), 3),
                s.unit,
                f"{full[k]:.0%}",
            ]
            for k, s in enumerate(found.readings.series)
        ],
    )
    for k in np.argsort(-full, kind="stable")[:_DRAWN].tolist():
        made.section(found.readings.series[k].name)
        made.figure(*_readings(found, k))
        made.figure(*_chart(found, k))
    return made


_NOTHING_KNOWN = 5.0
"""Times the usual scatter: a check of which less was known is not drawn."""
_DRAWN = 6
"""Series that are drawn one by one, those with the fullest charts."""


def _times(found: Judgement) -> list[str]:
    return [datetime.fromtimestamp(t).isoformat(" ", "minutes") for t in found.readings.times]


def _since(found: Judgement) -> dict[str, Any]:
    """A line where the machine changed, for a figure's layout."""
    if found.change is None:
        return {}
    at = _times(found)[found.change.first_changed]
    dash = {"color": COLOURS[1], "width": 1, "dash": "dot"}
    shape = {"type": "line", "x0": at, "x1": at, "y0": 0, "y1": 1, "yref": "paper", "line": dash}
    return {"shapes": [shape]}


def _all(found: Judgement) -> tuple[dict[str, Any], str]:
    times = _times(found)
    full = 100.0 * found.charts.fullness
    worst = np.argsort(-full[-1], kind="stable")[:_DRAWN].tolist()
    traces = [line(times, full[:, k].tolist(), found.readings.series[k].name) for k in worst]
    traces.append(
        line(
            times,
            full.max(axis=1).tolist(),
            "fullest of all",
            line={"color": COLOURS[-1], "width": 1, "dash": "dot"},
        )
    )
    traces.append(
        line([times[0], times[-1]], [100.0, 100.0], "limit", line={"color": COLOURS[1], "width": 1})
    )
    made = figure(traces, "", "of the limit, %", yaxis={"rangemode": "tozero"}, **_since(found))
    return made, "How full the charts are: 100 % is an alarm. The fuller of EWMA and CUSUM each."


def _readings(found: Judgement, k: int) -> tuple[dict[str, Any], str]:
    times, e = np.array(_times(found)), found.expected
    # the first check of an artefact that nobody calibrated was expected anywhere
    read = np.nan_to_num(e.sd[:, k], nan=np.inf) < _NOTHING_KNOWN * found.usual[k]
    at = times[read].tolist()
    edge = (2.0 * e.sd[read, k]).tolist()
    traces = [
        *band(at, [-x for x in edge], edge, COLOURS[0]),
        points(at, e.surprise[read, k].tolist(), "read", marker={"color": COLOURS[0], "size": 6}),
    ]
    unit = found.readings.series[k].unit
    made = figure(traces, "", f"beyond what was expected, {unit}", height=300, **_since(found))
    return made, (
        "What each check read beyond what was expected of it after all checks before; the band "
        "holds 95 % of a sound machine's."
    )


def _chart(found: Judgement, k: int) -> tuple[dict[str, Any], str]:
    times, c = _times(found), found.charts
    ends = [times[0], times[-1]]
    courses = (
        ("EWMA", c.ewma[:, k] / c.ewma_limit, COLOURS[0]),
        ("CUSUM up", c.upper[:, k] / c.cusum_limit, COLOURS[2]),
        ("CUSUM down", -c.lower[:, k] / c.cusum_limit, COLOURS[3]),
    )
    traces = [line(times, v.tolist(), name, line={"color": hue}) for name, v, hue in courses]
    for side in (1.0, -1.0):
        limit = {"color": COLOURS[1], "width": 1}
        traces.append(line(ends, [side, side], "limit", showlegend=False, line=limit))
    made = figure(traces, "", "parts of the limit", height=300, **_since(found))
    return made, "The EWMA tells what moves slowly, the CUSUM what jumps; alarm beyond ±1."
