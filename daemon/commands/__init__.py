"""The commands of ``abbe``, one file each, in rooms by subject; each has ``register(app)``."""

from __future__ import annotations

from importlib import import_module

import typer

NAMES = (
    "demo",
    "run",
    "service",
    "records",
    "token",
    "live.status",
    "live.switch",
    "live.enter",
    "live.datum",
    "check",
    "model.new",
    "model.fit",
    "model.compare",
    "model.diagnose",
    "model.add",
    "model.remove",
    "model.history",
    "effects",
    "measurements.plan",
    "measurements.import_campaign",
    "measurements.iso230",
    "measurements.iso10360",
    "measurements.gauges",
    "measurements.iso10791",
    "measurements.check_point",
    "correct",
    "error_map",
    "tables.table",
    "tables.watch_tables",
    "tables.upload",
    "tables.controllers",
    "maps.import_map",
    "maps.import_grid",
    "maps.identify_convention",
)
"""The commands' modules, in the order in which ``abbe --help`` lists them."""


def register(app: typer.Typer) -> None:
    """Add every command to the application."""
    for name in NAMES:
        import_module(f"abbe.daemon.commands.{name}").register(app)
