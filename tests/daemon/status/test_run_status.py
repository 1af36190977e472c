"""What a run says of itself over real sockets: true, in honest words, with the age of values."""

from __future__ import annotations

import asyncio
import hashlib
import json
import logging
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from abbe.compcore.errors import AbbeError
from abbe.daemon.control.client import ask_at
from abbe.daemon.control.doors import STATUS_NAME, ControlDoor, Peer, StatusDoor
from abbe.daemon.control.requests import StateRequest, StatusRequest, SwitchRequest
from abbe.daemon.control.runs import found_runs
from abbe.daemon.guard import GuardState
from abbe.daemon.status.run_status import RunStatus
from abbe.daemon.status.text import lines
from abbe.drivers.link import LinkDownError, LinkState
from tests.daemon.pipeline.test_live_control import SOCKET, Run, running
from tests.daemon.pipeline.test_pipeline import EXAMPLE, SENSORS, compensating


async def asked(run: Run) -> RunStatus:
    return RunStatus.model_validate((await run.ask(StatusRequest()))["status"])


async def until(run: Run, what: Any) -> RunStatus:
    async with asyncio.timeout(60.0):
        while True:
            if what(found := await asked(run)):
                return found
            await asyncio.sleep(0.01)


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.thorough
async def test_all_that_runs_is_said(tmp_path: Path) -> None:
    async with running(tmp_path) as run:
        full = await run.until(compensating)
        status, out, err = await run.command("status", str(run.config), "--json")
        assert status == 0, err
        found = RunStatus.model_validate_json(out)
        assert found.state == "corrected in full"
        assert found.in_full
        assert found.alive
        assert found.writes
        assert found.status_word.bits[:2] == ["RUNNING", "COMPENSATING"]
        for name, axis in found.axes.items():
            place = run.service.pipeline.axes.index(name)
            assert axis.indicated == pytest.approx(full.indicated[place], abs=1e-6)
            k = "XYZ".index(name)
            assert axis.correction == pytest.approx(1e3 * full.decision.correction[k], abs=0.1)
            assert axis.corrected is not None
            assert axis.correction is not None
            # corrected = indicated + correction
            assert axis.corrected == pytest.approx(axis.indicated + 1e-3 * axis.correction)
            assert axis.guard == "active"
            assert axis.written
            assert not axis.stale
            assert axis.age_s is not None
            assert axis.age_s < 60.0
        assert set(found.signals) == set(SENSORS)
        assert all(s.value == pytest.approx(21.0) for s in found.signals.values())
        assert found.links["cmm"].state == "up"
        assert found.cycle.number > 0
        assert found.owner.pid == os.getpid()
        model = EXAMPLE / "model.toml"
        digests = {f.role: (f.sha256, f.differs) for f in found.files}
        assert digests["configuration"] == (sha256(run.config), False)
        assert digests["model"] == (sha256(model), False)
        # the file on disk is changed: said at once, and the hash is still of what runs
        run.config.write_text(run.config.read_text() + "# newer\n")
        newer = await asked(run)
        configuration = next(f for f in newer.files if f.role == "configuration")
        assert configuration.differs
        assert configuration.sha256 != sha256(run.config)
        status, out, err = await run.command("status", str(run.config))
        assert status == 0, err
        assert "corrected in full" in out
        assert "THE FILE ON DISK IS ANOTHER ONE" in out
        assert "status word 0x7003: RUNNING COMPENSATING X_ACTIVE Y_ACTIVE Z_ACTIVE" in out
    status, _, err = await run.command("status", str(run.config))
    assert status == 1
    assert "no correction runs with" in err


