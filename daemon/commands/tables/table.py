"""``abbe table``: compensation tables in a controller's own format, the best that it can hold."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from abbe.compcore.sentences import said
from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.options import AsJson, Force, ModelFile, Report
from abbe.daemon.arguments.tables.options import (
    ControllerName,
    Folder,
    MadeBy,
    MostPoints,
    Settings,
    WorkingVolume,
)


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("table")(table)


def table(
    model: ModelFile,
    controller: ControllerName,
    out: Folder,
    at: Annotated[
        list[str] | None,
        typer.Option(
            help="Conditions: SIGNAL=VALUE, comma-separated or repeated; `reference` puts all "
            "temperatures at the reference temperature.",
            metavar="SIGNAL=VALUE",
        ),
    ] = None,
    tool: Annotated[str, typer.Option(help="Tool or probe offset, mm.", metavar="X,Y,Z")] = "0,0,0",
    volume: WorkingVolume = None,
    points: MostPoints = None,
    tolerance: Annotated[
        float,
        typer.Option(
            callback=within(1e-3, 1e3, "µm"), help="Interpolation error that is small enough, µm."
        ),
    ] = 0.1,
    on: Annotated[
        Path | None,
        typer.Option(
            help="Tables that were active while the machine was measured; the new ones are added.",
            metavar="DIR_OR_FILE",
        ),
    ] = None,
    orientation: Annotated[
        bool,
        typer.Option(
            help="Rotary axes' tables turn the tool's direction back, as far as they can."
        ),
    ] = False,
    settings: Settings = None,
    by: MadeBy = "",
    note: Annotated[str, typer.Option(help="A remark for the record.")] = "",
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Make compensation tables for a controller: those that leave least of the error.

    An example: abbe table model.toml --controller linuxcnc -o tables --at T_x=21.5,T_y=21.8
    """
    from abbe.compcore.files.model_file import load_model
    from abbe.compcore.tables.field import table_state
    from abbe.compcore.tables.volume import Volume
    from abbe.daemon.answers.model.expected_times import making_tables
    from abbe.daemon.answers.tables import words as answer
    from abbe.daemon.answers.tables.make import TableRequest, make
    from abbe.daemon.arguments.assignments import tool_offset
    from abbe.daemon.arguments.ranges import ranges
    from abbe.daemon.arguments.tables import arguments
    from abbe.daemon.outputs import REPORT, check_folder
    from abbe.daemon.progress import shown
    from abbe.drivers.controllers import make_controller

    checked = partial(
        check_folder, out, [model, on], [(report, REPORT)], force=force, as_json=as_json
    )
    say = checked({})
    loaded = load_model(model)
    made_for = make_controller(controller, loaded.machine, arguments.options(settings or []))
    request = TableRequest(
        model,
        made_for,
        arguments.options(settings or []),
        table_state(
            loaded.switched(), arguments.signals(at or [], loaded), tool=tool_offset("tool", tool)
        ),
        Volume.of(loaded.machine, ranges(volume or [], loaded.machine)),
        points,
        tolerance * 1e-3,
        arguments.present_files(on, controller) if on is not None else {},
        by,
        note,
        orientation,
    )
    expected = making_tables(len(loaded.machine.structure.axes))
    with shown("making tables", expected) as tell:
        done = make(request, loaded)
        checked(done.made.files)
        written = done.made.write(out)
        if report is not None:
            from abbe.daemon.report.table import table_page

            tell("drawing")
            table_page(done).write(report)
    if as_json:
        say(json.dumps(answer.as_json(done, written), ensure_ascii=False))
        return
    for line in answer.as_text(done, written):
        say(line)
    if report is not None:
        say(said("written: {files}", files=report))
