"""Who may do what in the store: writers of one machine, readers of some sites."""

from __future__ import annotations

import os
import secrets
from collections.abc import Sequence
from pathlib import Path

from psycopg import sql

from abbe.compcore.errors import InputError
from abbe.daemon.fleet.store.connecting import Store
from abbe.daemon.side_process.secret import password

EVERY_SITE = "*"
"""Stands for all sites, also those to come."""
_BITS = 256


def secret_of(path: Path) -> str:
    """The password in a file; a new one where there is no file yet, which only its owner reads.

    Raises
    ------
    InputError
        For a file that cannot be used.
    """
    try:
        if not path.exists():
            made = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
            with os.fdopen(made, "w", encoding="ascii") as file:
                file.write(secrets.token_urlsafe(_BITS // 8) + "\n")
        found = password(path)
    except (OSError, ValueError) as error:
        text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError(f"no password: {text}", file=path, field="--password-file") from None
    if not found:
        raise InputError("holds no password", file=path, field="--password-file")
    return found


def add_machine(store: Store, name: str, site: str, kind: str, role: str, secret: str) -> int:
    """Make a machine known, or give one that is another type or writer; returns its number.

    Parameters
    ----------
    store
        Connected as an administrator.
    name, site, kind
        The machine, where it stands, its type.
    role
        That writes its records, and nothing else; empty: none.
    secret
        Its password; empty: as it is.
    """
    with store.transaction():
        row = store.execute(
            "INSERT INTO abbe.machines (site, name, type) VALUES (%s, %s, %s) "
            "ON CONFLICT (site, name) DO UPDATE SET type = excluded.type RETURNING machine",
            (site, name, kind),
        ).fetchone()
        assert row is not None  # noqa: S101  (RETURNING of an upsert gives its row)
        number = int(row[0])
        if role:
            _login(store, role, "abbe_writer", secret)
            store.execute(
                "INSERT INTO abbe.access (role, machine) VALUES (%s, %s) ON CONFLICT DO NOTHING",
                (role, number),
            )
    return number


def add_reader(store: Store, role: str, sites: Sequence[str], secret: str) -> None:
    """Let a role see everything of some sites, and no other.

    Parameters
    ----------
    store
        Connected as an administrator.
    role
        That may look.
    sites
        ``*``: all of them.
    secret
        Its password; empty: as it is.
    """
    with store.transaction():
        _login(store, role, "abbe_reader", secret)
        store.execute("DELETE FROM abbe.access WHERE role = %s AND site IS NOT NULL", (role,))
        for site in sites:
            store.execute("INSERT INTO abbe.access (role, site) VALUES (%s, %s)", (role, site))


def _login(store: Store, role: str, group: str, secret: str) -> None:
    name = sql.Identifier(role)
    there = store.execute("SELECT 1 FROM pg_roles WHERE rolname = %s", (role,)).fetchone()
    if there is None:
        store.execute(sql.SQL("CREATE ROLE {} LOGIN").format(name))
    if secret:
        # what the server keeps and logs is no password, but what one can be checked against
        encrypted = store.pgconn.encrypt_password(secret.encode(), role.encode(), b"scram-sha-256")
        store.execute(
            sql.SQL("ALTER ROLE {} PASSWORD {}").format(name, sql.Literal(encrypted.decode()))
        )
    store.execute(sql.SQL("GRANT {} TO {}").format(sql.Identifier(group), name))
