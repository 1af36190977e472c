"""``abbe calibrate`` with a person at a terminal: asked before each step and set-up."""

from __future__ import annotations

import fcntl
import os
import pty
import re
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

from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import (
    SPEED,
    bench,
    configuration,
    driven,
    line_plan,
    write_plan,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

PATIENCE = 180.0
EFFECT = '[[effects]]\nkind = "positioning"\naxis = "X"\nshape = "polynomial:1"\n'


class Terminal:
    """A command at a terminal of its own, and a person who reads and types."""

    def __init__(self, folder: Path, *words: str) -> None:
        self._own, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 400, 0, 0))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "abbe.daemon", *words],
            cwd=folder, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
            env={**os.environ, "COLUMNS": "400", "TERM": "xterm"},
        )  # fmt: skip
        os.close(theirs)
        self._said = bytearray()
        self._at = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._own, 65536)
            except OSError:
                return
            if not data:
                return
            self._said += data

    @property
    def said(self) -> str:
        """All that stood on the screen, without its colours."""
        return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self._said.decode("utf-8", "replace"))

    def until(self, text: str) -> None:
        """Wait for a text after the last one that was waited for."""
        deadline = time.monotonic() + PATIENCE
        while (found := self.said.find(text, self._at)) < 0:
            late = self.said[-1500:]
            assert time.monotonic() < deadline, f"{text!r} not seen: {late}"
            assert self.process.poll() is None or text in self.said[self._at :], late
            time.sleep(0.02)
        self._at = found + len(text)

    def type(self, text: str) -> None:
        """Type a line."""
        os.write(self._own, text.encode() + b"\n")

    def wait(self) -> int:
        """Its exit status."""
        status = self.process.wait(PATIENCE)
        self._reader.join(5.0)
        return status

    def close(self) -> None:
        """End it."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._reader.join(5.0)
        os.close(self._own)


@contextmanager
def at_terminal(folder: Path, *words: str) -> Iterator[Terminal]:
    """A command at a terminal, that ends with the context."""
    terminal = Terminal(folder, *words)
    try:
        yield terminal
    finally:
        terminal.close()


def test_a_person_is_asked_sets_up_leaves_out_says_no_and_goes_on(tmp_path: Path) -> None:
    text = MODEL.read_text("utf-8")
    (tmp_path / "model.toml").write_text(text[: text.index("[[effects]]")] + EFFECT, "utf-8")
    words = ("calibrate", "config.toml", "--time", "60min", "--tool", "P=0,0,-150")
    folder = tmp_path / "calibration"
    with bench() as process:
        configuration(process.ready, tmp_path)
        with at_terminal(tmp_path, *words) as screen:
            screen.until("1/9 start: the model to begin with. Go on? [Y/n]:")
            screen.type("perhaps")  # neither: asked again
            screen.until("Go on? [Y/n]:")
            screen.type("")
            screen.until("2/9 plan: which measurements. Go on? [Y/n]:")
            screen.type("y")
            screen.until("3/9 measure: measuring. Go on? [Y/n]:")
            screen.type("n")
            screen.until("stopped; the same command goes on here")
            assert screen.wait() == 0
        assert not (folder / "campaign.csv").exists()
        # she has no time for all of it: the plan is changed by hand
        write_plan(
            folder / "plan.toml",
            line_plan("x_line", "X", [50, 200, 350, 500, 650], both_ways=False),
            line_plan("y_line", "Y", [100, 300, 500], both_ways=False),
        )
        moves = driven(folder / "plan.toml", tmp_path / "model.toml", stands=4.0)
        placed = [k for k, m in enumerate(moves) if "place" in m]
        arrived = next(k for k, m in enumerate(moves) if m.get("stands"))
        with at_terminal(tmp_path, *words) as screen:
            screen.until("2/9 plan: which measurements: done")
            screen.until("3/9 measure: measuring. Go on? [Y/n]:")
            screen.type("y")
            screen.until("Enter when it stands, s to leave it out")
            # the machine is at the first target: nothing is read before she has said that it stands
            process.order("drive", moves=moves[: arrived + 1], speed=SPEED)
            while process.order("where")["at_move"] <= arrived:
                time.sleep(0.05)
            assert "x_line target 1" not in screen.said
            screen.type("")
            screen.until("x_line target 1:")
            process.order("drive", moves=moves[arrived + 1 : placed[1]], speed=SPEED)
            screen.until("x_line target 6:")
            screen.until("set up y_line")
            screen.until("s to leave it out")
            screen.type("s")
            screen.until("y_line is left out")
            screen.until("measure is not done; the steps before it are")
            assert screen.wait() == 1
        # without the line she has no optics for
        kept = (folder / "campaign.csv").read_text("utf-8")
        assert kept.count("\n") > 10
        assert "Traceback" not in screen.said
