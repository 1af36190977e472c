"""``abbe fleet open``: the workbench over what the store knows of a machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.fleet import FleetMachineName, Site, StoreUrl, require_store
from abbe.daemon.arguments.options import OpenBrowser, WorkbenchPort

if TYPE_CHECKING:
    from abbe.daemon.fleet.asked.reading import FleetMachine
    from abbe.daemon.fleet.store.connecting import Store
    from abbe.daemon.workbench.session.origin import FromStore


def register(fleet: typer.Typer) -> None:
    """Add the command to the group."""
    fleet.command("open")(open_from_store)


def open_from_store(
    machine: FleetMachineName,
    campaigns: Annotated[
        list[str] | None,
        typer.Option("--campaign", help="Only this, by its name; may be repeated."),
    ] = None,
    store: StoreUrl = "",
    site: Site = "",
    port: WorkbenchPort = 0,
    browser: OpenBrowser = True,
) -> None:
    """Compare a machine's model with its campaigns, learn what is missing: from the store.

    Model and campaigns are taken out of the store; nothing is written, there or here. Ctrl-C
    ends it.

    An example: abbe fleet open "Mill 7"
    """
    import tempfile
    from contextlib import chdir

    from abbe.compcore.errors import InputError
    from abbe.daemon.commands.model.open import show_views
    from abbe.daemon.fleet.asked.reading import FleetStore
    from abbe.daemon.fleet.asked.taken_out import take_out
    from abbe.daemon.fleet.store.connecting import opened_store
    from abbe.daemon.workbench.session.workbench import Workbench
    from abbe.daemon.workbench.views import WorkbenchViews

    with tempfile.TemporaryDirectory(prefix="abbe-fleet-") as made:
        with opened_store(require_store(store)) as connection:
            asked = FleetStore(connection)
            known = asked.machine(machine, site)
            origin = _origin(connection, known)
            found = take_out(asked, known, Path(made))
        if found.model is None:
            raise InputError("has no model in the store", field="MACHINE", found=machine)
        chosen = [p for p in found.campaigns if not campaigns or p.name in campaigns]
        if not chosen:
            raise InputError(
                "has no such campaign in the store",
                field="--campaign" if campaigns else "MACHINE",
                found=", ".join(campaigns or [machine]),
                expected=", ".join(p.name for p in found.campaigns)
                or "one that [fleet] campaigns = [...] has uploaded",
            )
        # files are named as `abbe fleet files` names them, not by a folder that is gone afterwards
        with chdir(made):
            bench = Workbench(Path(found.model.name), [Path(p.name) for p in chosen], origin=origin)
            typer.echo(f"{origin.place}: {found.model.name} and {_count(len(chosen))}.")
            typer.echo(f"Nothing is written; the files for a new version: {origin.take_out}")
            show_views(WorkbenchViews(bench=bench), port, browser=browser)


def _origin(store: Store, machine: FleetMachine) -> FromStore:
    """Where a machine's files are, and how they are taken out."""
    from shlex import quote

    from abbe.daemon.workbench.session.origin import FromStore

    known = store.info
    command = ["abbe", "fleet", "files", machine.name, "--site", machine.site, "-o"]
    return FromStore(
        f"{known.dbname} at {known.host}: {machine.site}, {machine.name}",
        " ".join([*map(quote, command), "FOLDER"]),
    )


def _count(campaigns: int) -> str:
    return "1 campaign" if campaigns == 1 else f"{campaigns} campaigns"
