"""A line writer that never waits: a reader that stops reading must not stop the machine."""

from __future__ import annotations

import logging
import queue
import threading
from typing import TextIO

from abbe.daemon.standard_output import GONE, StandardOutputError, silence

logger = logging.getLogger("abbe.show")

_WAITING = 20_000
"""Lines that may wait for a slow reader; a line more is dropped and counted."""
_PATIENCE = 10.0
"""s that a reader who has stopped reading is given at the end."""


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
        Why nothing can be written any more, e.g. a full disk; empty also where the reader has gone,
        because whoever closes a pipe or a terminal wants no more.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._queue: queue.Queue[str | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._write, name="lines", daemon=True)
        self.dropped = 0
        self.failed = ""
        self._thread.start()

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
        except (StandardOutputError, OSError) as error:
            # nobody reads any more; the machine is corrected all the same
            if isinstance(error, StandardOutputError) or error.errno not in GONE:
                self.failed = str(error.strerror)
                logger.error("standard output cannot be written: %s; going on", self.failed)
            silence(self._stream)
            while self._queue.get() is not None:
                pass
