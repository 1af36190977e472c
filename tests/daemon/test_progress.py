"""What a progress bar says of the time left, and that it is there on a terminal."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from abbe.daemon.progress import TimeLeft

DATA = Path(__file__).parents[1] / "data"


class Clock:
    """A clock that is set by hand, s."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_time_left_follows_the_pace_of_this_machine() -> None:
    clock = Clock()
    bar = TimeLeft((("reading", 1.0), ("fitting", 4.0), ("drawing", 2.0)), clock)
    assert bar.left == pytest.approx(7.0)
    assert bar.done == 0.0
    clock.now += 2.0
    bar.begin("fitting the model")  # reading took twice as long as expected
    assert bar.left == pytest.approx(12.0)
    assert bar.done == pytest.approx(1.0 / 7.0)
    clock.now += 4.0
    assert bar.left == pytest.approx(8.0)
    bar.begin("something that nobody expected")
    assert bar.left == pytest.approx(8.0)
    clock.now += 100.0  # longer than expected: nearly done, never more
    assert bar.left == pytest.approx(4.0 + 0.05 * 8.0)
    bar.begin("drawing")
    assert bar.done == pytest.approx(5.0 / 7.0)


def test_what_was_left_out_counts_as_done() -> None:
    clock = Clock()
    bar = TimeLeft((("reading", 1.0), ("outliers", 5.0), ("drawing", 2.0)), clock)
    clock.now += 1.0
    bar.begin("drawing")
    assert bar.done == pytest.approx(6.0 / 8.0)


def test_without_stages_nothing_is_promised() -> None:
    bar = TimeLeft((), Clock())
    bar.begin("reading")
    assert bar.left == 0.0
    assert bar.done == 0.0


@pytest.mark.thorough
@pytest.mark.integration
def test_a_terminal_shows_how_long_a_diagnosis_will_take(tmp_path: Path) -> None:
    files = [str(DATA / "p03-bridge" / name) for name in ("model.toml", "fit.csv")]
    ours, theirs = pty.openpty()
    script = "import abbe.daemon.progress as p; p.PATIENCE = 0.0; import sys; "
    script += (
        f"sys.argv = {['abbe', 'diagnose', *files]!r}; from abbe.daemon.cli import main; main()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.DEVNULL, stderr=theirs, cwd=tmp_path
    )
    os.close(theirs)
    shown = b""
    while True:
        try:
            piece = os.read(ours, 4096)
        except OSError:  # the other end is closed
            break
        if not piece:
            break
        shown += piece
    os.close(ours)
    assert process.wait() == 0
    assert b" candidates" in shown
    assert b" left" in shown
