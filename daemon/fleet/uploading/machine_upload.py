"""All that one connection uploads of a machine, step after step."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.daemon.fleet.store.connecting import Store
from abbe.daemon.fleet.store.plain import plain, plain_json
from abbe.daemon.fleet.uploading.files_up import FilesUpload
from abbe.daemon.fleet.uploading.inserting import Say
from abbe.daemon.fleet.uploading.records_up import RecordsUpload
from abbe.daemon.fleet.uploading.spans import RecordsSource
from abbe.daemon.records.schema import open_to_read

_FRESH = 30.0
"""s that a status may be old and still say that the machine's service is there."""


class MachineUpload:
    """A machine's uploads over one connection.

    Parameters
    ----------
    store
        Connected as the machine's writer.
    task
        As `Uploader` has it.
    status
        The last thing that the run said of itself, and when (monotonic, s).
    say
        Takes a level and a sentence for the journal.
    clock
        s since 1970.

    Raises
    ------
    AbbeError
        Where the store does not know the machine, or does not let this role write it.
    """

    def __init__(
        self,
        store: Store,
        task: Mapping[str, Any],
        status: Callable[[], tuple[dict[str, Any], float] | None],
        say: Say,
        clock: Callable[[], float],
    ) -> None:
        self._store, self._task, self._status = store, task, status
        self._machine = self._found()
        self._files = FilesUpload(store, self._machine, task, say)
        self._records = RecordsUpload(store, self._machine, task, say, clock)

    def everything(self, over: Callable[[], bool] = lambda: False) -> None:
        """Upload all that there is, until it is `over`.

        Raises
        ------
        psycopg.Error
            When the store is lost, or refuses something.
        sqlite3.Error, OSError
            When the machine's own records cannot be read.
        """
        self._say_here()
        self._files.models()
        self._files.campaigns()
        self._files.checks()
        path = Path(self._task["records"])
        if not path.is_file():
            return
        with closing(open_to_read(path)) as connection:
            source = RecordsSource(connection)
            self._records.runs(source)
            while not over() and self._records.events(source):
                pass
            while not over() and self._records.spans(source):
                pass

    def _found(self) -> int:
        site, name = self._task["site"], self._task["machine"]
        row = self._store.execute(
            "SELECT machine FROM abbe.machines WHERE site = %s AND name = %s "
            "AND machine IN (SELECT abbe.writable())",
            (site, name),
        ).fetchone()
        if row is None:
            raise AbbeError(
                f"the store has no machine {name} at site {site} that {self._task['user']} writes: "
                "abbe fleet add"
            )
        return int(row[0])

    def _say_here(self) -> None:
        latest = self._status()
        fresh = latest is not None and time.monotonic() - latest[1] < _FRESH
        self._store.execute(
            "UPDATE abbe.machines SET seen = CASE WHEN %s THEN now() ELSE seen END, "
            "status = coalesce(%s::jsonb, status), structure = %s WHERE machine = %s",
            (
                fresh,
                None if latest is None else plain_json(latest[0]),
                plain(self._task["structure"]),
                self._machine,
            ),
        )
