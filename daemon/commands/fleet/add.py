"""``abbe fleet add``: a machine made known to the store, and the role that writes its records."""

from __future__ import annotations

from typing import Annotated

import typer

from abbe.daemon.arguments.fleet import FleetMachineName, PasswordFile, StoreUrl, require_store


def register(fleet: typer.Typer) -> None:
    """Add the command to the group."""
    fleet.command("add")(add)


def add(
    machine: FleetMachineName,
    site: Annotated[str, typer.Option("--site", help="Where it stands.")],
    kind: Annotated[str, typer.Option("--type", help="Its type, spelled alike for all alike.")],
    role: Annotated[
        str, typer.Option("--role", help="That its service writes as; made where there is none.")
    ] = "",
    password_file: PasswordFile = None,
    store: StoreUrl = "",
) -> None:
    """Make a machine known to the store, and a role that writes its records and no others.

    An example: abbe fleet add "Mill 7" --site "Plant 2" --type "VMC 850" --role abbe_mill_7
    --password-file mill-7.secret
    """
    from abbe.compcore.errors import InputError
    from abbe.daemon.fleet.store.connecting import opened_store
    from abbe.daemon.fleet.store.roles import add_machine, secret_of

    for option, text in (("MACHINE", machine), ("--site", site), ("--type", kind)):
        if not text.strip() or text != text.strip() or not text.isprintable():
            raise InputError("not a name", field=option, found=text, expected="printable words")
    url = require_store(store)
    secret = "" if password_file is None else secret_of(password_file)
    with opened_store(url, writing=True) as connection:
        add_machine(connection, machine, site, kind, role, secret)
    typer.echo(f"{machine} ({kind}, site {site}) is known" + (f"; {role} writes it" * bool(role)))
    if role:
        typer.echo("In its configuration, beside [records]:")
        typer.echo("[fleet]")
        typer.echo(f'url = "{_without_user(url)}"')
        typer.echo(f'site = "{site}"\nmachine = "{machine}"\nuser = "{role}"')
        if password_file is not None:
            typer.echo(f'password_file = "{password_file.name}"')


def _without_user(url: str) -> str:
    from psycopg.conninfo import conninfo_to_dict

    known = conninfo_to_dict(url)
    port = f":{known['port']}" if "port" in known else ""
    return f"postgresql://{known.get('host', 'HOST')}{port}/{known.get('dbname', 'abbe')}"
