"""The report of ``abbe iso230``: the standard's tables and pictures."""

from __future__ import annotations

import numpy as np

from abbe.compcore.campaign.measuring_conditions import of_files
from abbe.compcore.figures.figure import COLOURS, Trace, band, figure, line, points
from abbe.compcore.iso230.circular import CircularResult
from abbe.compcore.iso230.diagonals import Diagonals
from abbe.compcore.iso230.positioning import RESULTS, PositioningResult
from abbe.compcore.units import in_digits
from abbe.daemon.answers.measurements.iso230 import (
    MEANINGS,
    SYMBOLS,
    TARGET_COLUMNS,
    Evaluation,
    display,
    finite,
)
from abbe.daemon.report.head import FileOnPage, PageHead, facts_of
from abbe.daemon.report.page import Page


def page(evaluation: Evaluation) -> Page:
    """Lay out an evaluation."""
    made = Page("Accuracy and repeatability of positioning", head=evaluation_head(evaluation))
    made.text(
        "Evaluated by ISO 230-2 (single axes), ISO 230-4 (circles) and ISO 230-6 (diagonals). "
        "Errors are actual minus indicated. A band is the mean ± 2 s of one direction."
    )
    if evaluation.positioning:
        made.section("Summary")
        rows = []
        for result in evaluation.positioning:
            unit, factor, _, _ = display(result)
            values = [getattr(result, name) for name in RESULTS]
            cells = [None if v is None else v * factor for v in values]
            rows.append([result.runs.axis, result.runs.setup, unit, *cells])
        made.table(["Axis", "Set-up", "Unit", *(SYMBOLS[n] for n in RESULTS)], rows, digits=3)
    for result in evaluation.positioning:
        _positioning(made, result)
    for circle in evaluation.circles:
        _circle(made, circle)
    if evaluation.diagonals.diagonals:
        _diagonals(made, evaluation.diagonals)
    return made


def evaluation_head(evaluation: Evaluation) -> PageHead:
    """The head: the campaign's conditions, and the machine as the model or the file names it."""
    campaign = evaluation.campaign
    machine = evaluation.machine
    files = [FileOnPage("campaign", f, digest) for f, digest in campaign.files.items()]
    return PageHead(facts_of(of_files(campaign), machine), files)


def _positioning(made: Page, result: PositioningResult) -> None:
    unit, factor, position_unit, position_factor = display(result)
    made.section(f"Axis {result.runs.axis}: {result.runs.setup}")
    made.key_figures(
        [
            (f"{SYMBOLS[name]}, {MEANINGS[name]}", _short(getattr(result, name), factor), unit)
            for name in MEANINGS
        ]
    )
    made.notes(result.notes, warning=True)
    made.figure(*_curves(result, f"{result.runs.axis} in {position_unit}"))
    columns = [finite(getattr(result, name), factor) for name in TARGET_COLUMNS]
    positions = (result.runs.targets * position_factor).tolist()
    made.table(
        [f"Target, {position_unit}", *TARGET_COLUMNS.values()],
        [[q, *(column[i] for column in columns)] for i, q in enumerate(positions)],
        caption=f"Targets, {unit}",
        digits=3,
    )


def _circle(made: Page, circle: CircularResult) -> None:
    made.section(f"Circle {''.join(circle.plane)}: {circle.setup}")
    figures: list[tuple[str, float | None]]
    figures = [(f"G, {name}", value) for name, value in circle.G.items()]
    figures += [("G, both directions", circle.G_both), ("H, hysteresis", circle.H)]
    figures += [("F max", max(circle.F_max.values())), ("F min", min(circle.F_min.values()))]
    figures += [("D, mean radius", circle.D)]
    made.key_figures([(name, _short(value, 1e3), "µm") for name, value in figures])
    made.notes(circle.notes, warning=True)
    traces = [
        line(np.degrees(path.angle), circle.centred(name) * 1e3, name)
        for name, path in circle.paths.items()
    ]
    first, second = circle.plane
    made.figure(
        figure(traces, f"angle from {first} to {second} in degrees", "radial deviation in µm"),
        "Radius measured minus nominal, centre by least squares; radius "
        f"{in_digits(circle.radius, 4)} mm.",
    )


def _short(value: float | None, factor: float) -> str:
    return "–" if value is None else f"{value * factor:.1f}"


def _curves(result: PositioningResult, x_title: str) -> tuple[dict[str, object], str]:
    """Readings, means and bands of both directions, and the reversal."""
    unit, factor, _, position_factor = display(result)
    x = result.runs.targets * position_factor
    traces: list[Trace] = []
    for name, readings, mean, s, colour in (
        ("↑", result.runs.up, result.mean_up, result.s_up, COLOURS[0]),
        ("↓", result.runs.down, result.mean_down, result.s_down, COLOURS[1]),
    ):
        if not np.isfinite(mean).any():
            continue
        if np.isfinite(s).any():
            traces += band(x, (mean - 2 * s) * factor, (mean + 2 * s) * factor, colour)
        at = np.repeat(x, readings.shape[1])
        marker = {"size": 4, "color": colour, "opacity": 0.5}
        traces.append(points(at, readings.ravel() * factor, f"runs {name}", marker=marker))
        style = {"color": colour, "width": 2}
        traces.append(line(x, mean * factor, f"mean {name}", line=style))
    if np.isfinite(result.mean).any():
        style = {"color": "#57606a", "width": 1, "dash": "dash"}
        traces.append(line(x, result.mean * factor, "mean of both", line=style))
    caption = f"Errors of positioning, {unit}: single runs, mean and ± 2 s of each direction."
    return figure(traces, x_title, f"error in {unit}"), caption


def _diagonals(made: Page, diagonals: Diagonals) -> None:
    made.section("Diagonals")
    made.key_figures(
        [
            (f"E, {name} diagonals", _short(value, 1e3), "µm")
            for name, value in (("body", diagonals.E_body), ("face", diagonals.E_face))
            if value is not None
        ]
    )
    made.figure(
        figure(
            [
                line(
                    d.result.runs.targets,
                    (np.nanmean([d.result.mean_up, d.result.mean_down], axis=0)) * 1e3,
                    f"{d.name} {d.setup}",
                )
                for d in diagonals.diagonals
            ],
            "along the diagonal in mm",
            "mean error in µm",
        ),
        "Mean error along each diagonal, from its first target.",
    )
    made.table(
        ["Diagonal", "Set-up", "Length, mm", "E, µm", "B, µm", "Slope, ppm"],
        [
            [d.name, d.setup, d.length, *(_um(v) for v in (d.result.E, d.result.B)), d.slope * 1e6]
            for d in diagonals.diagonals
        ],
        digits=3,
    )
    if diagonals.squareness:
        made.subsection("What the diagonals hint at")
        made.text(
            "Crossing diagonals differ by the squareness between the axes. "
            "The machine's other errors along the diagonals are in these numbers."
        )
        made.table(
            ["Angle", "less 90°, µrad"],
            [[f"+{a} to +{b}", angle * 1e6] for (a, b), angle in diagonals.squareness.items()],
            digits=3,
        )


def _um(value: float | None) -> float | None:
    return None if value is None else value * 1e3
