"""``abbe fleet init``: the store's tables, made or brought up to date."""

from __future__ import annotations

import typer

from abbe.daemon.arguments.fleet import StoreUrl, require_store


def register(fleet: typer.Typer) -> None:
    """Add the command to the group."""
    fleet.command("init")(init)


def init(store: StoreUrl = "") -> None:
    """Make the store's tables in an empty database, or bring them up to date.

    As a role that may make schemas and roles there. Nothing that is kept is lost; run a second
    time it changes nothing.

    An example: abbe fleet init --store postgresql://admin@127.0.0.1/abbe
    """
    from abbe.daemon.fleet.store.connecting import opened_store
    from abbe.daemon.fleet.store.migrating import migrate

    with opened_store(require_store(store), writing=True) as connection:
        done = migrate(connection)
    for migration in done:
        typer.echo(f"{migration.number:04d} {migration.name}: done")
    if not done:
        typer.echo("the store is up to date")
