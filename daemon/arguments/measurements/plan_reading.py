"""Arguments of commands that read a plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

PlanFile = Annotated[Path, typer.Argument(help="Plan, from abbe plan.", metavar="PLAN.toml")]
OnlySetups = Annotated[
    list[str] | None, typer.Option(help="Only this set-up; may be repeated.", metavar="NAME")
]
