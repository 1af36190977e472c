"""``abbe fleet open``: the workbench over what the store knows of a machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.fleet import FleetMachineName, Site, StoreUrl, require_store
from abbe.daemon.arguments.options import OpenBrowser, WorkbenchPort


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

    from abbe.compcore.errors import InputError
    from abbe.daemon.commands.model.open import open_workbench
    from abbe.daemon.fleet.asked.reading import FleetStore
    from abbe.daemon.fleet.asked.taken_out import take_out
    from abbe.daemon.fleet.store.connecting import opened_store

    with tempfile.TemporaryDirectory(prefix="abbe-fleet-") as made:
        with opened_store(require_store(store)) as connection:
            asked = FleetStore(connection)
            found = take_out(asked, asked.machine(machine, site), Path(made))
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
        open_workbench(found.model, chosen, port=port, browser=browser)
