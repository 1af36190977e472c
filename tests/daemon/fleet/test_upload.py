"""What a machine uploads to a real PostgreSQL: once, whatever is cut off, killed or refused."""

from __future__ import annotations

import contextlib
import sqlite3
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psycopg
import pytest

from abbe.daemon.fleet.uploading import records_up
from abbe.daemon.records.schema import open_to_write
from abbe.daemon.records.thinning import Retention, thin
from abbe.daemon.records.writer import EventRow
from tests.support.daemon.plant_store import (
    BEGIN,
    CuttingWire,
    MachineRecords,
    content,
    emptied,
    same,
    store,
)
from tests.support.daemon.postgres import PostgreSQL

pytestmark = [pytest.mark.integration, pytest.mark.xdist_group("postgresql")]


@pytest.fixture
def records(tmp_path: Path) -> MachineRecords:
    found = MachineRecords(tmp_path / "mill-7")
    found.run(0)
    found.minutes(0, 5)
    found.events(0, 7)
    return found


def test_everything_is_uploaded(server: PostgreSQL, records: MachineRecords) -> None:
    with store(server, "everything") as admin:
        records.uploader(server.port, "everything").once()
        found = content(admin)
        assert [len(found[t]) for t in ("models", "campaigns", "runs", "checks")] == [1, 1, 1, 3]
        assert [row[1] for row in sorted(found["events"], key=lambda r: r[1])] == [
            1,
            2,
            3,
            4,
            5,
            6,
            7,
        ]
        rows = admin.execute(
            "SELECT extract(epoch FROM time)::int, span, least, mean, greatest, count "
            "FROM abbe.history JOIN abbe.series USING (machine, series) "
            "WHERE name = 'T_x' ORDER BY time"
        ).fetchall()
        assert [row[0] for row in rows] == [BEGIN + 60 * i for i in range(5)]
        for i, (_, span, least, mean, greatest, count) in enumerate(rows):
            values = [20.0 + i + s / 60.0 for s in (0.5, 20.5, 40.5)]
            assert (span, count) == (60, 3)
            assert (least, mean, greatest) == pytest.approx(
                (values[0], sum(values) / 3.0, values[2]), abs=1e-12
            )
        records.uploader(server.port, "everything").once()
        assert same(found, content(admin))