async def test_a_link_that_is_down_and_comes_back(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Values are marked stale with their age; after the recovery nothing is, and nothing warns."""
    caplog.set_level(logging.INFO, "abbe")
    async with running(tmp_path) as run:
        await run.until(compensating)
        link, values = run.link, dict(run.link.values)
        link.values.update(dict.fromkeys(values))
        link.write_error = LinkDownError("not written: cmm is down")
        link.status.become(LinkState.DOWN, "the cable was pulled")
        lost = await until(run, lambda s: s.axes["X"].guard == "off" and s.axes["X"].stale)
        assert lost.state == "NOT CORRECTED"
        assert not lost.in_full
        assert lost.faults == {"link cmm": "down: the cable was pulled"}
        first = lost.axes["X"]
        assert first.indicated == pytest.approx(350.0)
        assert first.corrected is None
        assert first.fault == "link cmm is down"
        assert all(s.stale and s.fault == "link cmm is down" for s in lost.signals.values())
        await asyncio.sleep(0.3)
        later = await asked(run)
        grown = (later.at - lost.at).total_seconds()
        for one, two in ((first, later.axes["X"]), (lost.signals["T_x1"], later.signals["T_x1"])):
            assert one.age_s is not None
            assert two.age_s is not None
            assert two.age_s - one.age_s == pytest.approx(grown, abs=0.02)
        text = "\n".join(lines(later))
        assert text.count("STALE") == 3 + len(SENSORS)
        assert "s old: link cmm is down" in text
        caplog.clear()
        link.values.update(values)
        link.write_error = None
        link.status.become(LinkState.UP)
        back = await until(run, lambda s: s.in_full)
        assert not back.faults
        assert not any(part.stale for part in (*back.axes.values(), *back.signals.values()))
        assert "STALE" not in "\n".join(lines(back))
        warned = [r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING]
        assert warned == []


async def test_without_an_output_nothing_is_called_corrected(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "abbe")
    text = (EXAMPLE / "config.toml").read_text(encoding="utf-8")
    start = text.index("[output]")
    outputs = text[start : text.index("[links.", start)]
    async with running(tmp_path, {outputs: ""}) as run:
        await run.until(compensating)
        found = await asked(run)
        assert found.state == "computed, not written"
        assert found.computed_in_full
        assert not found.in_full
        assert not found.writes
        assert not any(axis.written for axis in found.axes.values())
        shown = "\n".join(lines(found))
        assert "in full, not written" in shown
        run.link.values["R_T_x1"] = 4.2e8
        await run.until(lambda r: r.decision.states[0] is GuardState.OFF)
        assert (await asked(run)).state == "computed, not written (X: no correction)"
        assert run.link.written == []
    said = [r.getMessage() for r in caplog.records]
    assert "guard: X, Y, Z: computed in full, not written" in said
    assert not any("corrected in full" in line for line in said)


async def test_cut_is_never_called_in_full(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A correction that is larger than allowed: neither words nor journal say that it is full."""
    caplog.set_level(logging.INFO, "abbe")
    changes = {"max_correction = 0.1": "max_correction = 0.005", "hold = 0.1": "hold = 60.0"}
    async with running(tmp_path, changes) as run:
        cut = await run.until(
            lambda r: r.decision.size_limited and GuardState.ACTIVE in r.decision.states
        )
        await run.until(lambda r: r.number > cut.number + 20)
        found = await asked(run)
        assert found.state.endswith("correction limited")
        assert not found.in_full
        assert "SIZE_LIMITED" in found.status_word.bits
        assert "COMPENSATING" not in found.status_word.bits
        cut_names = {d for i, d in enumerate("XYZ") if cut.decision.limited >> i & 1}
        assert cut_names
    said = [r.getMessage() for r in caplog.records if r.getMessage().startswith("guard:")]
    assert "guard: the computed correction is larger than allowed and was cut" in said
    for line in said:
        if line.endswith("corrected in full"):
            assert not cut_names & set(line.removeprefix("guard: ").split(":")[0].split(", "))
    assert f"guard: {', '.join(sorted(cut_names))}: as far as the guard allows, not in full" in said


async def test_a_cycle_that_hangs_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("abbe.daemon.status.status_source._HANGS", 0.3)
    async with running(tmp_path) as run:
        await run.until(compensating)
        run.link.delay = 3.0
        found = await until(run, lambda s: not s.alive)
        run.link.delay = 0.0
        assert found.state.startswith("the cycle hangs since ")
        assert not found.in_full
        assert (await until(run, lambda s: s.alive)).state != found.state


async def test_every_run_of_the_computer_is_found(tmp_path: Path) -> None:
    """Without [control]: nobody can change it, everybody who may can look."""
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    async with (
        running(tmp_path / "one", {SOCKET: ""}) as one,
        running(tmp_path / "two") as two,
    ):
        await one.until(compensating)
        await two.until(compensating)
        runs = await asyncio.to_thread(found_runs)
        paths = {f.path for r in runs if r.status for f in r.status.files}
        assert {str(one.config), str(two.config)} <= paths
        assert not one.socket.exists()
        for run in (one, two):
            status, out, err = await run.command("status", str(run.config), "--json")
            assert status == 0, err
            files = json.loads(out)["files"]
            assert files[0]["path"] == str(run.config)
        status, out, _ = await one.command("status", "--json")
        assert len(json.loads(out)) >= 2
        status, out, _ = await one.command("status")
        assert status == 0
        assert f"process {os.getpid()}, {one.config}" in out
        # the status door shows, and changes nothing
        name = await asyncio.to_thread(_status_door)
        switch = SwitchRequest(effect="positioning", to="off")
        with pytest.raises(AbbeError, match="nothing can be changed here"):
            await asyncio.to_thread(ask_at, name, switch, "door")
        assert (await asyncio.to_thread(ask_at, name, StateRequest(), "door"))["ok"]


def _status_door() -> str:
    """The abstract name of a status door of this process, as the kernel lists it."""
    listed = Path("/proc/net/unix").read_text(encoding="utf-8").splitlines()
    mine = f"@{STATUS_NAME}{os.getpid()} "
    name = next(line[line.index(mine) + 1 :] for line in listed if mine in line)
    return f"\0{name}"


def test_who_is_let_in() -> None:
    me, group = os.geteuid(), os.getegid()
    stranger = Peer(me + 77_000, 1, frozenset({group + 77_000}))
    colleague = Peer(me + 77_000, 1, frozenset({5, group}))
    root, myself = Peer(0, 1, frozenset({0})), Peer(me, 1, frozenset())
    door = StatusDoor()
    assert [bool(door.refuses(p)) for p in (stranger, colleague, root, myself)] == [
        True, False, False, False,
    ]  # fmt: skip
    control = ControlDoor(Path("x"))
    assert [bool(control.refuses(p)) for p in (stranger, colleague, root, myself)] == [
        True, True, False, False,
    ]  # fmt: skip


def test_the_kernel_says_who_asks() -> None:
    # only root can have a process be in further groups
    more = None if os.geteuid() else [20, 44]
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listening:
        listening.bind("\0abbe-test-peer")
        listening.listen(1)
        code = (
            "import socket, sys; s = socket.socket(socket.AF_UNIX); "
            "s.connect('\\0abbe-test-peer'); sys.stdin.read()"
        )
        asking = subprocess.Popen(
            [sys.executable, "-c", code], stdin=subprocess.PIPE, extra_groups=more
        )
        try:
            listening.settimeout(60.0)
            connection, _ = listening.accept()
            with connection:
                peer = Peer.of(connection)
        finally:
            assert asking.stdin is not None
            asking.stdin.close()
            asking.wait(60.0)
    assert (peer.pid, peer.uid) == (asking.pid, os.geteuid())
    assert {os.getegid(), *(more or os.getgroups())} <= peer.groups
