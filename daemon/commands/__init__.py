"""The commands of ``abbe``, one file each, in rooms by subject; each has ``register(app)``.

A file bears the name of its command, with ``_`` for ``-``.
"""

from __future__ import annotations

from importlib import import_module

import typer

SECTIONS = {
    "Look around": ("demo", "model.open", "check", "effects"),
    "From measurements to a model that explains them": (
        "model.new",
        "model.fit",
        "model.compare",
        "model.diagnose",
        "model.add",
        "model.remove",
        "model.history",
    ),
    "Measure, and prove it": (
        "calibrate",
        "measurements.plan",
        "measurements.program",
        "measurements.measure",
        "measurements.verify",
        "measurements.uncertainty",
        "measurements.import_campaign",
        "measurements.check_point",
    ),
    "Correct a machine live": (
        "run",
        "live.status",
        "live.switch",
        "live.enter",
        "live.datum",
        "records",
        "service",
        "token",
    ),
    "Correct it by its controller's tables": (
        "tables.table",
        "tables.upload",
        "tables.watch_tables",
        "tables.controllers",
    ),
    "Figures of the standards": (
        "measurements.iso230",
        "measurements.iso10360",
        "measurements.iso10791",
        "measurements.gauges",
    ),
    "Single points, planes, maps of others": (
        "correct",
        "error_map",
        "maps.import_map",
        "maps.import_grid",
        "maps.identify_convention",
    ),
    "Many machines": ("fleet",),
}
"""Title → the commands' modules, in the order in which ``abbe --help`` lists them."""
NAMES = tuple(name for names in SECTIONS.values() for name in names)


def register(app: typer.Typer, word: str = "") -> None:
    """Add the command of a name to the application; of no command's name, every one.

    What typer works out of forty commands' arguments takes longer than one command's answer.
    """
    asked = [name for name in NAMES if _word(name) == word]
    for name in asked or NAMES:
        import_module(f"abbe.daemon.commands.{name}").register(app)


def sections() -> dict[str, tuple[str, ...]]:
    """Title → the commands as they are typed."""
    return {title: tuple(_word(n) for n in names) for title, names in SECTIONS.items()}


def _word(name: str) -> str:
    return name.rpartition(".")[2].replace("_", "-")
