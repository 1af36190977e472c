"""What was changed in a workbench, when and by whom, and what a person noted of a version."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path
from typing import Any

from abbe.compcore.errors import InputError
from abbe.daemon.answers.inputs import now
from abbe.daemon.workbench.versions.seen_file import SeenFile

NAME = "workbench.jsonl"
"""Of the file, in the folder of the versions."""
_TAIL = 1_000_000
"""Bytes at the end of the file that are read."""
_MOST = 500
"""Entries that are known, the newest."""

Entry = dict[str, Any]


class WorkbenchJournal:
    """One line of JSON for each change, appended and on the disk before the next one.

    Parameters
    ----------
    folder
        Where it lies; None: it is known until the end, as nothing else is written then.
    """

    def __init__(self, folder: Path | None) -> None:
        self.path = None if folder is None else folder / NAME
        self._lock = threading.Lock()
        self._known: list[Entry] = []

    def require(self) -> None:
        """Refuse a change where it could not be written down.

        Raises
        ------
        InputError
            Where the file takes no line.
        """
        self._append(b"")

    def keep(self, who: str, what: str, **more: Any) -> Entry:
        """Write down one change.

        Raises
        ------
        InputError
            Where the file takes no line.
        """
        entry: Entry = {"time": now(), "who": who, "what": what, **more}
        line = json.dumps(entry, ensure_ascii=False, separators=(",", ":")).encode() + b"\n"
        self._append(line)
        if self.path is None:
            with self._lock:
                self._known = [*self._known, entry][-_MOST:]
        return entry

    def note(self, who: str, version: SeenFile, text: str) -> None:
        """Write down what a person notes of a version's file, as it was read.

        Raises
        ------
        InputError
            For nothing, and where the file takes no line.
        """
        if not text.strip():
            raise InputError("nothing is noted", field="text")
        name, sha256 = version.path.name, version.sha256
        self.keep(who, "note", version=name, sha256=sha256, text=text.strip())

    def entries(self) -> list[Entry]:
        """What is known, the newest first; lines that are none are passed over."""
        if self.path is None:
            return self._known[::-1]
        try:
            with self.path.open("rb") as file:
                file.seek(max(0, file.seek(0, os.SEEK_END) - _TAIL))
                lines = file.read().splitlines()
        except OSError:
            return []
        return [e for e in map(_entry, reversed(lines)) if e is not None][:_MOST]

    def _append(self, line: bytes) -> None:
        if self.path is None:
            return
        try:
            with self._lock, self.path.open("ab") as file:
                if line:
                    file.write(line)
                    file.flush()
                    os.fsync(file.fileno())
        except OSError as error:
            raise InputError(f"takes no line: {error.strerror}", file=self.path) from None


def _entry(line: bytes) -> Entry | None:
    try:
        found = json.loads(line)
    except ValueError:
        return None
    if not isinstance(found, dict):
        return None
    texts = all(isinstance(found.get(key), str) for key in ("time", "who", "what"))
    return found if texts else None