@pytest.mark.thorough
@pytest.mark.timeout(600)
def test_a_connection_cut_at_every_statement(
    server: PostgreSQL, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    records = MachineRecords(tmp_path / "mill-7")
    records.run(0)
    records.minutes(0, 3)
    records.events(0, 3)
    monkeypatch.setattr(records_up, "_EVENTS", 2)
    monkeypatch.setattr(records_up, "_SPANS", 2)
    with store(server, "cut") as admin:
        whole = CuttingWire(server.port)
        with whole.standing() as port:
            records.uploader(port, "cut").once()
        wanted = content(admin)
        ends = [n for n, kind in enumerate(whole.kinds, 1) if kind in "QS"]
        stages = set()
        for after in (*ends, ends[-1] - 1):
            emptied(admin)
            with CuttingWire(server.port, after).standing() as port, pytest.raises(psycopg.Error):
                records.uploader(port, "cut").once()
            found = content(admin)
            stages.add((len(found["events"]), len(found["history"])))
            records.uploader(server.port, "cut").once()
            assert same(wanted, content(admin)), after
        # it was cut off when nothing and when some was there
        assert stages >= {(0, 0), (2, 0), (3, 0), (3, 4)}


def test_two_upload_the_same_machine_at_once(
    server: PostgreSQL, records: MachineRecords, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records_up, "_EVENTS", 1)
    monkeypatch.setattr(records_up, "_SPANS", 1)
    with store(server, "twice") as admin:
        records.uploader(server.port, "twice").once()
        wanted = content(admin)
        emptied(admin)
        failed: list[BaseException] = []

        def upload() -> None:
            try:
                records.uploader(server.port, "twice").once()
            except BaseException as error:  # noqa: BLE001
                failed.append(error)

        threads = [threading.Thread(target=upload) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert not failed
        assert same(wanted, content(admin))


def test_a_copied_computer_uploads_as_well(server: PostgreSQL, tmp_path: Path) -> None:
    """Two files of records of one machine: both's events, and of a span the fuller one."""
    first, second = MachineRecords(tmp_path / "a"), MachineRecords(tmp_path / "b")
    first.minutes(0, 2)
    second.minutes(1, 2)
    second.values(("T_x", "degC", BEGIN + 60 + 50.0, 99.0))
    for one in (first, second):
        one.events(0, 2)
    with store(server, "copied") as admin:
        for one in (first, second, first):
            one.uploader(server.port, "copied").once()
        assert len(content(admin)["events"]) == 4
        counts = history(admin)
        assert [(at - BEGIN, count) for at, _, count in counts] == [(0, 3), (60, 4), (120, 3)]


def history(admin: psycopg.Connection[Any]) -> list[tuple[int, float, int]]:
    """Beginning, mean and count of each span of T_x."""
    return admin.execute(
        "SELECT extract(epoch FROM time)::bigint, mean, count FROM abbe.history "
        "JOIN abbe.series USING (machine, series) WHERE name = 'T_x' ORDER BY time"
    ).fetchall()


def test_a_clock_that_is_set_back_and_forth(server: PostgreSQL, records: MachineRecords) -> None:
    """What is written into a minute that went up already, or into another year, is not lost."""
    with store(server, "clocks") as admin:
        up = records.uploader(server.port, "clocks", now=BEGIN + 1000.0)
        up.once()
        assert [row[2] for row in history(admin)] == [3] * 5
        # set back by two minutes and a half, into minutes that went up
        records.values(*(("T_x", "degC", BEGIN + 150.0 + s, 50.0) for s in range(3)))
        # a battery that was empty, and a year that is still to come
        records.values(("T_x", "degC", 90.0, 10.0))
        records.values(("T_x", "degC", 4_000_000_000.0, 11.0))
        records.write(EventRow(4_000_000_000.0, "INFO", "abbe.test", "in 2096"))
        up.once()
        found = {at: count for at, _, count in history(admin)}
        assert found == {60: 1, 3_999_999_960: 1} | {
            BEGIN + 60 * i: 6 if i == 2 else 3 for i in range(5)
        }
        undated = admin.execute(
            "SELECT (SELECT count(*) FROM abbe.history_undated), "
            "(SELECT count(*) FROM abbe.events_undated)"
        ).fetchone()
        assert undated == (2, 1)
        # a minute that is not over waits; the clock that says so may then be set back too
        records.values(("T_x", "degC", BEGIN + 960.0, 1.0))
        up = records.uploader(server.port, "clocks", now=BEGIN + 990.0)
        up.once()
        assert BEGIN + 960 not in {at for at, _, _ in history(admin)}
        records.values(("T_x", "degC", BEGIN + 360.0, 1.0))
        up = records.uploader(server.port, "clocks", now=BEGIN + 380.0)
        up.once()
        assert BEGIN + 960 in {at for at, _, _ in history(admin)}
        up = records.uploader(server.port, "clocks", now=BEGIN + 2000.0)
        up.once()
        up.once()
        assert {at: c for at, _, c in history(admin) if at >= BEGIN + 360} == {
            BEGIN + 360: 1, BEGIN + 960: 1, 3_999_999_960: 1
        }  # fmt: skip


def test_events_numbered_again_are_others(server: PostgreSQL, records: MachineRecords) -> None:
    """SQLite begins to count anew when all events were too old."""
    with store(server, "again") as admin:
        records.uploader(server.port, "again").once()
        with contextlib.closing(open_to_write(records.file)) as connection:
            connection.execute("DELETE FROM events")
        records.write(*(EventRow(BEGIN + 1e5 + i, "INFO", "abbe.test", "new") for i in range(9)))
        records.uploader(server.port, "again").once()
        assert len(content(admin)["events"]) == 7 + 9


def test_a_server_that_is_killed_a_disk_that_is_full_and_a_role_that_may_not(
    server: PostgreSQL, records: MachineRecords
) -> None:
    with store(server, "killed") as admin:
        up = records.uploader(server.port, "killed")
        ending = threading.Event()
        thread = threading.Thread(target=up.run, args=(ending,))
        admin.execute("REVOKE INSERT ON abbe.events FROM abbe_writer")
        thread.start()
        try:
            wait(lambda: any("permission denied" in text for _, text in records.said))
            admin.execute("GRANT INSERT ON abbe.events TO abbe_writer")
            wait(lambda: len(content(admin)["events"]) == 7)
            server.kill()
            records.minutes(5, 3)
            wait(lambda: len(records.said) >= 3)
            server.begin()
            with server.connected(database="killed") as again:
                wait(lambda: len(content(again)["history"]) == 2 * 8)
                # as a disk that is full says it
                again.execute(
                    "CREATE FUNCTION abbe.no_space() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
                    "RAISE 'could not extend file: No space left' USING ERRCODE = '53100'; END $$"
                )
                again.execute(
                    "CREATE TRIGGER no_space BEFORE INSERT ON abbe.events "
                    "FOR EACH ROW EXECUTE FUNCTION abbe.no_space()"
                )
                records.events(7, 2)
                wait(lambda: any("No space left" in text for _, text in records.said))
                connections = up.connections
                wait(lambda: up.connections > connections + 3)
                again.execute("DROP TRIGGER no_space ON abbe.events")
                wait(lambda: len(content(again)["events"]) == 9)
        finally:
            ending.set()
            thread.join()
    texts = [text for _, text in records.said]
    for words in ("permission denied", "No space left"):
        assert sum(words in text for text in texts) == 1, texts
    # the first may have been killed before it had uploaded everything
    assert sum("uploading to the store" in text for text in texts) in (2, 3)


def wait(what: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_texts_that_postgresql_does_not_know(server: PostgreSQL, records: MachineRecords) -> None:
    strange = "a\x00 \udcff µ"
    with contextlib.closing(open_to_write(records.file)) as connection:
        connection.execute(
            "INSERT INTO events (time, level, part, message) VALUES (?, 'INFO', 'abbe.test', "
            "CAST(? AS TEXT))",
            (BEGIN + 99.0, b"a\x00 \xc2\xb5"),
        )
    with store(server, "strange") as admin:
        up = records.uploader(server.port, "strange")
        up.take({"state": strange, "faults": {strange: strange}})
        up.once()
        assert len(content(admin)["events"]) == 8
        (status,) = admin.execute("SELECT status->>'state' FROM abbe.machines").fetchone() or ("",)
        assert status == "a\ufffd ? µ"


def test_an_old_file_of_records_is_taken_from_its_beginning(
    server: PostgreSQL, records: MachineRecords
) -> None:
    """One of an Abbe that knew of no store, part of it thinned to hours."""
    long_ago = BEGIN - BEGIN % 3600 - 200 * 86400
    records.values(
        *(("T_x", "degC", long_ago + 60.0 * i, float(i)) for i in range(0, 60, 3)),
        ("T_x", "degC", long_ago + 100 * 86400.0, 7.0),
    )
    with contextlib.closing(open_to_write(records.file)) as connection:
        thin(connection, Retention(), float(BEGIN))
        connection.execute("DROP TABLE touched")
        connection.execute("DROP TABLE identity")
    with store(server, "old") as admin:
        up = records.uploader(server.port, "old")
        with pytest.raises(sqlite3.OperationalError):
            up.once()
        records.events(7, 1)
        up.once()
        found = history(admin)
        assert found[0] == (long_ago, pytest.approx(28.5), 20)
        assert found[1] == (long_ago + 100 * 86400, 7.0, 1)
        assert len(found) == 2 + 5


def test_minutes_thinned_to_hours_before_the_store_was_there(
    server: PostgreSQL, records: MachineRecords
) -> None:
    hour = BEGIN - BEGIN % 3600 - 200 * 86400
    records.values(*(("T_x", "degC", hour + 60.0 * i, float(i)) for i in range(0, 60, 3)))
    with contextlib.closing(open_to_write(records.file)) as connection:
        thin(connection, Retention(), float(BEGIN))
    with store(server, "hours") as admin:
        for _ in range(2):
            records.uploader(server.port, "hours").once()
        assert history(admin)[0] == (hour, pytest.approx(28.5), 20)
        assert len(history(admin)) == 1 + 5
