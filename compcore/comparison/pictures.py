"""Pictures of a comparison: residuals of lengths and rotations, lines before and after."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.lines import MeasuredLine
from abbe.compcore.comparison.parts import ComparedRows
from abbe.compcore.figures.figure import COLOURS, Figure, figure
from abbe.compcore.figures.residuals import F64, Residuals, residual_figures
from abbe.compcore.machine.machine import Machine

MOST_LINES = 40


def part_figures(
    part: ComparedRows,
    what: str,
    campaign: Campaign,
    residual: F64,
    weighted: F64,
    machine: Machine,
) -> dict[str, Callable[[], Figure]]:
    """The pictures of one kind of rows by name; `what` is ``residuals`` or ``rotations``.

    Parameters
    ----------
    residual, weighted
        Of all rows, (n,): mm or rad, and in units of their standard uncertainty.
    machine
        Whose signals are worth a picture.
    """
    if not part.n:
        return {}
    unit = "µrad" if what == "rotations" else "µm"
    drawn = Residuals.of(campaign, part.rows, residual, weighted, unit, machine)
    return residual_figures(drawn, what, machine.signals)


def line_figure(lines: Sequence[MeasuredLine]) -> dict[str, Callable[[], Figure]]:
    """The lines by name, those with the largest rest first; empty where there are none."""
    ordered = sorted(lines, key=lambda entry: -entry.rest_before)
    return {"lines": partial(line_parts, ordered[:MOST_LINES])} if lines else {}


def line_parts(lines: list[MeasuredLine]) -> Figure:
    """Each line's linear part and rest, before and after the model."""
    names = [f"{entry.setup}" for entry in lines]
    bars = []
    for values, name, colour in (
        ([entry.linear_before for entry in lines], "linear, before", "#a9cfe8"),
        ([entry.linear_after for entry in lines], "linear, after", COLOURS[0]),
        ([entry.rest_before for entry in lines], "rest, before", "#f3c9a5"),
        ([entry.rest_after for entry in lines], "rest, after", COLOURS[1]),
    ):
        height = [None if v is None else abs(v) * 1e3 for v in values]
        bars.append(
            {"type": "bar", "x": names, "y": height, "name": name, "marker": {"color": colour}}
        )
    return figure(bars, "", "µm from end to end; peak to valley", barmode="group")
