"""``abbe import-map``: a CMM's compensation map becomes a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.options import Force, MachineName, NewModel, Squareness

SIGN_HELP = (
    "A sign opposite to Abbe's: R=-1 all rotations, L=-1 all linear errors, Ry=-1 one column of "
    "every axis, Z.R=-1 or X.Ly=-1 of one axis. May be repeated."
)
POINT_HELP = (
    "From where travels count as levers: zero (the map's), X=200,Z=-150 a point, Z=far the end "
    "farther from zero, low, high."
)
OWN_TRAVEL_HELP = (
    "Whether an axis's own travel is in its lever: structure (workpiece side only), never, always."
)
SQUARENESS_AS_HELP = (
    "How the controller applies what --squareness states: angle (a constant of an angular column; "
    "the default) or gradient (a slope of a straightness column). The map stays as it is."
)
MAP_SQUARENESS_HELP = (
    "For a controller that moves the squareness in the map's own columns: angle or gradient, the "
    "form in which it applies it; as-written otherwise."
)


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("import-map")(import_map)


def import_map(
    file: Annotated[Path, typer.Argument(help="The map.", metavar="MAP.txt")],
    structure: Annotated[
        str, typer.Option(help='Structure code, workpiece to tool: "w b Y X Z t".')
    ],
    out: NewModel,
    name: MachineName = "",
    sign: Annotated[list[str] | None, typer.Option(help=SIGN_HELP)] = None,
    rotation_point: Annotated[str, typer.Option(help=POINT_HELP)] = "zero",
    own_travel: Annotated[str, typer.Option(help=OWN_TRAVEL_HELP)] = "structure",
    squareness: Squareness = None,
    squareness_as: Annotated[str | None, typer.Option(help=SQUARENESS_AS_HELP)] = None,
    map_squareness: Annotated[str, typer.Option(help=MAP_SQUARENESS_HELP)] = "as-written",
    force: Force = False,
) -> None:
    """Turn a compensation map in a vendor's conventions into a model in Abbe's own, exactly.

    Which conventions a controller follows: abbe identify-convention.
    """
    from dataclasses import replace
    from hashlib import sha256

    from abbe.compcore.files.map_file import load_map
    from abbe.compcore.files.model_file import save_model
    from abbe.compcore.machine.structure import Structure
    from abbe.compcore.maps.to_model import import_map as imported
    from abbe.daemon.arguments.map_options import convention_of, squareness_of
    from abbe.daemon.installed import abbe_version
    from abbe.daemon.outputs import MODEL, check_outputs

    say = check_outputs([file], [(out, MODEL)], force=force)
    compensation = load_map(file)
    code = Structure.parse(structure)
    beside = squareness_of(squareness or [], compensation, code)
    convention = convention_of(
        compensation,
        code,
        signs=sign or [],
        rotation_point=rotation_point,
        own_travel=own_travel,
        map_squareness=map_squareness,
        squareness_as=squareness_as,
        stated=bool(beside),
    )
    model = imported(compensation, code, convention, squareness=beside, name=name or file.stem)
    origin = {
        "map": file.name,
        "sha256": sha256(file.read_bytes()).hexdigest(),
        "convention": " ".join(
            [convention.options(code.linear) or "Abbe's own"]
            + [f"--squareness {text}" for text in squareness or []]
        ),
        "abbe": abbe_version(),
    }
    save_model(replace(model, fit=origin), out)
    rows = ", ".join(f"{a} {len(t.positions)} rows" for a, t in compensation.tables.items())
    say(f"{out}: {code}, {len(model.terms)} effects ({rows}), {origin['convention']}")
