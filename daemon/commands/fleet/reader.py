"""``abbe fleet reader``: a role that may look at some sites."""

from __future__ import annotations

from typing import Annotated

import typer

from abbe.daemon.arguments.fleet import PasswordFile, StoreUrl, require_store


def register(fleet: typer.Typer) -> None:
    """Add the command to the group."""
    fleet.command("reader")(reader)


def reader(
    role: Annotated[str, typer.Argument(help="Made where there is none.", metavar="ROLE")],
    sites: Annotated[
        list[str], typer.Option("--site", help="That it sees; may be repeated; '*': all.")
    ],
    password_file: PasswordFile = None,
    store: StoreUrl = "",
) -> None:
    """Let a role look at all machines of some sites, and at no others; it writes nothing.

    An example: abbe fleet reader quality --site "Plant 2" --password-file quality.secret
    """
    from abbe.daemon.fleet.store.connecting import opened_store
    from abbe.daemon.fleet.store.roles import add_reader, secret_of

    url = require_store(store)
    secret = "" if password_file is None else secret_of(password_file)
    with opened_store(url, writing=True) as connection:
        add_reader(connection, role, sites, secret)
    typer.echo(f"{role} sees {', '.join(sites)}")
