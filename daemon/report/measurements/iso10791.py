"""The report of ``abbe iso10791``: where rotary axes lie, what to enter, how they err."""

from __future__ import annotations

import numpy as np

from abbe.compcore.figures.figure import figure, line
from abbe.compcore.iso10791.evaluate import RotaryAxisResult
from abbe.compcore.machine.machine import own_component
from abbe.compcore.model.as_built import ON_THE_TABLE
from abbe.daemon.answers.measurements.iso10791 import WAYS, RotaryAnswer, shown
from abbe.daemon.report.head import PageHead
from abbe.daemon.report.page import Page, number


def page(answer: RotaryAnswer, head: PageHead) -> Page:
    """Lay out an evaluation."""
    evaluation = answer.evaluation
    made = Page("Rotary axes, ISO 10791-6", head=head)
    made.text(
        "Errors are of the tool relative to the workpiece, actual minus indicated. What lies where "
        "on the machine, and what to enter, is said beside them."
    )
    made.key_figures(
        [
            ("readings", str(evaluation.result.problem.n), ""),
            ("left over, rms", number(evaluation.left * 1e3, 2), "µm"),
        ]
    )
    open_ = [u.text for u in evaluation.result.undetermined if not u.convention]
    made.notes([f"not determined: {text}" for text in open_], warning=True)
    made.notes([t.words() for t in evaluation.together if t.matters], warning=True)
    for found in evaluation.axes:
        _axis(made, found)
    if evaluation.spindle is not None:
        made.section("The spindle in the head")
        made.notes(list(evaluation.spindle.words()))
    return made


def _axis(made: Page, found: RotaryAxisResult) -> None:
    made.section(f"Axis {found.axis}, on the {found.side}'s side of the bed")
    made.notes(list(found.line.words()))
    opposite = found.side == "workpiece"
    rows: list[list[str | float | int | None]] = []
    for name, value in found.location.items():
        if name[2] == own_component(found.axis):
            continue
        unit, factor = ("µm", 1e3) if name[2] in "XYZ" else ("µrad", 1e6)
        sd = None if value.sd is None else value.sd * factor
        itself = -value.value * factor if opposite else value.value * factor
        rows.append([name, unit, value.value * factor, sd, itself])
    heads = ["Error", "Unit", "Value", "± (k = 1)", "The line itself"]
    made.table(heads, rows, caption="Place and lean of the line")
    if found.ranges:
        made.table(
            ["Sphere", "Direction", "Least", "Greatest", "Range"],
            [
                [r.setup, r.direction, r.low * 1e3, r.high * 1e3, r.range * 1e3]
                for r in found.ranges
            ],
            caption="As read, µm: tool relative to workpiece",
        )
    for rotation in (False, True):
        curves = [c for c in found.motions if c.motion.rotation is rotation]
        if not curves:
            continue
        unit, factor = shown(curves[0])
        traces = [
            line(np.degrees(c.angle), c.value * factor, f"{c.motion}{WAYS[c.way]}") for c in curves
        ]
        caption = "Error motions that place and lean of the line leave."
        if curves[0].at_sphere:
            caption += " Of the sphere: one does not tell tilts from radial and axial motion."
        if opposite:
            caption += f" {ON_THE_TABLE[0].upper()}{ON_THE_TABLE[1:]}."
        made.figure(figure(traces, f"{found.axis} in degrees", f"error motion in {unit}"), caption)
