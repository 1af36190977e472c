"""Who may see and write what in a real PostgreSQL; migrations; the commands as they are typed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import psycopg
import pytest
from typer.testing import CliRunner

from abbe.compcore.errors import AbbeError
from abbe.daemon.application import application
from abbe.daemon.fleet.store import migrating
from abbe.daemon.fleet.store.migrating import Migration, migrate
from abbe.daemon.fleet.store.roles import add_machine, add_reader
from tests.support.daemon.plant_store import CAMPAIGN, MODEL, MachineRecords, content, store
from tests.support.daemon.postgres import PostgreSQL

pytestmark = [pytest.mark.integration, pytest.mark.xdist_group("postgresql")]
TABLES = ("machines", "models", "campaigns", "runs", "checks", "series", "history", "events")


def test_a_reader_sees_its_sites_and_a_writer_its_machine(
    server: PostgreSQL, tmp_path: Path
) -> None:
    records = MachineRecords(tmp_path / "mill-7")
    records.run(0)
    records.minutes(0, 2)
    records.events(0, 2)
    with store(server, "sites") as admin:
        add_machine(admin, "Mill 8", "Plant 2", "VMC 850", "mill_8", "")
        add_machine(admin, "Mill 9", "Plant 3", "VMC 850", "mill_9", "")
        add_reader(admin, "of_plant_2", ["Plant 2"], "")
        add_reader(admin, "of_plant_3", ["Plant 3"], "")
        add_reader(admin, "of_all", ["*"], "")
        for name, site, role in (("Mill 7", "Plant 2", "mill_7"), ("Mill 9", "Plant 3", "mill_9")):
            records.uploader(server.port, "sites", machine=name, site=site, user=role).once()
        for machine, site, role in (
            ("Mill 7", "Plant 2", "mill_8"), ("Mill 7", "Plant 3", "mill_7"),
            ("Mill 7", "Plant 2", "of_plant_2"),
        ):  # fmt: skip
            with pytest.raises((AbbeError, psycopg.errors.InsufficientPrivilege)):
                records.uploader(server.port, "sites", machine=machine, site=site, user=role).once()
        every = {table: len(rows) for table, rows in content(admin).items()}
        assert all(every[table] for table in TABLES)

        def seen(role: str) -> dict[str, int]:
            with server.connected(role, "sites") as connection:
                return {table: len(rows) for table, rows in content(connection).items()}

        assert seen("of_all") == every
        half = {table: count // 2 for table, count in every.items()}
        assert seen("of_plant_3") == half | {"machines": 1}
        assert seen("of_plant_2")["machines"] == 2
        assert seen("mill_8") == dict.fromkeys(TABLES, 0) | {"machines": 1}
        with server.connected("mill_7", "sites") as connection:
            for bad in (
                "DELETE FROM abbe.events",
                "UPDATE abbe.machines SET site = 'Plant 3'",
                "INSERT INTO abbe.access (role, site) VALUES ('mill_7', '*')",
                "SELECT * FROM abbe.access",
                "SELECT * FROM abbe.history_undated",
                "CREATE TABLE abbe.mine (a int)",
                "INSERT INTO abbe.series SELECT machine + 1, 99, 'x', '' FROM abbe.machines",
            ):
                with pytest.raises(psycopg.errors.InsufficientPrivilege):
                    connection.execute(bad.encode())
            changed = connection.execute("UPDATE abbe.machines SET structure = 'x'")
            assert changed.rowcount == 1


def test_migrations_are_applied_once_all_or_none(
    server: PostgreSQL, monkeypatch: pytest.MonkeyPatch
) -> None:
    with store(server, "migrated") as admin:
        assert migrate(admin) == ()
        known = migrating.migrations()
        bad = Migration(2, "bad", "CREATE TABLE abbe.new (a int); SELECT 1 / 0")
        monkeypatch.setattr(migrating, "migrations", lambda: (*known, bad))
        with pytest.raises(psycopg.errors.DivisionByZero):
            migrate(admin)
        assert admin.execute("SELECT to_regclass('abbe.new')").fetchone() == (None,)
        with pytest.raises(AbbeError, match="abbe fleet init"):
            migrating.require_current(admin)
        good = Migration(2, "good", "CREATE TABLE abbe.new (a int)")
        monkeypatch.setattr(migrating, "migrations", lambda: (*known, good))
        assert migrate(admin) == (good,)
        monkeypatch.setattr(migrating, "migrations", lambda: known)
        with pytest.raises(AbbeError, match="newer"):
            migrate(admin)
        edited = Migration(1, "store", known[0].text + "--")
        monkeypatch.setattr(migrating, "migrations", lambda: (edited, good))
        with pytest.raises(AbbeError, match="not this Abbe's"):
            migrate(admin)


def test_months_are_made_from_what_was_undated(server: PostgreSQL) -> None:
    with store(server, "months") as admin:
        admin.execute(
            "INSERT INTO abbe.events VALUES (now(), 1, 1, 'r', 'INFO', 'p', 'now'), "
            "('2096-01-01Z', 2, 1, 'r', 'INFO', 'p', 'then'), "
            "('2031-01-31 23:59:59Z', 3, 1, 'r', 'INFO', 'p', 'then')"
        )
        for _ in range(2):
            admin.execute("SELECT abbe.make_month(now()), abbe.make_month('2096-01-01Z')")
        counts = admin.execute(
            "SELECT (SELECT count(*) FROM abbe.events), (SELECT count(*) FROM abbe.events_undated)"
        ).fetchone()
        assert counts == (3, 2)


def typed(*words: str, status: int = 0) -> str:
    done = CliRunner().invoke(application("fleet"), ["fleet", *words])
    if status == 0:
        assert done.exit_code == 0, (done.output, done.exception)
    else:
        assert done.exit_code != 0
        return str(done.exception)
    return done.output


def test_the_commands_as_they_are_typed(server: PostgreSQL, tmp_path: Path) -> None:
    with server.connected() as connection:
        connection.execute("DROP DATABASE IF EXISTS typed WITH (FORCE)")
        connection.execute("CREATE DATABASE typed")
    url = server.url("admin", "typed")
    assert "schema" in typed("--store", url, status=1)
    assert "0001 store: done" in typed("init", "--store", url)
    assert "up to date" in typed("init", "--store", url)
    secret = tmp_path / "secret"
    said = typed(
        "add", "Mill 7", "--site", "Plant 2", "--type", "VMC 850", "--role", "mill_7",
        "--password-file", str(secret), "--store", url,
    )  # fmt: skip
    assert secret.stat().st_mode & 0o777 == 0o600
    assert f'url = "postgresql://127.0.0.1:{server.port}/typed"' in said
    typed("reader", "quality", "--site", "Plant 2", "--store", url)
    records = MachineRecords(tmp_path / "mill-7")
    records.run(0)
    records.minutes(0, 3)
    records.events(0, 5)
    up = records.uploader(server.port, "typed", password_file=str(secret))
    ball = {"unit": "um", "surprise": 8.1, "uncertainty": 2.0, "full": 1.4}
    up.take(
        {
            "state": "full correction", "in_full": True, "alive": True, "faults": {},
            "checks": {
                "verdict": "changed", "words": ["Changed in Y, grows with X.", "next"],
                "series": {"ball X": ball},
            },
        }
    )  # fmt: skip
    up.once()
    asked = server.url("quality", "typed")
    found = json.loads(typed("--store", asked, "--json"))["machines"]
    assert [m["machine"] for m in found] == ["Mill 7"]
    assert found[0]["health"] == "attention"
    said = "Changed in Y, grows with X; +8.1 ± 2.0 µm at ball X (140 % of its limit)"
    assert found[0]["drift"] == said
    assert found[0]["model"]["stale"][0] == "the machine has changed"
    page = tmp_path / "fleet.html"
    assert "Mill 7" in typed("--store", asked, "--report", str(page))
    assert "1 machine: 1 to be looked at" in page.read_text("utf-8")
    shown = typed("show", "Mill 7", "--store", asked, "--days", "30000")
    assert "check readings: 3" in shown
    assert "T_x" in shown
    assert "no. 4" in shown
    out = tmp_path / "out"
    typed("files", "Mill 7", "-o", str(out), "--store", asked)
    assert (out / "machine.toml").read_text("utf-8") == MODEL
    assert (out / "x.csv").read_text("utf-8") == CAMPAIGN
    assert "1790003600.0,ball" in (out / "checks.csv").read_text("utf-8")
    assert "Mill 7" in typed("show", "Mill 8", "--store", asked, status=1)
    assert "new folder" in typed("files", "Mill 7", "-o", str(out), "--store", asked, status=1)
    # silent for long, by the store's clock
    with server.connected(database="typed") as connection:
        connection.execute("UPDATE abbe.machines SET seen = now() - interval '3 hours'")
    (silent,) = json.loads(typed("--store", asked, "--json"))["machines"]
    assert (silent["health"], silent["words"]) == ("unknown", "silent for 3 h")
    shutil.rmtree(out)
