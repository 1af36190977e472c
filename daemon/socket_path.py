"""The control socket's place: short enough for the system, and nobody else's."""

from __future__ import annotations

import contextlib
import os
import socket
import stat
from pathlib import Path

from abbe.compcore.errors import InputError

_LONGEST = 100
"""Bytes of a path that every Unix takes for a socket."""


def check_path(path: Path) -> None:
    """Refuse a path that cannot be a socket of ours.

    Raises
    ------
    InputError
        For a path that is too long, and a file of another kind.
    """
    if len(os.fsencode(path)) > _LONGEST:
        raise InputError(
            "too long for a socket's path", found=str(path), expected=f"{_LONGEST} bytes at most"
        )
    with contextlib.suppress(FileNotFoundError):
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise InputError("is there already and is no socket", found=str(path))


def bound(path: Path) -> socket.socket:
    """A socket that listens at a path, readable and writable for its owner only.

    What a process that is dead has left is taken away; a living one's socket never.

    Raises
    ------
    InputError
        As `check_path`, and where somebody listens there.
    OSError
        When the system refuses.
    """
    check_path(path)
    if path.exists():
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
            asking.settimeout(1.0)
            try:
                asking.connect(os.fspath(path))
            except (ConnectionRefusedError, FileNotFoundError):
                path.unlink(missing_ok=True)
            else:
                raise InputError("another correction is controlled there", found=str(path))
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(0o177)
    try:
        made.bind(os.fspath(path))
        made.listen(4)
    except OSError:
        made.close()
        raise
    finally:
        os.umask(before)
    made.setblocking(False)
    return made
