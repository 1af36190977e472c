"""One upload at a time: a lock that the operating system takes back when its owner dies."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from compcore.errors import AbbeError, InputError


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
        When the file cannot be made.
    """
    path = journal.with_name(journal.name + ".lock")
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", file=path) from None
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(descriptor, 64).decode("ascii", "replace").strip()
            raise AbbeError(
                f"another upload is running (process {owner or 'unknown'}, {path})"
            ) from None
        left = os.read(descriptor, 64).decode("ascii", "replace").strip()
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode("ascii"), 0)
        try:
            yield left
        finally:
            os.ftruncate(descriptor, 0)
    finally:
        os.close(descriptor)
