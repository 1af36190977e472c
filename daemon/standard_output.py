"""Standard output whose failures are one message: a full disk gives no traceback."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from typing import TYPE_CHECKING, TextIO

from abbe.compcore.errors import AbbeError

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


GONE = (errno.EPIPE, errno.EIO, errno.ENXIO)
"""What writing to a closed pipe, or to a terminal that was closed, fails with."""


class StandardOutputError(AbbeError):
    """Standard output does not take what is printed; `strerror` says why."""

    def __init__(self, strerror: str) -> None:
        self.strerror = strerror
        super().__init__(f"standard output cannot be written: {strerror}")


class _Descriptor(io.FileIO):
    """A descriptor whose failures are kept apart from those of other files."""

    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno in GONE:
                raise
            raise StandardOutputError(error.strerror or str(error)) from None


def install() -> None:
    """Put it in the place of Python's own; nothing where something else stands there already.

    Names of files that are no UTF-8 are written as JSON writes them.
    """
    ours = sys.stdout is sys.__stdout__ and sys.stdout is not None
    if not ours or sys.stdout.closed or sys.stdout.fileno() != 1:
        return
    sys.stdout.flush()
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(_Descriptor(1, "w", closefd=False)),
        encoding=sys.stdout.encoding,
        errors="backslashreplace",
        line_buffering=sys.stdout.isatty(),
    )


def finish() -> str:
    """Print what waits; returns why it could not be, empty when it could or nobody reads.

    What cannot be printed goes nowhere from now on, on standard error too: the interpreter would
    try it once more at its end, with a traceback or an exit status of its own.
    """
    reported = ""
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None and not stream.closed:
                stream.flush()
        except (StandardOutputError, OSError) as error:
            silence(stream)
            if isinstance(error, StandardOutputError):
                reported = str(error)
    return reported


def silence(stream: TextIO) -> None:
    """Have what a stream still holds go nowhere, so that closing it is no error."""
    with contextlib.suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
