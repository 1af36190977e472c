"""The report of ``abbe gauges``: errors of length and of plates, before and after a model."""

from __future__ import annotations

import numpy as np

from abbe.compcore.figures.figure import COLOURS, Trace, figure, line, points
from abbe.daemon.answers.measurements.gauges import GaugeAnswer, GaugedPlate, worst
from abbe.daemon.report.measurements.sheet_head import sheet_head
from abbe.daemon.report.page import Page, number

_SHOWN = 0.12
"""The longest error vector in a picture, as a part of the plate's size."""


def page(answer: GaugeAnswer) -> Page:
    """Lay out measured lengths or plates."""
    made = Page("Calibrated lengths and plates", head=sheet_head("measured", [answer.file]))
    made.text(
        "An error of indication is what the machine says less what the material standard is at its "
        "temperature" + (f"; 'after' is what {answer.model} leaves of it." if answer.model else ".")
    )
    before, after = worst(answer)
    figures = [("worst length as measured", number(before * 1e3, 3), "µm")]
    if after is not None:
        figures.append(("worst length after", number(after * 1e3, 3), "µm"))
    made.key_figures(figures)
    if answer.lengths:
        _lengths(made, answer)
    for gauged in answer.plates:
        _plate(made, gauged)
    return made


def _lengths(made: Page, answer: GaugeAnswer) -> None:
    made.section("Lengths")
    places = list(dict.fromkeys(g.length.position for g in answer.lengths))
    traces: list[Trace] = []
    for label, k in (("as measured", 0), ("after", 1)):
        shown = [
            (g.length.position, value * 1e3)
            for g in answer.lengths
            if (value := g.before if k == 0 else g.after) is not None
        ]
        if shown:
            marker = {"size": 8, "color": COLOURS[k]}
            x, y = zip(*shown, strict=True)
            traces.append(points(list(x), list(y), label, marker=marker))
    made.figure(
        figure(
            traces,
            "position",
            "error of indication in µm",
            xaxis={"type": "category", "categoryorder": "array", "categoryarray": places},
        ),
        "Every measured length.",
    )
    made.table(
        ["Position", "Calibrated, mm", "Run", "T, °C", "Error", "After", "U (k = 2)"],
        [
            [
                g.length.position,
                g.length.calibrated.length,
                g.length.run,
                g.length.temperature,
                g.before * 1e3,
                None if g.after is None else g.after * 1e3,
                2e3 * g.length.uncertainty or None,
            ]
            for g in answer.lengths
        ],
        caption="Errors of indication, µm",
    )


def _plate(made: Page, gauged: GaugedPlate) -> None:
    plate = gauged.plate
    made.section(f"Plate, placing {plate.placing}")
    actual = plate.actual
    size = float(np.ptp(actual, axis=0).max())
    errors = {"as measured": plate.errors()}
    if gauged.corrected is not None:
        errors["after"] = plate.errors(gauged.corrected)
    longest = max(float(np.linalg.norm(e, axis=1).max()) for e in errors.values())
    factor = _SHOWN * size / max(longest, 1e-12)
    placed, frame = plate.placed(), _frame(actual, plate.placed())
    traces: list[Trace] = [points(actual[:, 0], actual[:, 1], "calibrated")]
    for i, (label, error) in enumerate(errors.items()):
        own = error @ frame
        x = np.stack([actual[:, 0], actual[:, 0] + factor * own[:, 0], np.full(len(own), np.nan)])
        y = np.stack([actual[:, 1], actual[:, 1] + factor * own[:, 1], np.full(len(own), np.nan)])
        style = {"color": COLOURS[i + 1], "width": 2}
        traces.append(line(x.T.ravel(), y.T.ravel(), label, line=style))
    made.figure(
        figure(traces, "plate's x in mm", "plate's y in mm", yaxis={"scaleanchor": "x"}),
        f"Errors beside the placed plate, {factor:.0f} times larger than they are.",
    )
    rows = []
    for i, name in enumerate(plate.points):
        cells: list[str | float | int | None] = [name, *placed[i].tolist()]
        for error in errors.values():
            cells += (error[i] * 1e3).tolist()
        rows.append(cells)
    heads = ["Point", "X, mm", "Y, mm", "Z, mm"]
    heads += [f"d{k} {label}, µm" for label in errors for k in "XYZ"]
    made.table(heads, rows)


def _frame(actual: np.ndarray, placed: np.ndarray) -> np.ndarray:
    """Rotation from the plate's frame into machine axes, (3, 3)."""
    from abbe.compcore.artefacts.plate import rigid_placing

    return rigid_placing(actual, placed)[0]
