"""``abbe import-grid``: errors that others measured, as a grid or as tables, become a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.options import Force, MachineName, NewModel
from abbe.daemon.arguments.tables.options import ControllerName, Settings


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("import-grid")(import_grid)


def import_grid(
    files: Annotated[
        list[Path],
        typer.Argument(help="The files, or one folder with nothing else.", metavar="FILE..."),
    ],
    controller: ControllerName,
    out: NewModel,
    onto: Annotated[
        Path | None,
        typer.Option(help="A model to which the errors are added.", metavar="MODEL.toml"),
    ] = None,
    structure: Annotated[
        str | None, typer.Option(help='Without --onto, the structure code: "w b Y X Z t".')
    ] = None,
    travel: Annotated[
        list[str] | None,
        typer.Option(
            help="Travel, mm (rotary: degrees); where not given, the grid's.",
            metavar="AXIS=LOW,HIGH",
        ),
    ] = None,
    name: MachineName = "",
    tool: Annotated[
        str, typer.Option(help="Tool with which a grid was measured, mm.", metavar="X,Y,Z")
    ] = "0,0,0",
    settings: Settings = None,
    force: Force = False,
) -> None:
    """Take errors that others measured into a model as they are, as one effect `error_grid`.

    An example: abbe import-grid volcomp.txt --controller etalon-exchange --structure "w b Y X Z t"
    -o model.toml
    """
    from abbe.compcore.files.model_file import save_model
    from abbe.daemon.answers.maps.import_grid import GridRequest, imported
    from abbe.daemon.arguments.assignments import tool_offset
    from abbe.daemon.arguments.tables import arguments
    from abbe.daemon.outputs import MODEL, check_outputs

    if (onto is None) == (structure is None):
        raise typer.BadParameter('give --onto MODEL.toml or --structure "w b Y X Z t"')
    if onto is not None and (travel or name):
        raise typer.BadParameter("--travel and --name go with --structure; --onto has its own")
    say = check_outputs([*files, onto], [(out, MODEL)], force=force)
    request = GridRequest(
        files,
        controller,
        arguments.options(settings or []),
        tool_offset("tool", tool),
        out,
        onto,
        structure or "",
        travel or [],
        name,
    )
    model, reported = imported(request)
    save_model(model, out)
    for line in reported:
        say(line)
