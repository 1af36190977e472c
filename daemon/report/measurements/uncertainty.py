"""The report of ``abbe uncertainty``: how sure each characteristic is, and what makes it unsure."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from abbe.compcore.figures.figure import COLOURS, Trace, figure
from abbe.compcore.virtual_cmm.task_uncertainty import TaskUncertainty
from abbe.daemon.answers.uncertainty.answer import UncertaintyAnswer, of_tolerance, scale
from abbe.daemon.report.head import file_on_page, head_of
from abbe.daemon.report.page import Page, number

_CAUSES = 8


def page(answer: UncertaintyAnswer, model: Path, part: Path) -> Page:
    """Lay out the uncertainties of a part program."""
    head = head_of(answer.model, [file_on_page("model", model), file_on_page("part", part)])
    made = Page("Uncertainty of a part program", answer.program.name, head=head)
    made.text(
        f"{answer.draws} virtual measurements (seed {answer.seed}) of a machine whose parameters "
        "were drawn from the covariance of their fit, with its temperatures, probe and part. "
        "Measured − true; U: half of the interval that holds 95 %. Bias and U of the corrected "
        "machine, and of the machine as it is."
    )
    worst = max(answer.tasks, key=lambda t: of_tolerance(t) or 0.0)
    share = of_tolerance(worst)
    if share is not None:
        name = worst.characteristic.name
        made.key_figures([(f"of the tolerance at most ({name})", f"{share:.0%}", "")])
    made.notes(answer.notes)
    made.section("Characteristics")
    made.table(
        ["Characteristic", "Nominal", "Unit", "Bias", "U", "By derivatives", "Bias, as it is",
         "U, as it is", "Tolerance", "Taken"],
        [_row(t, 2.0 * float(sd)) for t, sd in zip(answer.tasks, answer.linear.sd, strict=True)],
        caption="By derivatives: 2u by the law of propagation (GUM); form and position have none",
    )  # fmt: skip
    for task in answer.tasks:
        _task(made, task)
    made.section("What would lower it")
    if not answer.measures:
        made.text("No measurement of the machine would lower any of them by a twentieth.")
        return made
    rows: list[list[str | float | int | None]] = []
    for m in answer.measures:
        one = answer.tasks[m.helped].characteristic
        factor, unit = scale(one)
        rows.append([
            m.setup.what, m.setup.instrument.title, round(m.setup.seconds / 60.0), one.name,
            2.0 * float(m.before[m.helped]) * factor, 2.0 * float(m.after[m.helped]) * factor, unit,
        ])  # fmt: skip
    made.table(["Measurement", "Instrument", "Minutes", "Helps most", "U now", "U then", ""], rows)
    return made


def _row(task: TaskUncertainty, linear: float) -> list[str | float | int | None]:
    one = task.characteristic
    factor, unit = scale(one)
    nominal = f"{math.degrees(task.nominal):.4f}°" if one.angular else f"{task.nominal:.4f} mm"
    taken = of_tolerance(task)
    return [
        one.name,
        nominal,
        unit,
        task.corrected.bias * factor,
        task.corrected.expanded * factor,
        linear * factor,
        task.uncorrected.bias * factor,
        task.uncorrected.expanded * factor,
        None if one.tolerance is None else one.tolerance * factor,
        None if taken is None else f"{taken:.0%}",
    ]


def _task(made: Page, task: TaskUncertainty) -> None:
    one = task.characteristic
    factor, unit = scale(one)
    made.subsection(one.name)
    traces: list[Trace] = []
    for k, (label, found) in enumerate(
        (("corrected", task.corrected), ("as it is", task.uncorrected))
    ):
        middle = 0.5 * (found.edges[1:] + found.edges[:-1]) * factor
        width = float(np.diff(found.edges[:2])[0]) * factor
        density = found.counts / max(float(found.counts.sum()) * width, 1e-300)
        traces.append(
            {"type": "bar", "x": middle, "y": density, "width": width, "name": label,
             "marker": {"color": COLOURS[k], "line": {"width": 0}}, "opacity": 0.7}
        )  # fmt: skip
    made.figure(
        figure(traces, f"measured − true in {unit}", f"density in 1/{unit}", barmode="overlay",
               height=300),
        f"Corrected: bias {number(task.corrected.bias * factor, 3)} {unit}, "
        f"U {number(task.corrected.expanded * factor, 3)} {unit} (known to "
        f"{number(2.0 * task.corrected.of_draws * factor, 2)} {unit} by the number of draws).",
    )  # fmt: skip
    made.table(
        ["Cause", f"Alone, {unit}", "Of the variance"],
        [
            [row.cause, row.alone * factor, None if row.share is None else f"{row.share:.0%}"]
            for row in task.budget[:_CAUSES]
        ],
    )
