"""``abbe gauges``: gauge blocks, step gauges and plates as measured, and with a model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.options import AsJson, ErrorUnit, Force, Reduced, Report


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("gauges")(gauges)


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
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Hold measured gauge blocks, step gauges, ball and hole plates against their calibration.

    An example: abbe gauges block.csv --model fitted.toml
    """
    from abbe.compcore.files.model_file import load_model
    from abbe.daemon.answers.measurements import gauges as answer
    from abbe.daemon.arguments.assignments import tool_offset
    from abbe.daemon.outputs import REPORT, check_outputs

    say = check_outputs([file, model], [(report, REPORT)], force=force, as_json=as_json)
    loaded = None if model is None else load_model(model)
    found = answer.evaluate(
        file,
        loaded,
        None if model is None else model.name,
        tool=tool_offset("tool", tool),
        reduced=reduced,
        unit=unit,
    )
    if report is not None:
        from abbe.daemon.report.measurements.gauges import page

        page(found).write(report)
    if as_json:
        say(json.dumps(answer.as_json(found), ensure_ascii=False))
        return
    for line in answer.as_text(found):
        say(line)
    if report is not None:
        say(f"written: {report}")
