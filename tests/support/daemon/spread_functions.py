"""Functions that tests have workers answer: quick, waiting, dying."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path

from abbe.compcore.errors import InputError

NAME = "tests.support.daemon.spread_functions:"


def reversed_text(contents: Mapping[str, bytes], argument: str) -> bytes:
    """The argument backwards, and what lies in the file."""
    return argument[::-1].encode() + contents.get("file", b"")


def once_noted(contents: Mapping[str, bytes], argument: str) -> bytes:
    """Leave a file of one's own beside the others, so that who works can be counted."""
    asked = json.loads(argument)
    folder = Path(asked["folder"])
    number = len(list(folder.glob(f"{asked['task']}-*")))
    (folder / f"{asked['task']}-{number}-{os.getpid()}").touch()
    if (folder / "hold").exists() and asked.get("waits"):
        (folder / "waiting").write_text(str(os.getpid()))
        while (folder / "hold").exists():
            time.sleep(0.01)
    return str(asked["task"]).encode()


def dying(contents: Mapping[str, bytes], argument: str) -> bytes:
    """Die as often as asked, then answer."""
    asked = json.loads(argument)
    mark = Path(asked["folder"]) / f"died-{asked['task']}"
    died = len(mark.read_text()) if mark.exists() else 0
    if died < asked["times"]:
        mark.write_text("x" * (died + 1))
        os.kill(os.getpid(), signal.SIGKILL)
    return str(asked["task"]).encode()


def refusing(contents: Mapping[str, bytes], argument: str) -> bytes:
    """Refuse, as for bad input."""
    raise InputError("no such thing", file="part.toml", line=7, field="at")
