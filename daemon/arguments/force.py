"""The option ``--force`` of every command that writes files."""

from __future__ import annotations

from typing import Annotated

import typer

Force = Annotated[
    bool, typer.Option("--force", help="Overwrite also what is no file of Abbe; never an input.")
]
