"""Unfinished uploads, as the journal has them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.daemon.upload.history.content import short
from abbe.daemon.upload.history.upload_log import Entry, read_journal


def unfinished_words(entries: Sequence[Entry]) -> str:
    """An unfinished upload for people."""
    first, last = entries[0], entries[-1]
    return (
        f"the upload of {first['time']} by {first.get('who') or 'somebody'} "
        f"({short(first['old'])} → {short(first['new'])}) was not finished; the journal ends at "
        f"'{last['step']}' ({last['outcome']})"
    )


def unfinished_in(path: Path) -> str:
    """What a journal says of an unfinished upload, for ``abbe run``; empty when there is none.

    A journal that cannot be read is reported too.
    """
    try:
        entries = read_journal(path).unfinished()
    except InputError as error:
        return str(error)
    return unfinished_words(entries) if entries else ""
