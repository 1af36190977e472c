"""Options of the commands that read or write a controller's tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

ControllerName = Annotated[
    str,
    typer.Option(
        "--controller", help="The tables' dialect; `abbe controllers` lists them.", metavar="NAME"
    ),
]
Folder = Annotated[Path, typer.Option("-o", "--out", help="Folder for the files.", metavar="DIR")]
WorkingVolume = Annotated[
    list[str] | None,
    typer.Option(
        help="Working volume, mm (rotary: degrees); the travel where not given.",
        metavar="AXIS=LOW,HIGH",
    ),
]
MostPoints = Annotated[
    int | None,
    typer.Option(min=2, max=100_000, help="Most points of a table; otherwise as many as it takes."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help="Option of the controller.", metavar="KEY=VALUE"),
]
MadeBy = Annotated[str, typer.Option(help="Who makes them, for the record.")]
