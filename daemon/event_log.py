"""The journal: every event once, in a file that is rotated, on standard error, on the screen."""

from __future__ import annotations

import contextlib
import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener, RotatingFileHandler
from pathlib import Path
from queue import SimpleQueue

from abbe.compcore.errors import InputError
from abbe.daemon.systemd.journald import JournaldHandler

_FORMAT = "%(asctime)s %(levelname)-7s %(message)s"
_WAITING = 10_000
"""Events that wait at most for a disk that hangs."""
logger = logging.getLogger("abbe.journal")


class JournalFile(RotatingFileHandler):
    """The file of a journal; a disk that is full is one event, not one for each that is lost.

    Parameters
    ----------
    file
        Path; a symbolic link is followed and stays one.
    max_bytes, keep
        As `journal` takes them.

    Raises
    ------
    OSError
        When it cannot be opened.
    """

    def __init__(self, file: Path, max_bytes: int, keep: int) -> None:
        self._lost = 0
        # a device is named by its own path: what /dev/stdout leads to may have none
        device = file.exists() and not file.is_file()
        super().__init__(
            file if device else file.resolve(),
            maxBytes=max_bytes,
            backupCount=keep,
            encoding="utf-8",
            errors="backslashreplace",
        )

    def emit(self, record: logging.LogRecord) -> None:
        """Write an event; when events before it were lost, say how many."""
        lost = self._lost
        super().emit(record)
        if lost and self._lost == lost:
            self._lost = 0
            logger.warning("the journal is written again; %d events are missing in it", lost)

    def handleError(self, record: logging.LogRecord) -> None:
        """Count an event that could not be written; the first is reported, once."""
        error = sys.exc_info()[1]
        if not isinstance(error, OSError):
            super().handleError(record)
            return
        # what the stream still holds would come twice, or in part
        stream, self.stream = self.stream, None
        if stream is not None:
            with contextlib.suppress(OSError):
                stream.close()
        self._lost += 1
        if self._lost == 1:
            logger.error(
                "the journal cannot be written: %s (%s); going on without it",
                error.strerror,
                self.baseFilename,
            )


class BoundedQueueHandler(QueueHandler):
    """Hands events to the thread that writes them; where that hangs, memory does not grow for ever.

    Parameters
    ----------
    waiting
        The thread's queue.
    most
        Events that may wait.
    """

    queue: SimpleQueue[logging.LogRecord]

    def __init__(self, waiting: SimpleQueue[logging.LogRecord], most: int = _WAITING) -> None:
        super().__init__(waiting)
        self._most, self._lost = most, 0

    def enqueue(self, record: logging.LogRecord) -> None:
        """Hand one event over, or lose it; when there is room again, say how many were lost."""
        if self.queue.qsize() >= self._most:
            self._lost += 1
            return
        if self._lost:
            words = f"the journal's disk did not keep up: {self._lost} events are missing"
            self._lost = 0
            self.queue.put(
                logging.makeLogRecord(
                    {"name": logger.name, "levelno": logging.WARNING, "levelname": "WARNING",
                     "msg": words}
                )
            )  # fmt: skip
        self.queue.put(record)


@contextmanager
def journal(
    file: Path | None,
    *,
    max_bytes: int = 5_000_000,
    keep: int = 5,
    to_stderr: bool = True,
    more: Sequence[logging.Handler] = (),
) -> Iterator[None]:
    """Send all of Abbe's log records to the journal while the context lasts.

    Files and standard error are written by a thread of their own: a slow disk does not stop a
    machine.

    Parameters
    ----------
    file
        Path, None: no file.
    max_bytes, keep
        The file is put aside when it has grown to `max_bytes`; `keep` of them are kept.
    to_stderr
        Whether events also go to standard error, or to systemd's journal where that is behind it.
    more
        Further handlers, called at once.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    slow: list[logging.Handler] = []
    if file is not None:
        try:
            slow.append(JournalFile(file, max_bytes, keep))
        except OSError as error:
            raise InputError(
                f"the journal cannot be written: {error.strerror}", file=file
            ) from None
    if to_stderr:
        slow.append(JournaldHandler.of_environment() or logging.StreamHandler(sys.stderr))
    for handler in slow:
        handler.setFormatter(logging.Formatter(_FORMAT))
    waiting: SimpleQueue[logging.LogRecord] = SimpleQueue()
    listener = QueueListener(waiting, *slow)
    root = logging.getLogger("abbe")
    handlers: list[logging.Handler] = [BoundedQueueHandler(waiting), *more]
    level, root.level = root.level, logging.INFO
    for handler in handlers:
        root.addHandler(handler)
    listener.start()
    try:
        yield
    finally:
        for handler in handlers:
            root.removeHandler(handler)
        root.setLevel(level)
        listener.stop()
        for handler in slow:
            with contextlib.suppress(OSError):
                handler.close()
