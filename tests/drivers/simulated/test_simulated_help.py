"""``python -m abbe.drivers.simulated --help`` names every command that there is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from abbe.drivers import simulated

FOLDER = Path(simulated.__file__).parent / "commands"
COMMANDS = sorted(
    path.stem for path in FOLDER.glob("*.py") if "def main(" in path.read_text(encoding="utf-8")
)


def helped(*words):
    command = [sys.executable, "-m", "abbe.drivers.simulated", *words, "--help"]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_every_command_is_named():
    assert {"bridge", "controller", "serial"} <= set(COMMANDS)
    listed = helped().stdout.split("}")[0].split("{")[1].replace("\n", "").split(",")
    assert set(COMMANDS) <= {name.strip() for name in listed}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_page(name):
    done = helped(name)
    assert done.returncode == 0, done.stderr
    assert name in done.stdout
