"""How the error fell from a machine to its model, step by step: a picture and a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from abbe.compcore.figures.figure import COLOURS, Trace, figure
from abbe.daemon.answers.model.apply import StepFigures
from abbe.daemon.report.page import Page


def how_it_fell(out: Page, steps: Sequence[StepFigures]) -> None:
    """The error step by step: of what was fitted, of left-out blocks, of held-out campaigns."""
    unit, held = steps[0].unit, any(s.unseen is not None for s in steps)
    out.section("How the error fell, step by step")
    at = np.arange(float(len(steps)))
    shown = {
        "fitted campaigns": [s.rms for s in steps],
        "blocks left out of the fit": [s.held_out for s in steps],
    } | ({"held-out campaigns": [s.unseen for s in steps]} if held else {})
    traces: list[Trace] = [
        {"type": "scatter", "mode": "lines+markers", "x": at, "y": y, "name": name,
         "line": {"color": COLOURS[colour]}, "hovertext": [s.what for s in steps]}
        for colour, (name, y) in zip((0, 2, 4), shown.items(), strict=False)
    ]  # fmt: skip
    out.figure(
        figure(
            traces,
            "step",
            f"rms of the residuals in {unit}",
            height=340,
            xaxis={"dtick": max(1, len(steps) // 12)},
            yaxis={"rangemode": "tozero"},
        ),
        "Only a fall on measurements that were not fitted shows that a step predicts the machine.",
    )
    columns = ["Step", "What", f"Fitted, {unit} rms", f"Left-out blocks, {unit} rms"]
    out.table(
        columns + ([f"Held-out campaigns, {unit} rms"] if held else []),
        [
            [k, s.what, s.rms, s.held_out, *([s.unseen] if held else [])]
            for k, s in enumerate(steps)
        ],
        digits=3,
    )
