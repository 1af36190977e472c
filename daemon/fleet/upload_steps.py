"""The steps of an upload, over one connection: each a transaction of its own."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import psycopg

from abbe.compcore.errors import AbbeError
from abbe.daemon.fleet.connecting import Store, one_line
from abbe.daemon.fleet.machine_files import (
    FolderFiles,
    StoredFile,
    check_readings,
    fitted_at,
    is_campaign,
    sha256_of,
)
from abbe.daemon.fleet.plain import plain, plain_json
from abbe.daemon.fleet.spans import KeptEvent, RecordsSource, SpanRow
from abbe.daemon.records.schema import open_to_read

_EVENTS = 500
"""Events in one transaction."""
_SPANS = 24
"""Spans of all series in one transaction."""
_FRESH = 30.0
"""s that a status may be old and still say that the machine's service is there."""

_AT = "to_timestamp(%s)"

Columns = Mapping[str, str]
"""Name of a column → its type; ``time``: s since 1970."""
_RUNS: Columns = {
    "machine": "int", "began": "time", "abbe": "text", "configuration": "text",
    "configuration_sha256": "text", "model": "text", "model_sha256": "text",
}  # fmt: skip
_CHECKS: Columns = {
    "machine": "int", "key": "text", "number": "int", "time": "time", "reading": "jsonb"
}  # fmt: skip
_EVENT: Columns = {
    "machine": "int", "records": "text", "event": "bigint", "time": "time", "level": "text",
    "part": "text", "message": "text",
}  # fmt: skip
_HISTORY: Columns = {
    "machine": "int", "series": "int", "time": "time", "span": "int", "least": "float8",
    "mean": "float8", "greatest": "float8", "count": "int",
}  # fmt: skip
_FULLER = (
    "ON CONFLICT (machine, series, time) DO UPDATE SET least = excluded.least, "
    "mean = excluded.mean, greatest = excluded.greatest, span = excluded.span, "
    # what the machine itself has forgotten is not taken from the store
    "count = excluded.count WHERE excluded.count > kept.count"
)


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
        say: Callable[[int, str], None],
        clock: Callable[[], float],
    ) -> None:
        self._store, self._task, self._status = store, task, status
        self._say, self._clock = say, clock
        folder = Path(task["folder"])
        self._campaigns = FolderFiles(folder, task["campaigns"], self._warn)
        self._models = FolderFiles(folder, [task["model"], *task["models"]], self._warn)
        self._machine = self._found()
        self._months: set[int] = set()
        self._series: dict[str, int] = {}
        self._seen: dict[int, int] = {}
        self._checks = ""
        self._runs = -1

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
        self._upload_models()
        self._upload_campaigns()
        self._upload_checks()
        path = Path(self._task["records"])
        if not path.is_file():
            return
        with closing(open_to_read(path)) as connection:
            source = RecordsSource(connection)
            self._upload_runs(source)
            while not over() and self._upload_events(source):
                pass
            while not over() and self._upload_spans(source):
                pass

    def _warn(self, text: str) -> None:
        self._say(logging.WARNING, text)

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

    def _upload_models(self) -> None:
        running = Path(self._task["folder"]) / self._task["model"]
        for file in self._models.changed(settled=False):
            try:
                fitted = fitted_at(file.content)
            except (ValueError, UnicodeDecodeError):
                continue
            with self._store.transaction():
                if not self._has("models", file):
                    self._store.execute(
                        "INSERT INTO abbe.models (machine, sha256, path, fitted, content) "
                        "VALUES (%s, %s, %s, %s, %s) ON CONFLICT DO NOTHING",
                        (self._machine, file.sha256, plain(file.path), fitted, file.content),
                    )
                if Path(self._task["folder"]) / file.path == running:
                    self._store.execute(
                        "UPDATE abbe.machines SET model = %s WHERE machine = %s",
                        (file.sha256, self._machine),
                    )

    def _upload_campaigns(self) -> None:
        for file in self._campaigns.changed(settled=True):
            if is_campaign(file.content):
                self._put_campaign(file)

    def _put_campaign(self, file: StoredFile) -> None:
        path = plain(file.path)
        with self._store.transaction():
            if not self._has("campaigns", file):
                self._store.execute(
                    "INSERT INTO abbe.campaigns (machine, sha256, path, changed, content) "
                    f"VALUES (%s, %s, %s, {_AT}, %s) ON CONFLICT DO NOTHING",
                    (self._machine, file.sha256, path, file.changed, file.content),
                )
            self._store.execute(
                "UPDATE abbe.campaigns SET current = true, path = %s "
                "WHERE machine = %s AND sha256 = %s AND (NOT current OR path <> %s)",
                (path, self._machine, file.sha256, path),
            )
            self._store.execute(
                "UPDATE abbe.campaigns SET current = false "
                "WHERE machine = %s AND path = %s AND sha256 <> %s AND current",
                (self._machine, path, file.sha256),
            )

    def _has(self, table: str, file: StoredFile) -> bool:
        """Whether the store has a content: it may be large, and is not sent for nothing."""
        found = self._store.execute(
            f"SELECT 1 FROM abbe.{table} WHERE machine = %s AND sha256 = %s".encode(),
            (self._machine, file.sha256),
        )
        return found.fetchone() is not None

    def _upload_checks(self) -> None:
        path = Path(self._task["checks"])
        if not path.is_file():
            return
        content = path.read_bytes()
        digest = sha256_of(content)
        if digest == self._checks:
            return
        try:
            head, readings = check_readings(content)
        except (ValueError, KeyError) as error:
            self._say(logging.WARNING, f"{path} is not uploaded: {one_line(error)}")
            self._checks = digest
            return
        with self._store.transaction():
            self._many(
                "abbe.checks",
                _CHECKS,
                [(self._machine, r.key, r.number, r.time, plain_json(r.reading)) for r in readings],
            )
            self._store.execute(
                "UPDATE abbe.machines SET checks_head = %s WHERE machine = %s",
                (plain(head), self._machine),
            )
        self._checks = digest

    def _upload_runs(self, source: RecordsSource) -> None:
        runs = source.runs()
        if len(runs) == self._runs:
            return
        with self._store.transaction():
            self._many(
                "abbe.runs",
                _RUNS,
                [
                    (
                        self._machine, r.began, r.abbe, plain(r.configuration),
                        r.configuration_sha256, plain(r.model), r.model_sha256,
                    )
                    for r in runs
                ],
            )  # fmt: skip
        self._runs = len(runs)

    def _upload_events(self, source: RecordsSource) -> bool:
        """The next events; whether more wait."""
        self._begun(source)
        after, time_, _ = self._progress(source)
        events = source.events(after, time_, _EVENTS)
        if not events:
            return False
        self._make_months(event.time for event in events)
        with self._progressing(source) as (number, at, _):
            if (number, at) != (after, time_):
                return True  # somebody else uploads it as well
            self._many(
                "abbe.events",
                _EVENT,
                [(self._machine, source.id, *_event(event)) for event in events],
            )
            self._store.execute(
                "UPDATE abbe.uploads SET event = %s, event_time = %s, at = now() "
                "WHERE machine = %s AND records = %s",
                (events[-1].number, events[-1].time, self._machine, source.id),
            )
        return len(events) == _EVENTS

    def _upload_spans(self, source: RecordsSource) -> bool:
        """The next spans of history; whether more wait."""
        self._begun(source)
        _, _, after = self._progress(source)
        spans = source.spans(after, self._task["span"], self._clock(), self._seen, _SPANS)
        if not spans.rows and spans.mark == after:
            return False
        self._make_months(row.time for row in spans.rows)
        with self._progressing(source) as (_, _, mark):
            if mark != after:
                return True
            numbers = self._numbers(spans.rows)
            fullest: dict[tuple[int, int], tuple[Any, ...]] = {}
            for r in spans.rows:
                key = numbers[r.name], r.time
                # two names may be one in the store, which takes no row twice in one statement
                if key not in fullest or r.count > fullest[key][-1]:
                    values = float(r.least), float(r.mean), float(r.greatest)
                    fullest[key] = (self._machine, *key, r.span, *values, r.count)
            self._many("abbe.history AS kept", _HISTORY, [*fullest.values()], _FULLER)
            self._store.execute(
                "UPDATE abbe.uploads SET mark = %s, at = now() WHERE machine = %s AND records = %s",
                (spans.mark, self._machine, source.id),
            )
        self._series.update(numbers)
        self._seen = {
            begin: newest
            for begin, newest in {**self._seen, **spans.seen}.items()
            if newest > spans.mark
        }
        return spans.more

    def _begun(self, source: RecordsSource) -> None:
        self._store.execute(
            "INSERT INTO abbe.uploads (machine, records) VALUES (%s, %s) ON CONFLICT DO NOTHING",
            (self._machine, source.id),
        )

    def _progress(self, source: RecordsSource, lock: str = "") -> tuple[int, float, int]:
        """Number and time of the last event uploaded, and the mark of history."""
        row = self._store.execute(
            "SELECT event, event_time, mark FROM abbe.uploads "
            f"WHERE machine = %s AND records = %s{lock}".encode(),
            (self._machine, source.id),
        ).fetchone()
        if row is None:
            raise AbbeError("the store has forgotten how far it was")
        return row[0], row[1], row[2]

    @contextmanager
    def _progressing(self, source: RecordsSource) -> Iterator[tuple[int, float, int]]:
        """A transaction in which nobody else uploads this file; gives how far it is."""
        with self._store.transaction():
            # series are numbered by whoever uploads for the machine
            self._store.execute("SELECT pg_advisory_xact_lock(1633837158, %s)", (self._machine,))
            yield self._progress(source, " FOR UPDATE")

    def _numbers(self, rows: Sequence[SpanRow]) -> dict[str, int]:
        """Series' names → their numbers in the store, made where there is none."""
        found = dict(self._series)
        missing = {row.name: row.unit for row in rows if row.name not in found}
        if missing:
            there = self._store.execute(
                "SELECT name, series FROM abbe.series WHERE machine = %s", (self._machine,)
            ).fetchall()
            known: dict[str, int] = dict(there)
            for name, unit in missing.items():
                key = plain(name)
                if key not in known:
                    known[key] = max(known.values(), default=0) + 1
                    self._store.execute(
                        "INSERT INTO abbe.series (machine, series, name, unit) "
                        "VALUES (%s, %s, %s, %s)",
                        (self._machine, known[key], key, plain(unit)),
                    )
                found[name] = known[key]
        return found

    def _make_months(self, times: Iterator[float]) -> None:
        """The months of some times, made before anything is put into them."""
        for month in {int(t // 86400.0) // 28 for t in times} - self._months:
            # 28 days end in another month at most once
            for day in (month * 28, month * 28 + 27):
                self._store.execute(f"SELECT abbe.make_month({_AT})", (day * 86400.0,))
            self._months.add(month)

    def _many(
        self, table: str, columns: Columns, rows: Sequence[tuple[Any, ...]],
        conflict: str = "ON CONFLICT DO NOTHING",
    ) -> None:  # fmt: skip
        """Insert rows, all in one statement: whether this role may is then asked once, not a row.

        Rows that the store can never take are left out, and said.
        """
        if not rows:
            return
        sent = {"time": "float8", "jsonb": "text"}
        arrays = ", ".join(f"%s::{sent.get(kind, kind)}[]" for kind in columns.values())
        taken = {"time": "to_timestamp(r.{})", "jsonb": "r.{}::jsonb"}
        values = ", ".join(taken.get(kind, "r.{}").format(name) for name, kind in columns.items())
        names = ", ".join(columns)
        statement = (
            f"INSERT INTO {table} ({names}) "
            f"SELECT {values} FROM unnest({arrays}) AS r({names}) {conflict}"
        )
        try:
            with self._store.transaction():
                self._store.execute(
                    statement.encode(), [list(column) for column in zip(*rows, strict=True)]
                )
        except psycopg.DataError as error:
            if len(rows) == 1:
                self._say(logging.WARNING, f"left out, the store cannot take it: {one_line(error)}")
                return
            half = len(rows) // 2
            self._many(table, columns, rows[:half], conflict)
            self._many(table, columns, rows[half:], conflict)


def _event(event: KeptEvent) -> tuple[int, float, str, str, str]:
    return event.number, event.time, event.level, plain(event.part), plain(event.message)
