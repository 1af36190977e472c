"""``abbe gauges``: gauge blocks, step gauges and plates as measured, and with a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.answer_options import AnswerOptions
from abbe.daemon.arguments.groups import grouped
from abbe.daemon.arguments.options import ErrorUnit, Reduced

if TYPE_CHECKING:
    from abbe.daemon.report.page import Page


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("gauges")(grouped(gauges))


def gauges(
    file: Annotated[
        Path, typer.Argument(help="Measured lengths or plates, CSV.", metavar="FILE.csv")
    ],
    model: Annotated[
        Path | None,
        typer.Option(help="Also with this model's correction.", metavar="MODEL.toml"),
    ] = None,
    tool: Annotated[
        str, typer.Option(help="Probe offset x,y,z in mm, where the file has none.")
    ] = "0,0,0",
    reduced: Reduced = None,
    unit: ErrorUnit = None,
    *,
    telling: AnswerOptions,
) -> None:
    """Hold measured gauge blocks, step gauges, ball and hole plates against their calibration.

    An example: abbe gauges block.csv --model fitted.toml
    """
    from abbe.compcore.files.model_file import load_model
    from abbe.daemon.answers.measurements import gauges as answer
    from abbe.daemon.arguments.assignments import tool_offset

    say = telling.checked([file, model])
    loaded = None if model is None else load_model(model)
    found = answer.evaluate(
        file,
        loaded,
        None if model is None else model.name,
        tool=tool_offset("tool", tool),
        reduced=reduced,
        unit=unit,
    )

    def page() -> Page:
        from abbe.daemon.report.measurements.gauges import page

        return page(found)

    telling.tell(say, page, lambda: answer.as_json(found), lambda: answer.as_text(found))
