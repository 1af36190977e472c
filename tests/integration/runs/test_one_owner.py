"""One Abbe at a time on one controller: real runs and real uploads in processes of their own."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.live_run import PATIENCE, compensating, live_run, machine, read_holding
from tests.support.daemon.upload_cases import SLOW, Place, fill, texts

pytestmark = pytest.mark.integration


def abbe(*arguments: object) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own."""
    command = [sys.executable, "-m", "abbe.daemon", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)


def test_a_second_run_is_refused_in_a_line_and_touches_nothing(tmp_path: Path) -> None:
    with machine(tmp_path) as (simulator, config):
        elsewhere = tmp_path / "elsewhere"
        elsewhere.mkdir()
        other = elsewhere / "other.toml"
        assert "[journal]" in config.read_text()
        other.write_text(config.read_text().replace('"127.0.0.1"', '"LocalHost"'))
        with live_run(config) as run:
            run.until(compensating)
            second = abbe("run", other, "--duration", "1")
            assert second.returncode == 1
            assert second.stdout == ""
            line = second.stderr.rstrip("\n")
            assert "\n" not in line
            assert f":{simulator.port} unit 1 is in use by process {run.process.pid}" in line
            assert str(config) in line
            assert sorted(p.name for p in elsewhere.iterdir()) == ["other.toml"]
            # the first goes on as if nothing had been
            run.until(compensating)
            assert run.end() == 0
        assert read_holding(simulator.port, 0, 1) == b"\0\0"
        assert abbe("run", other, "--duration", "1").returncode == 0


def test_after_a_kill_the_next_one_may_begin_at_once(tmp_path: Path) -> None:
    with machine(tmp_path) as (_, config):
        with live_run(config) as run:
            run.until(compensating)
            run.process.send_signal(signal.SIGKILL)
            run.process.wait(PATIENCE)
        done = abbe("run", config, "--duration", "1")
        assert done.returncode == 0, done.stderr


def test_a_run_that_only_reads_goes_beside_one_that_writes(tmp_path: Path) -> None:
    with machine(tmp_path) as (_, config):
        text = config.read_text()
        watching = tmp_path / "watching.toml"
        watching.write_text(text[: text.index("[output]")] + text[text.index("[links.cmm]") :])
        assert "[output" not in watching.read_text()
        with live_run(config) as run:
            run.until(compensating)
            done = abbe("run", watching, "--duration", "1")
            assert done.returncode == 0, done.stderr


def test_uploads_and_runs_exclude_each_other(tmp_path: Path) -> None:
    """Another table while a correction is written would act on top of it."""
    tables = tmp_path / "tables"
    tables.mkdir()
    fill(tables)
    folder = tmp_path / "mill"
    folder.mkdir()
    shutil.copy(tables / "model.toml", folder)
    with (
        machine(tmp_path) as (simulator, live),
        SimulatedProcess("controller", "modbus") as control,
    ):
        control.order("load", files=texts(tables / "old"))
        keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"]}
        place = Place(folder, control, keys, SLOW)
        place.configure(**SLOW)
        text = place.config.read_text().replace("port = 1\n", f"port = {simulator.port}\n", 1)
        output = 'writable = true, table = "holding", address = 900, type = "uint16"'
        text = text.replace("[axes.X]", f"word = {{ {output} }}\n[axes.X]", 1)
        text = text.replace("[upload]", '[output]\nstatus = "cnc.word"\n[upload]', 1)
        place.config.write_text(text)
        upload = ("upload", place.config, tables / "new", "--yes")
        with live_run(live) as run:
            run.until(compensating)
            refused = abbe(*upload)
            assert refused.returncode == 1, refused.stdout
            assert "is in use by process" in refused.stderr
            assert f"{run.process.pid} since" in refused.stderr
            assert not place.journal.exists()
            assert control.order("truth")["active"] != {}
            # who only asks is welcome
            assert abbe("upload", place.config, "--status").returncode == 0
            assert abbe("upload", place.config, tables / "new", "--dry-run").returncode == 0
            assert run.end() == 0
        control.order("fault", kind="hang", at="begin")
        uploading = subprocess.Popen(
            [sys.executable, "-m", "abbe.daemon", *map(str, upload)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            while not control.order("truth")["happened"]:
                assert uploading.poll() is None
                time.sleep(0.02)
            late = abbe("run", live, "--duration", "1")
            assert late.returncode == 1
            assert f"is in use by process {uploading.pid}" in late.stderr
            assert f"(upload with {os.path.realpath(place.config)})" in late.stderr
        finally:
            uploading.kill()
            uploading.wait(PATIENCE)
        control.order("wake")
        assert abbe("run", live, "--duration", "1").returncode == 0
