"""Abbe killed (SIGKILL) within and between its steps; the next start knows where it was."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.upload_cases import SLOW, Place, sums, texts
from tests.support.daemon.upload_truth import active_now, check_reported

pytestmark = pytest.mark.integration

KILLED = {
    "before_the_backup": ({"at": "status", "skip": 2}, "backup"),
    "before_anything_is_staged": ({"at": "begin"}, "stage"),
    "while_staging": ({"at": "block", "skip": 2}, "stage"),
    "before_comparing": ({"at": "read_staged"}, "compare"),
    "before_asking_again": ({"at": "state", "after": "read_staged"}, "ready"),
    "before_activating": ({"at": "commit"}, "activate"),
    "after_activating": ({"at": "commit", "kind": "hang_after"}, "activate"),
    "before_verifying": ({"at": "status", "after": "commit", "skip": 2}, "verify"),
    "while_verifying": ({"at": "read_active", "after": "commit"}, "verify"),
    "before_checking_the_effect": ({"at": "show"}, "effect"),
}


@pytest.fixture(scope="module")
def control() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("controller", "modbus") as process:
        yield process


@pytest.fixture(scope="module")
def abbe() -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-m", "tests.support.daemon.forking"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2],
    ) as process:  # fmt: skip
        yield process
        process.stdin.close()


@pytest.fixture
def place(made: Path, control: SimulatedProcess, tmp_path: Path) -> Place:
    shutil.copy(made / "model.toml", tmp_path)
    control.order("reset")
    control.order("load", files=texts(made / "old"))
    keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"]}
    here = Place(tmp_path, control, keys, SLOW)
    here.configure(**SLOW)
    return here


def start(abbe: subprocess.Popen[str], *arguments: object) -> int:
    abbe.stdin.write(json.dumps([str(a) for a in arguments]) + "\n")
    abbe.stdin.flush()
    return json.loads(abbe.stdout.readline())["pid"]


def ended(abbe: subprocess.Popen[str]) -> int:
    return json.loads(abbe.stdout.readline())["status"]


def kill_when_it_hangs(place: Place, abbe: subprocess.Popen[str], pid: int) -> None:
    until = time.monotonic() + 60.0
    while not place.truth()["happened"]:
        assert time.monotonic() < until, place.truth()["asked"]
        time.sleep(0.01)
    os.kill(pid, signal.SIGKILL)
    assert ended(abbe) == -signal.SIGKILL
    place.control.order("clear")
    place.control.order("wake")


@pytest.mark.one_in(3)
@pytest.mark.parametrize("when", KILLED)
def test_killed_and_recovered(place: Place, made: Path, abbe: subprocess.Popen[str], when: str):
    where, step = KILLED[when]
    old, new = sums(made / "old"), sums(made / "new")
    place.control.order("fault", **({"kind": "hang"} | where))
    pid = start(abbe, "upload", place.config, made / "new", "--yes")
    kill_when_it_hangs(place, abbe, pid)
    left = place.entries()
    assert (left[-1]["step"], left[-1]["outcome"]) == (step, "begun")
    before = active_now(place, old, new)
    outcome = place.recover()
    assert f"the journal ends at '{step}'" in "\n".join(place.said)
    assert outcome.active == before
    check_reported(place, outcome, old, new)
    assert outcome.done == (before == "new")
    assert place.recover() is None
    assert place.upload(made / "new").ok


def test_killed_and_simply_started_again(place: Place, made: Path, abbe: subprocess.Popen[str]):
    place.control.order("fault", kind="hang", at="commit")
    pid = start(abbe, "upload", place.config, made / "new", "--yes")
    kill_when_it_hangs(place, abbe, pid)
    assert start(abbe, "upload", place.config, made / "new", "--yes", "--json")
    assert ended(abbe) == 0
    assert place.truth()["active"] == sums(made / "new")
    assert [e["upload"] for e in place.entries() if e["step"] == "end"] == list(
        place_uploads(place)
    )


def place_uploads(place: Place) -> dict[str, None]:
    return dict.fromkeys(e["upload"] for e in place.entries())


def test_neither_table_is_active_after_the_power_cut(
    place: Place, made: Path, abbe: subprocess.Popen[str]
):
    """Somebody loaded something else at the control meanwhile: the backup is put back."""
    place.control.order("fault", kind="hang", at="commit")
    kill_when_it_hangs(place, abbe, start(abbe, "upload", place.config, made / "new", "--yes"))
    other = {"x.csv": texts(made / "new")["x.csv"]}
    place.control.order("load", files=other)
    outcome = place.recover()
    assert outcome.active == "old"
    assert "neither the old nor the new table" in "\n".join(place.said)
    assert place.truth()["active"] == sums(made / "old")
    assert place.entries()[-1]["step"] == "end"


def test_the_recovery_is_killed_too(place: Place, made: Path, abbe: subprocess.Popen[str]):
    place.control.order("fault", kind="hang", at="commit")
    kill_when_it_hangs(place, abbe, start(abbe, "upload", place.config, made / "new", "--yes"))
    place.control.order("load", files={"x.csv": texts(made / "new")["x.csv"]})
    place.control.order("fault", kind="hang", at="block", skip=1)
    kill_when_it_hangs(place, abbe, start(abbe, "upload", place.config, "--recover"))
    assert place.recover().active == "old"
    assert place.truth()["active"] == sums(made / "old")


def test_only_one_upload_at_a_time_and_a_dead_one_leaves_no_lock(
    place: Place, made: Path, abbe: subprocess.Popen[str]
):
    place.control.order("fault", kind="hang", at="begin")
    pid = start(abbe, "upload", place.config, made / "new", "--yes")
    until = time.monotonic() + 60.0
    while not place.truth()["happened"]:
        assert time.monotonic() < until
        time.sleep(0.01)
    with pytest.raises(Exception, match=rf"another upload is running \(process {pid}"):
        place.recover()
    kill_when_it_hangs(place, abbe, pid)
    assert place.recover().active == "old"
    assert f"process {pid} ended without unlocking" in "\n".join(place.said)


def test_ctrl_c_puts_the_old_table_back(place: Place, made: Path, abbe: subprocess.Popen[str]):
    place.configure(**(SLOW | {"timeout": 1.0}))
    place.control.order("fault", kind="late_answer", at="commit", seconds=30.0)
    pid = start(abbe, "upload", place.config, made / "new", "--yes")
    until = time.monotonic() + 60.0
    while not place.truth()["happened"]:
        assert time.monotonic() < until
        time.sleep(0.01)
    os.kill(pid, signal.SIGINT)
    assert ended(abbe) == 1
    assert place.truth()["active"] == sums(made / "old")
    last = place.entries()[-1]
    assert (last["step"], last["active"], last["why"]) == ("end", "old", "stopped by the operator")
