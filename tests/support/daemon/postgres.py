"""A real PostgreSQL, unpacked from Debian's package: an ordinary process in its own folder."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psycopg
import pytest

from tests.support.daemon.observed import free_port

ROOT = Path(__file__).parents[3]
UNPACKED = ROOT / ".venv" / "unpacked"
PATIENCE = 60.0
_NOBODY = 65534


class PostgreSQL:
    """The server: begun, killed, begun again at the same port.

    Attributes
    ----------
    port
        Where it listens on 127.0.0.1.
    folder
        Of its data.
    """

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self.folder = folder / "data"
        if os.geteuid() == 0:
            # it does not run as root
            os.chown(folder, _NOBODY, _NOBODY)
        self._run(
            "initdb", "-D", self.folder, "-U", "admin", "-A", "trust", "-E", "UTF8",
            "--locale=C.UTF-8", "--no-sync", "--no-instructions",
        )  # fmt: skip
        settings = {
            "listen_addresses": "'127.0.0.1'", "port": self.port, "unix_socket_directories": "''",
            "jit": "off", "shared_buffers": "'32MB'", "max_connections": 60,
            "log_min_messages": "fatal",
            # a process that is killed loses nothing that the kernel has
            "fsync": "off",
        }  # fmt: skip
        with (self.folder / "postgresql.conf").open("a", encoding="utf-8") as file:
            file.writelines(f"{name} = {value}\n" for name, value in settings.items())
        self.process: subprocess.Popen[bytes] | None = None

    def begin(self) -> None:
        """Start it; returns when it answers."""
        with (self.folder.parent / "log").open("ab") as log:
            self.process = subprocess.Popen(
                [*_as_nobody(), UNPACKED / "postgresql/bin/postgres", "-D", self.folder],
                env=_environment(),
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,
            )
        deadline = time.monotonic() + PATIENCE
        while True:
            with contextlib.suppress(psycopg.OperationalError), self.connected():
                return
            assert self.process.poll() is None, (self.folder.parent / "log").read_text()
            assert time.monotonic() < deadline
            time.sleep(0.05)

    def kill(self) -> None:
        """End it, and all that it has begun, as a loss of power does."""
        if self.process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()

    def url(self, user: str = "admin", database: str = "abbe") -> str:
        return f"postgresql://{user}@127.0.0.1:{self.port}/{database}"

    def connected(self, user: str = "admin", database: str = "postgres") -> psycopg.Connection[Any]:
        return psycopg.connect(self.url(user, database), autocommit=True, connect_timeout=5)

    def _run(self, program: str, *arguments: object) -> None:
        command = [*_as_nobody(), UNPACKED / "postgresql/bin" / program, *map(str, arguments)]
        done = subprocess.run(
            command, env=_environment(), capture_output=True, text=True, check=False,
            timeout=PATIENCE,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr


@contextmanager
def postgresql() -> Iterator[PostgreSQL]:
    """A server that runs, over and gone when the context is."""
    if not (UNPACKED / "postgresql").exists():
        target = ".venv/unpacked/postgresql"
        subprocess.run(["make", target], cwd=ROOT, check=False, capture_output=True, timeout=110)
    if not (UNPACKED / "postgresql").exists():
        pytest.skip("Debian's package postgresql cannot be had here")
    folder = Path(tempfile.mkdtemp(prefix="abbe-postgres-"))
    server = None
    try:
        server = PostgreSQL(folder)
        server.begin()
        yield server
    finally:
        if server is not None:
            server.kill()
        shutil.rmtree(folder, ignore_errors=True)


def _as_nobody() -> list[str]:
    """Before a command that does not run as root; it may read what root unpacked."""
    if os.geteuid():
        return []
    may = "+dac_read_search"
    return [
        "setpriv", f"--reuid={_NOBODY}", f"--regid={_NOBODY}", "--clear-groups",
        f"--inh-caps={may}", f"--ambient-caps={may}",
    ]  # fmt: skip


def _environment() -> dict[str, str]:
    libraries = ":".join(
        str(folder)
        for root in ("lib", "usr/lib")
        for folder in (UNPACKED / root).glob("*-linux-gnu*")
    )
    return os.environ | {"LD_LIBRARY_PATH": libraries, "LC_ALL": "C.UTF-8", "TZ": "UTC"}
