"""Secrets of processes beside a run: in files of their own that nobody else may read."""

from __future__ import annotations

import stat
from pathlib import Path


def password(path: Path) -> str:
    """The first line of a file that nobody else may read.

    Raises
    ------
    ValueError
        When others may read it, or it is no text.
    OSError
        When it cannot be read.
    """
    with path.open("rb") as file:
        if stat.S_IMODE(path.stat().st_mode) & 0o077:
            raise ValueError(f"{path}: others may read this password; chmod 600 {path}")
        line = file.readline(4096)
    return line.decode("utf-8").rstrip("\r\n")
