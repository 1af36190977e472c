"""``abbe error-map``: the errors of a plane, at any temperatures and with any tool."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.options import AsJson, Force, ModelFile, Report


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("error-map")(error_map)


def error_map(
    model: ModelFile,
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            help="Z=30: where the other axes stand, mm (rotary: degrees; the middle of the travel "
            "where not given); tool=x,y,z, SIGNAL=.., X_dir=1 or -1, time=.. as for abbe correct.",
            metavar="[KEY=VALUE]...",
        ),
    ] = None,
    plane: Annotated[str, typer.Option(help="The two linear axes that span it.")] = "XY",
    temperature: Annotated[
        str | None,
        typer.Option(
            help="Of all thermometers that are not given, °C; several make a map each: 20,19.",
            metavar="T[,T]...",
        ),
    ] = None,
    limits: Annotated[
        list[str] | None,
        typer.Option(
            "--range",
            help="X=0,400: a part of the travel, mm; once for each axis of the plane.",
            metavar="AXIS=LOW,HIGH",
        ),
    ] = None,
    points: Annotated[int, typer.Option(min=2, max=41, help="Points along each axis.")] = 15,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="Every point with its error and ±.", metavar="CSV"),
    ] = None,
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Draw the error map of a plane: errors on a grid, the pair of points whose distance errs most.

    An example: abbe error-map model.toml Z=30 tool=0,0,-80 --temperature 20,19 --report map.html
    """  # fmt: skip
    from abbe.compcore.files.model_file import load_model
    from abbe.compcore.files.text.atomic import write_atomically
    from abbe.daemon.answers import error_map as answer
    from abbe.daemon.arguments import plane_arguments as read
    from abbe.daemon.arguments.point_arguments import doubts
    from abbe.daemon.outputs import ERROR_MAP, REPORT, check_outputs

    say = check_outputs([model], [(out, ERROR_MAP), (report, REPORT)], force=force, as_json=as_json)
    loaded = load_model(model)
    across = read.axes_of(plane, loaded.machine)
    warmth = [] if temperature is None else read.temperatures(temperature, loaded.machine)
    planes, given = read.planes(loaded, across, arguments or [], limits or [], points, warmth)
    mapped = answer.map_planes(loaded, planes)
    warnings = list(dict.fromkeys([*doubts(loaded, given), *answer.notes_of(mapped)]))
    for warning in warnings:
        typer.echo(f"abbe: note: {warning}", err=True)
    if report is not None:
        from abbe.daemon.report.error_map import error_map_page
        from abbe.daemon.report.head import file_on_page, head_of

        head = head_of(loaded, [file_on_page("model", model)])
        error_map_page(loaded, mapped, warnings, head).write(report)
    if out is not None:
        write_atomically(out, answer.csv_lines(loaded, mapped))
    if as_json:
        say(json.dumps(answer.as_json(mapped, warnings), ensure_ascii=False))
        return
    for line in answer.as_text(loaded, mapped):
        say(line)
    if written := [str(path) for path in (out, report) if path is not None]:
        say(f"written: {', '.join(written)}")
