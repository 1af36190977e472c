"""The commands of ``abbe``, one file each, in rooms by subject; each has ``register(app)``.

A file bears the name of its command, with ``_`` for ``-``.
"""

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
    "calibrate",
    "model.new",
    "model.fit",
    "model.compare",
    "model.diagnose",
    "model.add",
    "model.remove",
    "model.history",
    "model.open",
    "effects",
    "measurements.plan",
    "measurements.program",
    "measurements.measure",
    "measurements.verify",
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


def register(app: typer.Typer, word: str = "") -> None:
    """Add the command of a name to the application; of no command's name, every one.

    What typer works out of forty commands' arguments takes longer than one command's answer.
    """
    asked = [name for name in NAMES if _word(name) == word]
    for name in asked or NAMES:
        import_module(f"abbe.daemon.commands.{name}").register(app)


def _word(name: str) -> str:
    return name.rpartition(".")[2].replace("_", "-")
