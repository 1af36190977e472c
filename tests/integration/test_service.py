"""``abbe run`` as a service: what its manager hears, and a reload, seen in the registers."""

from __future__ import annotations

import os
import re
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from abbe.daemon.status_word import Status
from tests.support.daemon.live_run import (
    MODEL,
    PATIENCE,
    LiveRun,
    compensating,
    live_run,
    machine,
    read_holding,
)

pytestmark = pytest.mark.integration


class Manager:
    """A service manager: the datagrams that it was sent, in order."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self.messages: list[str] = []

    def until(self, begins: str, since: int = 0) -> str:
        """The first message from the `since`-th on that begins so."""
        deadline = time.monotonic() + PATIENCE
        while True:
            for message in self.messages[since:]:
                if message.startswith(begins):
                    return message
            self._socket.settimeout(max(0.01, deadline - time.monotonic()))
            self.messages.append(self._socket.recv(9999).decode())

    def close(self) -> None:
        self._socket.close()


@contextmanager
def supervised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, config: Path
) -> Iterator[tuple[LiveRun, Manager]]:
    manager = Manager(tmp_path / "notify")
    try:
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "4000000")
        with live_run(config) as run:
            yield run, manager
    finally:
        manager.close()


def edit(path: Path, change: Callable[[str], str]) -> None:
    """Replace a file as an editor does."""
    text = path.read_text()
    new = change(text)
    assert new != text
    beside = path.with_name(path.name + ".new")
    beside.write_text(new)
    beside.replace(path)


def journal(config: Path) -> str:
    return (config.parent / "journal.log").read_text()


def until_journal(config: Path, text: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while text not in journal(config):
        assert time.monotonic() < deadline, journal(config)
        time.sleep(0.05)


@contextmanager
def own_model(tmp_path: Path) -> Iterator[tuple[int, Path]]:
    """A simulated machine, and a configuration beside a model of its own that can be changed."""
    with machine(tmp_path) as (simulator, config):
        (tmp_path / "model.toml").write_text(MODEL.read_text())
        edit(config, lambda text: re.sub(r'(?m)^model = ".*"$', 'model = "model.toml"', text))
        yield simulator.port, config


def test_the_manager_hears_ready_alive_the_state_and_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        own_model(tmp_path) as (port, config),
        supervised(tmp_path, monkeypatch, config) as (run, manager),
    ):
        assert manager.until("READY=1")
        assert manager.until("STATUS=corrected in full; 3 axes; cycle ")
        run.until(compensating)
        since = len(manager.messages)
        manager.until("WATCHDOG=1", since)
        assert run.end() == 0
        assert "STOPPING=1" in manager.until("STOPPING=1")
        assert read_holding(port, 0, 1) == b"\0\0"
        first = journal(config).splitlines()
        assert any("model.toml (SHA-256 " in line and "Abbe " in line for line in first)


def test_a_cycle_that_hangs_is_not_alive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        own_model(tmp_path) as (_, config),
        supervised(tmp_path, monkeypatch, config) as (run, manager),
    ):
        manager.until("WATCHDOG=1")
        run.process.send_signal(signal.SIGSTOP)
        try:
            time.sleep(0.5)
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(f"{__name__}.PATIENCE", 5.0)
                since = len(manager.messages) + 50  # more than may still wait in the socket
                with pytest.raises((TimeoutError, BlockingIOError)):
                    manager.until("WATCHDOG=1", since)
        finally:
            run.process.send_signal(signal.SIGCONT)


def test_another_model_is_led_in_while_the_correction_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        own_model(tmp_path) as (_, config),
        supervised(tmp_path, monkeypatch, config) as (run, manager),
    ):
        before = run.until(compensating)

        def shifted(text: str) -> str:
            # a squareness of 100 µrad more: tens of µm at the ends
            found = re.search(r'kind = "squareness"[\s\S]*?value = ([-+.0-9e]+)', text)
            assert found, "the example's model has a squareness"
            return text[: found.start(1)] + repr(float(found[1]) + 1e-4) + text[found.end(1) :]

        edit(config.with_name("model.toml"), shifted)
        since = len(run.cycles)
        run.process.send_signal(signal.SIGHUP)
        until_journal(config, "reload: the correction is led over")
        seen = run.until(lambda c: bool(compensating(c)) and far(c, before) > 5.0, since)
        manager.until("RELOADING=1")
        assert seen["guard"]["compensating"]
        # it never let go, and never went faster than the guard allows
        steps = run.cycles[since:]
        assert all(c["guard"]["status"] & Status.RUNNING for c in steps)
        assert not any(c["guard"]["status"] & Status.ENDING for c in steps)
        rate = float(re.search(r"max_rate = ([0-9.]+)", config.read_text())[1])  # type: ignore[index]
        for one, two in pairwise(steps):
            dt = two["time"] - one["time"]
            for i in range(3):
                moved = abs(correction(two)[i] - correction(one)[i])
                assert moved <= 1e3 * rate * dt + 0.05
        assert run.end() == 0


def far(cycle: dict[str, object], before: dict[str, object]) -> float:
    return max(abs(a - b) for a, b in zip(correction(cycle), correction(before), strict=True))


def correction(cycle: dict[str, object]) -> list[float]:
    """µm, in X, Y, Z."""
    found = cycle["correction"]
    assert isinstance(found, dict)
    return [1e3 * float(found[axis]) for axis in "XYZ"]


def test_a_bad_file_changes_nothing_and_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        own_model(tmp_path) as (_, config),
        supervised(tmp_path, monkeypatch, config) as (run, manager),
    ):
        run.until(compensating)
        good = config.read_text()
        edit(config, lambda text: text.replace("[guard]", "[guard]\nmax_speed = 1"))
        since = len(manager.messages)
        run.process.send_signal(signal.SIGHUP)
        until_journal(config, "going on with what runs")
        assert "max_speed" in journal(config)
        manager.until("READY=1", since)
        assert compensating(run.until(lambda _: True))
        config.write_text(good)
        run.process.send_signal(signal.SIGHUP)
        until_journal(config, "reload: nothing has changed")
        assert run.end() == 0


@pytest.mark.thorough
def test_other_wires_ramp_out_and_begin_anew_in_the_same_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        own_model(tmp_path) as (port, config),
        supervised(tmp_path, monkeypatch, config) as (run, manager),
    ):
        run.until(compensating)
        edit(
            config, lambda text: text.replace("[cycle]\nperiod = 0.02 ", "[cycle]\nperiod = 0.03 ")
        )
        since, so_far = len(run.cycles), len(manager.messages)
        run.process.send_signal(signal.SIGHUP)
        run.until(lambda c: bool(c["guard"]["status"] & Status.ENDING), since)
        again = run.until(lambda c: c["cycle"] == 1, since)
        assert run.process.poll() is None
        run.until(compensating, run.cycles.index(again))
        assert any(message == "READY=1" for message in manager.messages[so_far:]) or manager.until(
            "READY=1", so_far
        )
        assert run.end() == 0
        assert read_holding(port, 0, 1) == b"\0\0"
        assert journal(config).count("running: ") == 2


def test_what_is_changed_on_disk_is_said_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        own_model(tmp_path) as (_, config),
        supervised(tmp_path, monkeypatch, config) as (run, _),
    ):
        run.until(compensating)
        os.utime(config)  # touched is not changed
        edit(config.with_name("model.toml"), lambda text: text + "\n# a note\n")
        until_journal(config, "model.toml on disk is not what runs any more")
        assert run.end() == 0
        assert "config.toml on disk" not in journal(config)
