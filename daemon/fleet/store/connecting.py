"""Connections to the store: of a service by its configuration, of a person by a URL."""

from __future__ import annotations

import os
import socket
import ssl
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psycopg
from psycopg.conninfo import conninfo_to_dict

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.side_process.secret import password
from abbe.drivers.resources import on_this_computer

Store = psycopg.Connection[Any]
"""A connection to a store."""
_KEEPALIVE = 30
"""s without a word after which the store is asked whether it is there."""
_LATER_THAN_THE_STORE = 2.0
"""So many times the time after which the store itself gives up a statement."""


class _AnsweredInTime(psycopg.Connection[Any]):
    """A connection that is lost when an answer does not come in time.

    The store gives up a statement by itself, but not while it stands still, nor where what lies
    between (a pool, a balancer) has lost it; their computers go on to acknowledge what is sent.
    """

    longest: float = 0.0
    """s from a question to its answer; 0: any."""

    def wait(self, *arguments: Any, **keys: Any) -> Any:
        """As psycopg waits for whatever comes, for so long."""
        if not self.longest:
            return super().wait(*arguments, **keys)
        lock, over = threading.Lock(), False

        def hang_up() -> None:
            with lock:
                if not over:
                    with socket.socket(fileno=os.dup(self.fileno())) as mine:
                        mine.shutdown(socket.SHUT_RDWR)

        watch = threading.Timer(self.longest, hang_up)
        watch.daemon = True
        watch.start()
        try:
            return super().wait(*arguments, **keys)
        finally:
            with lock:
                over = True
            watch.cancel()


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
        keys["sslrootcert"] = task.get("ca") or _of_this_computer()
    for key, ours in (("sslcert", "certificate"), ("sslkey", "key")):
        if ours in task:
            keys[key] = task[ours]
    if "password_file" in task:
        keys["password"] = password(Path(task["password_file"]))
    connection = _AnsweredInTime.connect(**keys, autocommit=True)
    connection.longest = _LATER_THAN_THE_STORE * timeout
    return connection


def _bounds(timeout: float) -> str:
    """What the server itself gives up after, so that no lock is held for ever."""
    limit = round(1e3 * timeout)
    names = ("statement_timeout", "lock_timeout", "idle_in_transaction_session_timeout")
    return " ".join(f"-c {name}={limit}" for name in names) + " -c client_encoding=UTF8"


def _of_this_computer() -> str:
    """What vouches for a store where no file is named: this computer's own authorities.

    psycopg brings an OpenSSL that looks for them where no system has them; it is told where
    Python's, which is the system's, does.
    """
    paths = ssl.get_default_verify_paths()
    os.environ.setdefault(paths.openssl_cafile_env, paths.openssl_cafile)
    os.environ.setdefault(paths.openssl_capath_env, paths.openssl_capath)
    return "system"


@contextmanager
def opened_store(url: str, *, writing: bool = False) -> Iterator[Store]:
    """A store, as a person names it: ``postgresql://USER@HOST/DATABASE``; closed afterwards.

    What the URL leaves out stands where PostgreSQL's own programs look for it: ``~/.pgpass``,
    ``PGPASSWORD``, ``PGSSLMODE`` and so on. Where none of them says anything of TLS, a store that
    is not on this computer has to prove who it is.

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
    _prove(known)
    known.setdefault("connect_timeout", 10)
    known.setdefault("application_name", "abbe fleet")
    try:
        with psycopg.connect(**known, autocommit=True) as connection:
            connection.read_only = not writing
            yield connection
    except psycopg.Error as error:
        raise AbbeError(f"the plant's store: {one_line(error)}") from None


def _prove(known: dict[str, Any]) -> None:
    """TLS with certificate and name checked, unless something else is said, or it is here."""
    hosts = str(known.get("host") or os.environ.get("PGHOST", "")).split(",")
    said = {"sslmode", "service"} & known.keys() or {"PGSSLMODE", "PGSERVICE"} & os.environ.keys()
    # a folder is one of a socket
    local = all(not h or h.startswith("/") or on_this_computer(h) for h in hosts)
    if not said and not local:
        known["sslmode"] = "verify-full"
    own = Path("~/.postgresql/root.crt").expanduser()
    if known.get("sslmode", os.environ.get("PGSSLMODE")) == "verify-full" and not (
        "sslrootcert" in known or "PGSSLROOTCERT" in os.environ or own.exists()
    ):
        known["sslrootcert"] = _of_this_computer()


def one_line(error: BaseException) -> str:
    """What is wrong, in one line, without the server's hints."""
    text = str(error).strip() or type(error).__name__
    return " ".join(text.splitlines()[0].split())[:300]
