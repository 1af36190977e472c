"""``abbe fleet``: the machines of a plant, as its store knows them; one file a subcommand."""

from __future__ import annotations

from importlib import import_module

import typer

SUBCOMMANDS = (
    "overview", "show", "open", "files", "compare", "common", "diagnose", "init", "add", "reader",
)  # fmt: skip
"""Modules of this room, each with ``register(fleet)``."""


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    fleet = typer.Typer(help="The machines of a plant, as its store knows them.")
    for name in SUBCOMMANDS:
        import_module(f"abbe.daemon.commands.fleet.{name}").register(fleet)
    app.add_typer(fleet, name="fleet")
