"""``abbe open``: the workbench in a browser on this computer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.lists import ListOptions
from abbe.daemon.arguments.options import CampaignFiles, HoldoutFiles, ModelFile

_HIGHEST = 65_535


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("open", cls=ListOptions)(open_workbench)


def open_workbench(
    model: ModelFile,
    campaigns: CampaignFiles,
    holdout: HoldoutFiles = None,
    versions: Annotated[
        Path | None,
        typer.Option(
            "--versions",
            help="Folder for the versions that are made; without it nothing is written.",
            metavar="FOLDER",
        ),
    ] = None,
    port: Annotated[
        int, typer.Option(help="Port on 127.0.0.1; 0: any that is free.", max=_HIGHEST, min=0)
    ] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the browser.")
    ] = True,
) -> None:
    """Compare, learn what is missing, try it, add it, watch the error fall: in a browser.

    Served on this computer alone and without the internet. Ctrl-C ends it.
    """
    from importlib.util import find_spec

    from abbe.compcore.errors import AbbeError
    from abbe.daemon.progress import shown

    missing = [name for name in ("fastapi", "uvicorn") if find_spec(name) is None]
    if missing:
        raise AbbeError(f"the workbench needs {' and '.join(missing)}: pip install 'abbe[http]'")
    with shown("reading"):
        from abbe.daemon.workbench.serve import serve
        from abbe.daemon.workbench.session import Workbench

        bench = Workbench(model, campaigns, holdout or [], versions)
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

    serve(bench, port, invite)
    typer.echo("The workbench is closed.")


def _show(address: str) -> None:
    """Open the person's own browser, which is told nothing but the address."""
    import threading
    import webbrowser

    # the browser asks before the server is at its work; it waits, but must not be waited for
    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
