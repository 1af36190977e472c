"""One upload at a time: a lock that the operating system takes back when its owner dies."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from abbe.compcore.errors import AbbeError, InputError

_FLAGS = os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK
_LOOKED_AT = 64
"""Bytes of the file that are read; a number of a process has fewer."""


@contextmanager
def only_one(journal: Path) -> Iterator[str]:
    """Hold the lock beside a journal; yields whom a dead upload left it to, empty for nobody.

    The file stays: the lock is on it, not its existence. A process that was killed does not hold it
    any more, whatever stands in the file.

    Raises
    ------
    AbbeError
        When another upload is running; says which process.
    InputError
        When the file cannot be made or written, is a link, or holds something else.
    """
    path = journal.with_name(journal.name + ".lock")
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | _FLAGS, 0o644)
    except OSError as error:
        # what a link leads to would be emptied
        link = error.errno in (errno.ELOOP, errno.EMLINK)
        raise InputError(
            f"cannot be written: {'it is a symbolic link' if link else error.strerror}",
            file=path,
            expected="the lock of an upload" if link else None,
        ) from None
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(descriptor, _LOOKED_AT).decode("ascii", "replace").strip()
            raise AbbeError(
                f"another upload is running (process {owner or 'unknown'}, {path})"
            ) from None
        left = _owner_in(descriptor, path)
        try:
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"{os.getpid()}\n".encode("ascii"), 0)
        except OSError as error:
            raise InputError(
                f"cannot be written: {error.strerror}; nothing was uploaded", file=path
            ) from None
        try:
            yield left
        finally:
            with contextlib.suppress(OSError):
                os.ftruncate(descriptor, 0)
    finally:
        os.close(descriptor)


def _owner_in(descriptor: int, path: Path) -> str:
    """Whom the lock was left by; whatever is no lock is not touched."""
    about = os.fstat(descriptor)
    mine = stat.S_ISREG(about.st_mode) and about.st_nlink == 1
    found = os.read(descriptor, _LOOKED_AT) if mine else b""
    owner = found.decode("ascii", "replace").strip()
    if not mine or (found and not owner.isdigit()):
        raise InputError(
            "is not the lock of an upload", file=path, found=owner or None,
            expected="the number of a process, or nothing, in a file of its own",
        )  # fmt: skip
    return owner
