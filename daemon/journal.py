"""The journal: every event once, in a file that is rotated, on standard error, on the screen."""

from __future__ import annotations

import logging
import queue
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener, RotatingFileHandler
from pathlib import Path

from compcore.errors import InputError

_FORMAT = "%(asctime)s %(levelname)-7s %(message)s"


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
        Whether events also go to standard error.
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
            rotated = RotatingFileHandler(
                file, maxBytes=max_bytes, backupCount=keep, encoding="utf-8"
            )
        except OSError as error:
            raise InputError(
                f"the journal cannot be written: {error.strerror}", file=file
            ) from None
        slow.append(rotated)
    if to_stderr:
        slow.append(logging.StreamHandler(sys.stderr))
    for handler in slow:
        handler.setFormatter(logging.Formatter(_FORMAT))
    waiting: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    listener = QueueListener(waiting, *slow)
    root = logging.getLogger("abbe")
    handlers: list[logging.Handler] = [QueueHandler(waiting), *more]
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
            handler.close()
