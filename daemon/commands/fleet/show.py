"""``abbe fleet show``: what the store knows of one machine."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.fleet import FleetMachineName, Site, StoreUrl, require_store
from abbe.daemon.arguments.options import AsJson


def register(fleet: typer.Typer) -> None:
    """Add the command to the group."""
    fleet.command("show")(show)


def show(
    machine: FleetMachineName,
    store: StoreUrl = "",
    site: Site = "",
    days: Annotated[
        float, typer.Option(callback=within(0.001, 36500.0, "days"), help="Days of history.")
    ] = 1.0,
    as_json: AsJson = False,
) -> None:
    """One machine: health, alarms, models, campaigns, history, last events.

    An example: abbe fleet show "Mill 7"
    """
    from abbe.daemon.answers.fleet import one_machine as answer
    from abbe.daemon.fleet.asked.reading import FleetStore
    from abbe.daemon.fleet.store.connecting import opened_store

    with opened_store(require_store(store)) as connection:
        asked = FleetStore(connection)
        found = answer.one_machine(asked, asked.machine(machine, site), days)
    if as_json:
        typer.echo(json.dumps(found, ensure_ascii=False))
        return
    for line in answer.lines(found):
        typer.echo(line)
