"""The commands of ``abbe``, one file each; every file has ``register(app)``."""

from __future__ import annotations

from importlib import import_module

import typer

NAMES = (
    "demo",
    "run",
    "check",
    "new",
    "fit",
    "compare",
    "diagnose",
    "add",
    "remove",
    "history",
    "effects",
    "import_campaign",
    "iso230",
    "correct",
    "table",
    "watch_tables",
    "upload",
    "controllers",
    "import_map",
    "import_grid",
    "identify_convention",
)
"""The commands' modules, in the order in which ``abbe --help`` lists them."""


def register(app: typer.Typer) -> None:
    """Add every command to the application."""
    for name in NAMES:
        import_module(f"abbe.daemon.commands.{name}").register(app)
