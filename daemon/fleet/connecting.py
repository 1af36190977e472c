"""Connections to the store: of a service by its configuration, of a person by a URL."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psycopg
from psycopg.conninfo import conninfo_to_dict

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.side_process.secret import password

Store = psycopg.Connection[Any]
"""A connection to a store."""
_KEEPALIVE = 30
"""s without a word after which the store is asked whether it is there."""


def connect(task: Mapping[str, Any]) -> Store:
    """Connect as a service does.

    Parameters
    ----------
    task
        As `FleetSetup.task` makes it.

    Raises
    ------
    psycopg.Error
        When the store cannot be reached, or does not let it in.
    ValueError, OSError
        For a password file that cannot be used.
    """
    timeout = float(task["timeout"])
    keys: dict[str, Any] = {
        "host": task["host"],
        "port": task["port"],
        "dbname": task["database"],
        "user": task["user"],
        "connect_timeout": max(2, round(timeout)),
        # what the kernel has not got rid of by then is lost
        "tcp_user_timeout": round(1e3 * timeout),
        "keepalives_idle": _KEEPALIVE,
        "application_name": f"abbe {task['machine']}"[:60],
        "sslmode": "verify-full" if task["tls"] else "disable",
        "options": _bounds(timeout),
    }
    if task["tls"]:
        keys["sslrootcert"] = task.get("ca", "system")
    for key, ours in (("sslcert", "certificate"), ("sslkey", "key")):
        if ours in task:
            keys[key] = task[ours]
    if "password_file" in task:
        keys["password"] = password(Path(task["password_file"]))
    return psycopg.connect(**keys, autocommit=True)


def _bounds(timeout: float) -> str:
    """What the server itself gives up after, so that no lock is held for ever."""
    limit = round(1e3 * timeout)
    names = ("statement_timeout", "lock_timeout", "idle_in_transaction_session_timeout")
    return " ".join(f"-c {name}={limit}" for name in names) + " -c client_encoding=UTF8"


@contextmanager
def opened_store(url: str, *, writing: bool = False) -> Iterator[Store]:
    """A store, as a person names it: ``postgresql://USER@HOST/DATABASE``; closed afterwards.

    What the URL leaves out stands where PostgreSQL's own programs look for it: ``~/.pgpass``,
    ``PGPASSWORD``, ``PGSSLMODE`` and so on.

    Parameters
    ----------
    url
        Of the store.
    writing
        Whether anything is to be changed; else the store itself refuses it.

    Raises
    ------
    InputError
        For what is no such URL.
    AbbeError
        When the store cannot be reached, or refuses something.
    """
    try:
        known: dict[str, Any] = dict(conninfo_to_dict(url))
    except psycopg.Error as error:
        raise InputError(
            f"not a store: {one_line(error)}",
            field="--store",
            found=url,
            expected="postgresql://USER@HOST/DATABASE",
        ) from None
    known.setdefault("connect_timeout", 10)
    known.setdefault("application_name", "abbe fleet")
    try:
        with psycopg.connect(**known, autocommit=True) as connection:
            connection.read_only = not writing
            yield connection
    except psycopg.Error as error:
        raise AbbeError(f"the plant's store: {one_line(error)}") from None


def one_line(error: BaseException) -> str:
    """What is wrong, in one line, without the server's hints."""
    text = str(error).strip() or type(error).__name__
    return " ".join(text.splitlines()[0].split())[:300]
