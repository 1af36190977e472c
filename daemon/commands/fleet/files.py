"""``abbe fleet files``: a machine's models and campaigns, taken out of the store."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.fleet import FleetMachineName, Site, StoreUrl, require_store


def register(fleet: typer.Typer) -> None:
    """Add the command to the group."""
    fleet.command("files")(files)


def files(
    machine: FleetMachineName,
    out: Annotated[
        Path, typer.Option("-o", "--out", help="A folder that is not there yet.", metavar="FOLDER")
    ],
    store: StoreUrl = "",
    site: Site = "",
) -> None:
    """Write a machine's models, campaigns and check measurements into a folder.

    An example: abbe fleet files "Mill 7" -o mill-7
    """
    from abbe.compcore.errors import InputError
    from abbe.daemon.fleet.asked.reading import FleetStore
    from abbe.daemon.fleet.asked.taken_out import take_out
    from abbe.daemon.fleet.store.connecting import opened_store

    if out.exists():
        raise InputError("is there already", file=out, field="--out", expected="a new folder")
    with opened_store(require_store(store)) as connection:
        asked = FleetStore(connection)
        taken = take_out(asked, asked.machine(machine, site), out)
    models = [*taken.models, *([taken.model] if taken.model is not None else [])]
    typer.echo(f"{len(models)} models, {len(taken.campaigns)} campaigns: {out}")
    if taken.model is not None:
        typer.echo(f"the one that runs: {taken.model}")
