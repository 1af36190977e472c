"""A machine's own records uploaded: runs, events and thinned history."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.daemon.fleet.store.connecting import Store
from abbe.daemon.fleet.store.plain import plain
from abbe.daemon.fleet.uploading.inserting import AT, Columns, Say, insert_rows
from abbe.daemon.fleet.uploading.spans import KeptEvent, RecordsSource, SpanRow

_EVENTS = 500
"""Events in one transaction."""
_SPANS = 24
"""Spans of all series in one transaction."""

_RUNS: Columns = {
    "machine": "int", "began": "time", "abbe": "text", "configuration": "text",
    "configuration_sha256": "text", "model": "text", "model_sha256": "text",
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


class RecordsUpload:
    """What is uploaded of a machine's records over one connection, in small transactions.

    Parameters
    ----------
    store
        Connected as the machine's writer.
    machine
        Its number in the store.
    task
        As `Uploader` has it.
    say
        Takes a level and a sentence for the journal.
    clock
        s since 1970.
    """

    def __init__(
        self,
        store: Store,
        machine: int,
        task: Mapping[str, Any],
        say: Say,
        clock: Callable[[], float],
    ) -> None:
        self._store, self._machine, self._task = store, machine, task
        self._say, self._clock = say, clock
        self._months: set[int] = set()
        self._series: dict[str, int] = {}
        self._seen: dict[int, int] = {}
        self._known_runs = -1

    def runs(self, source: RecordsSource) -> None:
        """Upload the runs that there are."""
        runs = source.runs()
        if len(runs) == self._known_runs:
            return
        with self._store.transaction():
            insert_rows(
                self._store,
                self._say,
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
        self._known_runs = len(runs)

    def events(self, source: RecordsSource) -> bool:
        """Upload the next events; whether more wait."""
        self._begun(source)
        after, time_, _ = self._progress(source)
        events = source.events(after, time_, _EVENTS)
        if not events:
            return False
        self._make_months(event.time for event in events)
        with self._progressing(source) as (number, at, _):
            if (number, at) != (after, time_):
                return True  # somebody else uploads it as well
            insert_rows(
                self._store,
                self._say,
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

    def spans(self, source: RecordsSource) -> bool:
        """Upload the next spans of history; whether more wait."""
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
            insert_rows(
                self._store,
                self._say,
                "abbe.history AS kept",
                _HISTORY,
                [*fullest.values()],
                _FULLER,
            )
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
                self._store.execute(f"SELECT abbe.make_month({AT})", (day * 86400.0,))
            self._months.add(month)


def _event(event: KeptEvent) -> tuple[int, float, str, str, str]:
    return event.number, event.time, event.level, plain(event.part), plain(event.message)
