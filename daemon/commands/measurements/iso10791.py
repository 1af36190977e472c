"""``abbe iso10791``: rotary axes from R-test or ball bar, by ISO 10791-6."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.options import AsJson, Force, Report


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("iso10791")(iso10791)


def iso10791(
    model: Annotated[
        Path,
        typer.Argument(help="The machine, as its controller knows it.", metavar="MODEL.toml"),
    ],
    files: Annotated[
        list[Path], typer.Argument(help="Readings, CSV, or campaigns.", metavar="READINGS.csv")
    ],
    nest: Annotated[
        str | None, typer.Option(help="What carries the sensors: spindle or table.")
    ] = None,
    directions: Annotated[
        str | None,
        typer.Option(help="dX, dY, dZ along the nest's directions, or the machine's."),
    ] = None,
    axis: Annotated[
        str | None, typer.Option(help="About which axis radial and tangential are meant.")
    ] = None,
    placed: Annotated[
        bool,
        typer.Option("--placed", help="Spheres are where stated, the nest's zero is their middle."),
    ] = False,
    tool: Annotated[
        str, typer.Option(help="Tool offset x,y,z in mm, where the file has none.")
    ] = "0,0,0",
    sd: Annotated[
        float | None,
        typer.Option(callback=within(1e-6, 1e5, "µm"), help="Uncertainty of a reading, µm."),
    ] = None,
    sign: Annotated[int, typer.Option(help="-1 where the readings count the other way.")] = 1,
    unit: Annotated[str | None, typer.Option(help="Unit of the readings.")] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The readings as a campaign.", metavar="OUT.csv"),
    ] = None,
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Evaluate an R-test or ball bar on rotary axes: where their lines lie, how they err.

    An example: abbe iso10791 machine.toml rtest.csv --nest spindle --report page.html
    """
    from abbe.compcore.files.campaign_file import write_campaign
    from abbe.compcore.files.importers.rotary.rotary_test import RotaryTestOptions
    from abbe.compcore.files.model_file import load_model
    from abbe.daemon.answers.measurements import iso10791 as answer
    from abbe.daemon.arguments.measurements.foreign_placing import foreign_placing
    from abbe.daemon.outputs import CAMPAIGN, REPORT, check_outputs

    placing = foreign_placing("", tool, "", sd, (), sign, rotation=False)
    say = check_outputs(
        [model, *files], [(report, REPORT), (output, CAMPAIGN)], force=force, as_json=as_json
    )
    options = RotaryTestOptions(nest, directions, axis, unit, placed)
    loaded = load_model(model)
    found = answer.evaluate(loaded.machine, files, placing, options)
    if output is not None:
        write_campaign(found.campaign, output)
    if report is not None:
        from abbe.daemon.report.head import file_on_page, head_of
        from abbe.daemon.report.measurements.iso10791 import page

        page(found, head_of(loaded, [file_on_page("model", model)], found.campaign)).write(report)
    if as_json:
        say(json.dumps(answer.as_json(found), ensure_ascii=False))
        return
    for line in answer.as_text(found):
        say(line)
    for path in (output, report):
        if path is not None:
            say(f"written: {path}")
