"""``abbe identify-convention``: how a controller applies its map, found from on and off."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.options import AsJson, Squareness


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("identify-convention")(identify_convention)


def identify_convention(
    source: Annotated[
        Path, typer.Argument(help="The map, or a model.", metavar="MAP.txt|MODEL.toml")
    ],
    points: Annotated[
        Path,
        typer.Argument(
            help="Points with the correction read on and off: X,Y,Z,dX,dY,dZ or X_off … X_on ….",
            metavar="POINTS.csv",
        ),
    ],
    structure: Annotated[
        str | None,
        typer.Option(help='Structure code of a map: "w b Y X Z t". Without, every order is tried.'),
    ] = None,
    any_order: Annotated[
        bool, typer.Option("--any-order", help="Try every order of the axes.")
    ] = False,
    squareness: Squareness = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            callback=within(1e-6, 1e6, "µm"),
            help="RMS in µm up to which points count as reproduced.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Which signs, rotation point, chain order and form of squareness a controller uses.

    Drive to points all over the volume, some with a tool or probe offset, and read the display with
    the correction switched on and off.
    """
    from abbe.compcore.errors import InputError
    from abbe.compcore.files.map_file import load_map
    from abbe.compcore.files.model_file import load_model
    from abbe.compcore.files.switched_points import read_switched
    from abbe.compcore.machine.structure import Structure
    from abbe.compcore.maps.conventions.identify import identify
    from abbe.compcore.maps.conventions.subject import MapSubject, ModelSubject, Subject
    from abbe.daemon.answers.maps import identify_convention as answer
    from abbe.daemon.arguments.map_options import squareness_of
    from abbe.daemon.progress import shown

    subject: Subject
    if source.suffix.lower() == ".toml":
        if structure is not None or any_order or squareness:
            raise InputError(
                "a model says its structure and squareness itself",
                file=source,
                expected="--structure, --any-order and --squareness with a map only",
            )
        model = load_model(source)
        subject, code = ModelSubject(model), model.machine.structure
    else:
        compensation = load_map(source)
        if structure is None:
            code, any_order = Structure.parse(f"w b {' '.join(compensation.tables)} t"), True
        else:
            code = Structure.parse(structure)
        beside = squareness_of(squareness or [], compensation, code)
        subject = MapSubject(compensation, beside)
    switched = read_switched(points, subject.machine(code))
    with shown("trying conventions"):
        try:
            found = identify(
                subject,
                switched,
                code,
                any_order=any_order,
                tolerance=None if tolerance is None else tolerance * 1e-3,
            )
        except InputError as error:
            raise error.at(file=source) from None
    is_map = isinstance(subject, MapSubject)
    command = answer.import_command(found, str(source) if is_map else None, squareness or [])
    if as_json:
        typer.echo(json.dumps(answer.as_json(found, command), ensure_ascii=False))
        return
    for line in answer.as_text(found, command):
        typer.echo(line)
