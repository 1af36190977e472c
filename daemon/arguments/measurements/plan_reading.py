"""Arguments of commands that read a plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.bounded import within

PlanFile = Annotated[Path, typer.Argument(help="Plan, from abbe plan.", metavar="PLAN.toml")]
OnlySetups = Annotated[
    list[str] | None, typer.Option(help="Only this set-up; may be repeated.", metavar="NAME")
]
Feed = Annotated[
    float, typer.Option(callback=within(1.0, 20000.0, "mm/min"), help="Of all moves, mm/min.")
]
Stands = Annotated[
    float | None,
    typer.Option(
        callback=within(0.05, 3600.0, "s"),
        help="How long it stands at a target, s; else as long as the instrument usually needs.",
    ),
]
