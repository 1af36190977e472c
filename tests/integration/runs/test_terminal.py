"""``abbe run`` on a real (pseudo-)terminal: the live screen, as a user sees it."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from tests.support.daemon.live_run import PATIENCE, machine

pytestmark = pytest.mark.integration


@pytest.mark.one_in(2)
@pytest.mark.parametrize("columns", [80, 130])
def test_the_live_screen_is_drawn_and_stays(tmp_path: Path, columns: int) -> None:
    near, far = pty.openpty()
    fcntl.ioctl(far, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    with machine(tmp_path) as (_, config):
        process = subprocess.Popen(
            [sys.executable, "-m", "abbe.daemon", "run", str(config), "--duration", "6"],
            stdin=far,
            stdout=far,
            stderr=far,
            env={**os.environ, "TERM": "xterm-256color"},
        )
        os.close(far)
        text = _read_all(near).decode("utf-8")
        assert process.wait(PATIENCE) == 0
    os.close(near)
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)
    assert "Traceback" not in plain
    assert "CORRECTED IN FULL" in plain
    assert "ENDED, NOT CORRECTED" in plain
    last = plain[plain.rindex("╭") :].replace("\r", "").splitlines()
    assert max(map(len, last)) <= columns
    for words in ("axis", "error µm", "T_x1", "link cmm", "guard: X, Y, Z: corrected in full"):
        assert words in plain[plain.rindex("╭") :]
    # one picture over the other: a second one below the first would scroll the screen away
    assert plain.count("╭") > 5
    assert text.count("\x1b[1A") > 5 * 10


def _read_all(terminal: int) -> bytes:
    """What is written until the other end closes, which a terminal reports as an error."""
    data = b""
    while True:
        try:
            part = os.read(terminal, 65536)
        except OSError:
            return data
        if not part:
            return data
        data += part
