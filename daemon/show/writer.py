"""Writing lines without waiting: a reader that stops reading must not stop the machine."""

from __future__ import annotations

import contextlib
import errno
import os
import queue
import sys
import threading
from typing import TextIO

_WAITING = 20_000
"""Lines that may wait for a slow reader; a line more is dropped and counted."""
_PATIENCE = 10.0
"""s that a reader who has stopped reading is given at the end."""
_GONE = (errno.EPIPE, errno.EIO, errno.ENXIO)
"""What writing to a closed pipe, or to a terminal that was closed, fails with."""


class LineWriter:
    """Writes lines to a stream from a thread of its own, in order.

    Parameters
    ----------
    stream
        Where to.

    Attributes
    ----------
    dropped
        Lines lost since the last one that was taken, because the reader was too slow.
    failed
        Why nothing can be written any more, e.g. a full disk; None also where the reader has gone,
        because whoever closes a pipe or a terminal wants no more.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._queue: queue.Queue[str | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._write, name="lines", daemon=True)
        self._thread.start()
        self.dropped = 0
        self.failed: OSError | None = None

    def put(self, line: str) -> None:
        """Hand a line over; returns at once."""
        try:
            self._queue.put_nowait(line)
        except queue.Full:
            self.dropped += 1
        else:
            self.dropped = 0

    def end(self, *last: str) -> None:
        """Write what waits and some last lines; gives up on a reader that does not read."""
        try:
            for line in (*last, None):
                self._queue.put(line, timeout=_PATIENCE)
        except queue.Full:
            return
        self._thread.join(_PATIENCE)

    def _write(self) -> None:
        try:
            while (line := self._queue.get()) is not None:
                self._stream.write(line + "\n")
                if self._queue.empty():
                    self._stream.flush()
            self._stream.flush()
        except OSError as error:
            # nobody reads any more; the machine is corrected all the same
            if error.errno not in _GONE:
                self.failed = error
            _silence(self._stream)
            while self._queue.get() is not None:
                pass


def silence_closed() -> None:
    """Have standard output and standard error go nowhere where their terminal was closed.

    Otherwise the interpreter fails at its end to write what they still hold, and says so with an
    exit status of its own.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as error:
            if error.errno in _GONE:
                _silence(stream)


def _silence(stream: TextIO) -> None:
    """Have what a stream still holds go nowhere, so that closing it is no error."""
    with contextlib.suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
