"""Work spread over a real Dask scheduler's workers, in processes of their own, which are killed."""

from __future__ import annotations

import json
import os
import signal
import socket
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.effects import Positioning, Scale
from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.model_file import save_model
from abbe.daemon.answers.uncertainty.blocks import block_tasks, unpacked
from abbe.daemon.spreading import dask_cluster
from abbe.daemon.spreading.dask_cluster import DaskCluster, SchedulerAddress
from abbe.daemon.spreading.engine import InThisProcess, WorkLostError
from abbe.daemon.spreading.fingerprint import fingerprint
from abbe.daemon.spreading.process_pool import ProcessPool
from abbe.daemon.spreading.spread import SpreadPlace, in_order, spread
from abbe.daemon.spreading.spread_work import SpreadTask
from tests.support.compcore.unsure_machines import MACHINE, unsure
from tests.support.daemon.dask_processes import DaskProcesses, dask_processes
from tests.support.daemon.spread_functions import NAME

pytestmark = [
    pytest.mark.integration,
    pytest.mark.xdist_group("dask"),
    pytest.mark.filterwarnings("ignore"),  # Dask's own, about what it finds installed
]
PART = """format = "abbe-part/1"
[probe]
repeatability = 0.5
[[features]]
name = "c"
kind = "circle"
at = [300, 300, 0]
diameter = 50
[[features]]
name = "p"
kind = "point"
at = [600, 300, 0]
axis = [1, 0, 0]
"""


def until(true: object, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not true():  # type: ignore[operator]
        assert time.monotonic() < end
        time.sleep(0.02)


def kept(file: Path) -> int:
    """How many answers a file of answers has; 0 before it is made."""
    try:
        with closing(sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True)) as base:
            return int(base.execute("SELECT count(*) FROM answers").fetchone()[0])
    except sqlite3.OperationalError:
        return 0


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskProcesses]:
    with dask_processes(tmp_path_factory.mktemp("dask"), 2) as made:
        yield made


def place(cluster: DaskProcesses, keep: Path | None = None) -> SpreadPlace:
    return SpreadPlace(DaskCluster(SchedulerAddress(cluster.address)), keep)


def waiting_tasks(folder: Path, count: int) -> list[partial[SpreadTask]]:
    def argument(i: int) -> str:
        return json.dumps({"folder": str(folder), "task": i, "waits": i == 2})

    return [partial(SpreadTask, NAME + "once_noted", argument(i)) for i in range(count)]


@pytest.mark.thorough
def test_draws_are_the_same_to_the_bit(cluster: DaskProcesses, tmp_path: Path) -> None:
    effects = (Scale(axis="X"), Positioning(axis="Y", shape="polynomial:3"))
    known = [(e, {p.name: (1e-5, 3e-6) for p in e.linear(MACHINE)}) for e in effects]
    save_model(unsure(*known), tmp_path / "model.toml")
    tasks = block_tasks((tmp_path / "model.toml").read_bytes(), PART.encode(), 7, 1100)
    places = (SpreadPlace(InThisProcess()), SpreadPlace(ProcessPool(2)), place(cluster))
    found = [in_order(spread(tasks, where), len(tasks)) for where in places]
    assert found[0] == found[1] == found[2]
    draws = np.concatenate([unpacked(body).corrected for body in found[0]])
    assert draws.shape[0] == 1100
    assert len(np.unique(draws[:, 0])) == 1100


def test_other_versions_are_refused(
    cluster: DaskProcesses, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = fingerprint() | {"Abbe": "0.2.0 (feedface)", "NumPy": "9.9"}
    monkeypatch.setattr(dask_cluster, "differing", lambda _, there: real(other, there))
    with pytest.raises(AbbeError, match=r"other versions.*0\.2\.0 \(feedface\) here.*NumPy.*9\.9"):
        list(spread([partial(SpreadTask, NAME + "reversed_text", "a")], place(cluster)))


real = dask_cluster.differing


def test_a_worker_and_then_the_scheduler_are_killed(cluster: DaskProcesses, tmp_path: Path) -> None:
    """By SIGKILL in the middle of a task; after the scheduler's end the run is gone on with."""
    first, second, keep = tmp_path / "first", tmp_path / "second", tmp_path / "work.sqlite"
    for folder in (first, second):
        folder.mkdir()
        (folder / "hold").touch()

    def kill_the_one_that_waits() -> None:
        until((first / "waiting").exists)
        until(lambda: (first / "waiting").read_text())
        (first / "hold").unlink()
        os.kill(int((first / "waiting").read_text()), signal.SIGKILL)

    killer = threading.Thread(target=kill_the_one_that_waits)
    (first / "hold").touch()
    killer.start()
    answers = list(spread(waiting_tasks(first, 12), place(cluster)))
    killer.join()
    assert sorted(answers) == [(i, str(i).encode()) for i in range(12)]  # each counted once
    assert [w.poll() for w in cluster.workers].count(-signal.SIGKILL) == 1

    def kill_the_scheduler() -> None:
        until((second / "waiting").exists)
        until(lambda: kept(keep) >= 1)
        cluster.scheduler.kill()

    killer = threading.Thread(target=kill_the_scheduler)
    killer.start()
    tasks = waiting_tasks(second, 6)
    with pytest.raises(
        WorkLostError, match=r"scheduler tcp://127.* is lost after \d of 6 tasks, kept in"
    ):
        list(spread(tasks, place(cluster, keep)))
    killer.join()
    (second / "hold").unlink()
    had = kept(keep)
    found = in_order(spread(tasks, SpreadPlace(InThisProcess(), keep)), 6)
    assert found == [str(i).encode() for i in range(6)]
    # what was kept is not asked for again, and only that
    assert len(list(second.glob(f"*-{os.getpid()}"))) == 6 - had
    assert 1 <= had <= 5


@pytest.mark.parametrize(
    "address",
    ["http://127.0.0.1:80", "tcp://", "tcp://host", "tcp://host:99999", "tcp://host:0",
     "inproc://1/2", "file:///etc/passwd", "tcp://a b:1", "tcp://host:1/../x", ""],
)  # fmt: skip
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(InputError, match="not the address of a scheduler"):
        SchedulerAddress(address)


def test_tls_takes_its_three_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--tls-ca"):
        SchedulerAddress("tls://host:8786")
    with pytest.raises(InputError, match="tcp:// none"):
        SchedulerAddress("tcp://host:8786", tmp_path, tmp_path, tmp_path)
    assert SchedulerAddress("tcp://10.0.0.5:8786").exposed
    assert not SchedulerAddress("tcp://127.0.0.1:8786").exposed


@pytest.mark.parametrize(
    "body",
    [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n" * 9, b"\xff" * 4096],
    ids=["silent", "http", "garbage"],
)
def test_a_foreign_server_is_said_in_one_sentence(
    body: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_cluster, "_CONNECTING", 2.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        kept: list[socket.socket] = []

        def serve() -> None:
            while True:
                try:
                    found, _ = server.accept()
                except OSError:
                    return
                kept.append(found)
                found.sendall(body)

        threading.Thread(target=serve, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(WorkLostError, match=r"no Dask scheduler answers at tcp://127[^\n]*$"):
            list(spread([partial(SpreadTask, NAME + "reversed_text", "a")],
                        SpreadPlace(DaskCluster(SchedulerAddress(address)))))  # fmt: skip
        for one in kept:
            one.close()
