"""The terminal is closed under ``abbe run``: it ends as when it is told to, or goes on unseen."""

from __future__ import annotations

import fcntl
import os
import pty
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from abbe.daemon.status_word import Status
from tests.support.daemon.live_run import PATIENCE, machine, matched, read_holding

pytestmark = pytest.mark.integration


class Terminal:
    """``abbe run`` alone on a pseudo-terminal whose screen is read, until it is closed."""

    def __init__(self, config: Path, *arguments: str, before: tuple[str, ...] = ()) -> None:
        self.near, far = pty.openpty()
        fcntl.ioctl(far, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 120, 0, 0))
        self.process = subprocess.Popen(
            [*before, sys.executable, "-m", "abbe.daemon", "run", str(config), *arguments],
            stdin=far,
            stdout=far,
            stderr=far,
            start_new_session=True,
            # the terminal controls it: whoever closes it hangs up
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
            env={**os.environ, "TERM": "xterm-256color"},
        )
        os.close(far)
        self._closing = threading.Event()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        os.set_blocking(self.near, False)
        while not self._closing.wait(0.02):
            try:
                while os.read(self.near, 65536):
                    pass
            except OSError:
                continue

    def close(self) -> None:
        """As a window is closed."""
        if not self._closing.is_set():
            self._closing.set()
            self._reader.join()
            os.close(self.near)


@contextmanager
def on_a_terminal(
    config: Path, *arguments: str, before: tuple[str, ...] = ()
) -> Iterator[Terminal]:
    terminal = Terminal(config, *arguments, before=before)
    try:
        yield terminal
    finally:
        terminal.close()
        if terminal.process.poll() is None:
            terminal.process.kill()
        terminal.process.wait(PATIENCE)


def until(port: int, bit: Status) -> None:
    """Wait until the controller's copy of Abbe's status word has a bit."""
    deadline = time.monotonic() + PATIENCE
    while not int.from_bytes(read_holding(port, 0, 1)) & bit:
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("arguments", [(), ("--json",)], ids=["screen", "json"])
def test_a_closed_terminal_is_an_end_with_a_ramp(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    with machine(tmp_path) as (simulator, config):
        text = config.read_text().replace("ramp = 2.0", "ramp = 5.0", 1)
        assert "ramp = 5.0" in text
        config.write_text(text)
        with on_a_terminal(config, *arguments) as terminal:
            until(simulator.port, Status.COMPENSATING)
            terminal.close()
            until(simulator.port, Status.ENDING)
            # shells tell their jobs as well: no reason to leave out the ramp
            terminal.process.send_signal(signal.SIGHUP)
            assert terminal.process.wait(PATIENCE) == 0
        assert read_holding(simulator.port, 0, 1) == b"\0\0"
        journal = (tmp_path / "journal.log").read_text()
        assert "the terminal was closed: ending" in journal
        assert "Traceback" not in journal
        assert journal.rstrip().endswith("ended")
        # zero was reached: what was written last is what was read
        last = matched(simulator.port)
        for axis in "XYZ":
            assert last[f"corrected_{axis}"] == pytest.approx(
                last[f"matched_indicated_{axis}"], abs=1.5e-5
            )


@pytest.mark.thorough
@pytest.mark.one_in(2)
@pytest.mark.parametrize("arguments", [(), ("--json",)], ids=["screen", "json"])
def test_under_nohup_it_goes_on_without_its_terminal(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    ignoring = ("env", "--ignore-signal=HUP")  # as nohup does, which moves the output as well
    with machine(tmp_path) as (simulator, config):
        with on_a_terminal(config, *arguments, before=ignoring) as terminal:
            until(simulator.port, Status.COMPENSATING)
            terminal.close()
            beats = set()
            deadline = time.monotonic() + PATIENCE
            # more cycles than lines fit into any buffer on the way
            while len(beats) < 20:
                assert terminal.process.poll() is None
                assert time.monotonic() < deadline
                beats.add(read_holding(simulator.port, 1, 1))
                time.sleep(0.1)
            until(simulator.port, Status.COMPENSATING)
            terminal.process.send_signal(signal.SIGTERM)
            assert terminal.process.wait(PATIENCE) == 0
        assert read_holding(simulator.port, 0, 1) == b"\0\0"
        assert "Traceback" not in (tmp_path / "journal.log").read_text()


def test_a_full_disk_does_not_stop_the_machine_and_is_reported(tmp_path: Path) -> None:
    with machine(tmp_path) as (simulator, config), Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "abbe.daemon", "run", str(config), "--json"]
        process = subprocess.Popen(command, stdout=full, stderr=subprocess.PIPE, text=True)
        until(simulator.port, Status.COMPENSATING)
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == 1
        assert "abbe: standard output could not be written: No space left on device" in errors
        assert "Traceback" not in errors
        assert read_holding(simulator.port, 0, 1) == b"\0\0"
