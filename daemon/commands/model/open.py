"""``abbe open``: the workbench in a browser on this computer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.lists import ListOptions
from abbe.daemon.arguments.options import HoldoutFiles, OpenBrowser, WorkbenchPort

if TYPE_CHECKING:
    from abbe.daemon.workbench.views import WorkbenchViews


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("open", cls=ListOptions)(open_workbench)


def open_workbench(
    file: Annotated[
        Path | None,
        typer.Argument(
            help="The model that is compared; or the configuration of a run, which names its "
            "model. Without it: the run of this computer.",
            metavar="[MODEL.toml|CONFIG.toml]",
        ),
    ] = None,
    campaigns: Annotated[
        list[Path] | None, typer.Argument(help="Campaigns.", metavar="[CAMPAIGN.csv]...")
    ] = None,
    holdout: HoldoutFiles = None,
    versions: Annotated[
        Path | None,
        typer.Option(
            "--versions",
            help="Folder for the versions that are made; without it nothing is written.",
            metavar="FOLDER",
        ),
    ] = None,
    tables: Annotated[
        Path | None,
        typer.Option(
            help="Tables that `abbe table` wrote, to be looked at and uploaded; with a "
            "configuration.",
            metavar="FOLDER",
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Folder of `abbe calibrate`, begun or not; with a configuration.",
            metavar="FOLDER",
        ),
    ] = None,
    port: WorkbenchPort = 0,
    session: Annotated[
        float,
        typer.Option(
            help="Hours after which a browser has to enter anew in which nobody did anything.",
            callback=within(0.001, 1e6, "h"),
            metavar="HOURS",
        ),
    ] = 12.0,
    browser: OpenBrowser = True,
) -> None:
    """See a run live; compare, learn what is missing, try it, add it, watch, upload, calibrate.

    Served to a browser on this computer alone and without the internet. Ctrl-C ends it.
    """
    from abbe.daemon.progress import shown

    with shown("reading"):
        from abbe.compcore.errors import AbbeError
        from abbe.daemon.commands.calibration import step_child
        from abbe.daemon.commands.calibration.guide import steps_now
        from abbe.daemon.workbench.calibration.guide import CalibrationGuide
        from abbe.daemon.workbench.live.view import LiveView
        from abbe.daemon.workbench.opened import what_to_open
        from abbe.daemon.workbench.session.workbench import Workbench
        from abbe.daemon.workbench.tables.desk import TableDesk
        from abbe.daemon.workbench.views import WorkbenchViews

        found = what_to_open(file, campaigns or [], holdout or [], versions, tables, calibration)
        bench = None
        if found.model is not None:
            at_once = found.config is None
            try:
                bench = Workbench(
                    found.model, campaigns or [], holdout or [], versions,
                    near=found.near, at_once=at_once,
                )  # fmt: skip
            except AbbeError:
                # a run is looked at also where its model cannot be read: the live view says so
                if found.config is None or campaigns or versions is not None:
                    raise
        live = LiveView(found.config, first=bench is None or found.config is not None)
        desk = None
        if found.config is not None and (tables is not None or found.uploads):
            desk = TableDesk(found.config, tables)
        guide = None
        if found.config is not None and calibration is not None:
            guide = CalibrationGuide(found.config, calibration, steps_now, step_child.__name__)
    show_views(WorkbenchViews(live, bench, desk, guide), port, session=session, browser=browser)


def show_views(
    views: WorkbenchViews, port: int, *, session: float = 12.0, browser: bool = True
) -> None:
    """Serve a workbench until it is ended, and say where it is.

    Parameters
    ----------
    views
        What is shown.
    port
        TCP port; 0: any.
    session
        Hours after which a browser has to enter anew in which nobody did anything.
    browser
        Whether to open the person's own.
    """
    from abbe.daemon.workbench.entrance.address import listening
    from abbe.daemon.workbench.serve import serve

    first = True

    def invite(address: str) -> None:
        nonlocal first
        if not first:
            typer.echo(f"for another browser: {address}")
            return
        first = False
        typer.echo(f"The workbench is open at  {address}")
        typer.echo("Ctrl-C ends it.")
        if browser:
            _show(address)

    with listening(port) as made:
        serve(views, made, invite, session=session)
    typer.echo("The workbench is closed.")


def _show(address: str) -> None:
    """Open the person's own browser, which is told nothing but the address."""
    import threading
    import webbrowser

    # the browser asks before the server is at its work; it waits, but must not be waited for
    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
