"""``abbe watch-tables``: a machine is followed, and its tables made anew when it has warmed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.options import Force
from abbe.daemon.arguments.tables.options import (
    ControllerName,
    Folder,
    MadeBy,
    MostPoints,
    Settings,
    WorkingVolume,
)


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("watch-tables")(watch_tables)


def watch_tables(
    config: Annotated[
        Path,
        typer.Argument(
            help="The daemon's configuration: where signals are read.", metavar="CONFIG.toml"
        ),
    ],
    controller: ControllerName,
    out: Folder,
    volume: WorkingVolume = None,
    points: MostPoints = None,
    settings: Settings = None,
    by: MadeBy = "",
    change: Annotated[
        float,
        typer.Option(
            callback=within(0.01, 1e5, "µm"),
            help="Change of the predicted error anywhere, µm, that asks for new tables.",
        ),
    ] = 5.0,
    idle: Annotated[
        float,
        typer.Option(
            callback=within(0.0, 1e6, "s"), help="Seconds without motion that count as idle."
        ),
    ] = 10.0,
    duration: Annotated[
        float | None,
        typer.Option(callback=within(0.1, 1e9, "s"), help="End after so many seconds."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object an event.")] = False,
    force: Force = False,
) -> None:
    """Follow a machine: tables made anew when it has warmed, an upload proposed when it is idle.

    An example: abbe watch-tables config.toml --controller linuxcnc -o tables --change 3
    """
    from abbe.daemon.arguments.ranges import ranges
    from abbe.daemon.arguments.tables import arguments
    from abbe.daemon.config import load_config
    from abbe.daemon.outputs import check_folder
    from abbe.daemon.table_watch.watch import WatchTask, watch

    check_folder(out, [config], [], {}, force=force, as_json=as_json)
    configuration = load_config(config)
    task = WatchTask(
        controller,
        arguments.options(settings or []),
        ranges(volume or [], configuration.model.machine),
        points,
        out,
        by,
        force,
    )
    watch(configuration, task, change * 1e-3, idle, duration, as_json)
