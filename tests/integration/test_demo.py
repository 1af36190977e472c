"""``abbe demo``, the whole of it, as a user types it."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from abbe.compcore.files.text.toml_source import TomlSource
from tests.support.daemon.live_run import PATIENCE

pytestmark = pytest.mark.integration

DEMO = [sys.executable, "-m", "abbe.daemon", "demo"]


def test_the_error_falls_tenfold_while_the_machine_warms_up(tmp_path: Path) -> None:
    command = [*DEMO, "--json", "--duration", "15", "--out", "out"]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=tmp_path, timeout=3 * PATIENCE, check=False
    )
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    summary = lines[-1]["summary"]
    assert summary["improvement"] >= 10.0
    assert summary["rms_before_um"] > 8.0
    assert summary["max_after_um"] < 4.0
    assert summary["improvement"] == pytest.approx(
        summary["rms_before_um"] / summary["rms_after_um"], rel=0.01
    )
    assert summary["cycles"] == len(lines) - 1
    # how sure the correction is, from the second second on
    sure = [line["uncertainty"] for line in lines[:-1] if "uncertainty" in line]
    assert len(sure) > 0.5 * len(lines)
    assert all(0.0 < one[axis] < 20.0 for one in sure for axis in "XYZ")
    assert 0.0 < summary["cycle_ms_median"] <= summary["cycle_ms_p99"]
    scales = {k: v for k, v in summary["drift"].items() if k != "T_amb"}
    assert len(scales) == 6
    assert min(scales.values()) > 1.0
    times = [line["time"] for line in lines[:-1]]
    assert times == sorted(times)
    assert _is_gone(tmp_path / "out" / "config.toml")
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {
        "campaign.csv",
        "config.toml",
        "journal.log",
        "model.toml",
        "model-start.toml",
    }


@pytest.mark.thorough
def test_another_machine_is_another_model(tmp_path: Path) -> None:
    command = [*DEMO, "--json", "--duration", "6", "--seed", "2", "--out", "out"]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=tmp_path, timeout=2 * PATIENCE, check=False
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout.splitlines()[-1])["summary"]
    assert summary["improvement"] >= 8.0


@pytest.mark.one_in(3)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_the_simulated_machine_ends_with_the_demo(tmp_path: Path, number: int) -> None:
    process = subprocess.Popen(
        [*DEMO, "--json", "--duration", "300", "--out", "out"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=tmp_path,
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        assert json.loads(process.stdout.readline())["cycle"] == 1
        # as a terminal does it: Ctrl-C goes to all of the foreground's processes
        os.killpg(process.pid, number)
        rest = process.stdout.read()
        status = process.wait(PATIENCE)
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()
    if number == signal.SIGKILL:
        assert status == -signal.SIGKILL
    else:
        assert status == 0
        assert "summary" in json.loads(rest.splitlines()[-1])
    assert _is_gone(tmp_path / "out" / "config.toml")


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file, not a folder", encoding="utf-8")
    done = subprocess.run(
        [*DEMO, "--json", "--out", "out"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=PATIENCE,
        check=False,
        env={**os.environ, "COLUMNS": "200"},
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("abbe: out: cannot be written")
    assert "Traceback" not in done.stderr


def _is_gone(config: Path) -> bool:
    """Whether nothing listens any more where the simulated machine did."""
    link = TomlSource.read(config).data["links"]["cmm"]
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        with socket.socket() as client:
            if client.connect_ex((link["host"], link["port"])) != 0:
                return True
        time.sleep(0.1)
    return False
