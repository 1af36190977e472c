"""A machine's records, kept by a live run and asked for by the command."""

from __future__ import annotations

import json
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.daemon.live_run import PATIENCE, compensating, live_run, machine

pytestmark = pytest.mark.integration


def asked(*arguments: object) -> str:
    command = [sys.executable, "-m", "abbe.daemon", "records", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_what_a_run_did_can_be_traced(tmp_path: Path) -> None:
    with machine(tmp_path) as (_, config):
        config.write_text(config.read_text() + "\n[records]\nevery = 0.1\n")
        with live_run(config) as run:
            first = run.until(compensating)
            start = len(run.cycles)
            run.until(lambda c: c["time"] > first["time"] + 3.0)
            seen = run.cycles[start:]
            assert run.end(signal.SIGTERM) == 0
        found = json.loads(asked("part", config, "1h", "now", "--json"))
        assert found["runs"][0]["configuration_sha256"]
        by_name = {s["name"]: s for s in found["series"]}
        # what was kept is what was shown
        shown = [c["correction"]["Y"] for c in seen]
        assert by_name["correction_Y"]["least"] <= min(shown) + 2e-3
        assert by_name["correction_Y"]["greatest"] >= max(shown) - 2e-3
        warm = [c["temperatures"]["T_x1"] for c in seen]
        assert by_name["T_x1"]["mean"] == pytest.approx(sum(warm) / len(warm), abs=0.2)
        assert "corrected in full" in asked("show", config, "--from", "1h")
        with sqlite3.connect(tmp_path / "records.sqlite") as connection:
            (words,) = connection.execute(
                "SELECT count(DISTINCT value) FROM full JOIN series USING (series) "
                "WHERE name = 'status'"
            ).fetchone()
        connection.close()
        assert words >= 3, "ramped in, in full, ending"


def test_records_that_cannot_be_kept_stop_nothing(tmp_path: Path) -> None:
    with machine(tmp_path) as (_, config):
        text = config.read_text() + '\n[records]\nfile = "/proc/abbe.sqlite"\n'
        config.write_text(text)
        with live_run(config) as run:
            run.until(compensating)
            assert run.end(signal.SIGTERM) == 0
        assert (tmp_path / "journal.log").read_text().count("records cannot be written") == 1
