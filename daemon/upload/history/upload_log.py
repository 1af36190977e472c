"""The journal of uploads: JSON lines, append-only, on the disk before the next step begins.

Each line carries the SHA-256 of the line before it, and a file beside the journal (`journal_head`)
that of the last one: a line that was changed, taken out or cut off is noticed. There is no key in
it: who computes all the sums anew, and the head, is not noticed. A power cut may tear the last
line; it is then kept as it is, and the next line says so.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.atomic import encoded, sync_folder
from abbe.compcore.files.text.json_source import shaped
from abbe.daemon.upload.history.entry import EntryShape
from abbe.daemon.upload.history.log_head import UploadLogHead, path_of, read_head, write_head

FORMAT = "abbe-uploads/1"
FIRST = "0" * 64
"""What the first line has in place of the SHA-256 of the one before."""
_START = b'{"format": "abbe-uploads/1"'
"""First bytes of every journal."""
_MOST_BYTES = 256_000_000
"""Of a journal: a hundred thousand uploads."""
END = "end"
"""Step of an upload's last line."""

Entry = Mapping[str, Any]


@dataclass(frozen=True)
class UploadRecords:
    """The records in a journal.

    Attributes
    ----------
    entries
        Whole lines, in order.
    seal
        SHA-256 of the last whole line.
    torn
        What follows that line: a line that was not finished (after power cuts in a row, several);
        empty when none was.
    ended
        Whether the file ends with the end of a line.
    """

    entries: tuple[Entry, ...] = ()
    seal: str = FIRST
    torn: bytes = b""
    ended: bool = True

    def uploads(self) -> dict[str, list[Entry]]:
        """Upload → its lines, in order."""
        found: dict[str, list[Entry]] = {}
        for entry in self.entries:
            found.setdefault(entry["upload"], []).append(entry)
        return found

    def unfinished(self) -> list[Entry]:
        """The lines of the last upload, where it has no last one; else empty."""
        if not self.entries:
            return []
        mine = self.uploads()[self.entries[-1]["upload"]]
        return [] if mine[-1]["step"] == END else mine


def read_journal(path: Path) -> UploadRecords:
    """Read a journal and check its seals; one that does not exist is empty.

    Raises
    ------
    InputError
        When it cannot be read, is no journal, or a line was changed, taken out or cut off; names
        the line.
    """
    # the head first: a line that is added meanwhile is in the journal before it is in the head
    head = read_head(path)
    data = _content(path)
    *lines, rest = data.split(b"\n")
    entries: list[Entry] = []
    seal = FIRST
    at_head = FIRST
    torn: list[bytes] = []
    for number, line in enumerate([*lines, rest], start=1):
        entry = _entry(line)
        if entry is None:
            torn.append(line)
            continue
        between = _seal(b"\n".join(torn)) if torn else ""
        if entry["previous"] != seal or entry.get("torn", "") != between:
            raise InputError(
                "the journal was changed: a line does not follow the one before it",
                file=path, line=number, field="previous", found=entry["previous"], expected=seal,
            )  # fmt: skip
        shaped(entry, EntryShape, path, number)
        torn.clear()
        seal = _seal(line)
        entries.append(entry)
        if head is not None and len(entries) == head.lines:
            at_head = seal
    if torn and not torn[-1]:
        torn.pop()  # the file ends with the end of a line
    if head is not None and at_head != head.last:
        lost = max(head.lines - len(entries), 0)
        raise InputError(
            "the journal was changed: "
            + (f"{lost} lines at its end are missing" if lost else "its last line is another"),
            file=path, line=None if lost else head.lines,
            expected=f"what {path_of(path)} says; to begin anew, put both files aside",
        )  # fmt: skip
    return UploadRecords(tuple(entries), seal, b"\n".join(torn), not rest)


def _content(path: Path) -> bytes:
    """A journal's bytes, when it is one, or a first line that a power cut tore."""
    try:
        with path.open("rb") as stream:
            data = stream.read(_MOST_BYTES + 1)
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from None
    start = data[: len(_START)].split(b"\n")[0]
    torn = bool(start) and (_START.startswith(start) or not start.strip(b"\0"))
    if data.strip() and not torn:
        raise InputError(
            "is not a journal of uploads", file=path, line=1,
            found=start.decode("utf-8", "replace"), expected=_START.decode(),
        )  # fmt: skip
    if len(data) > _MOST_BYTES:
        raise InputError(
            f"too large: more than {_MOST_BYTES / 1e6:g} MB", file=path,
            expected=f"a new journal: put it and {path_of(path)} aside",
        )  # fmt: skip
    return data


def _seal(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _entry(line: bytes) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return None
    whole = isinstance(entry, dict) and all(
        isinstance(entry.get(key), str) for key in ("upload", "step", "outcome", "previous")
    )
    return entry if whole else None


class Journal:
    """A journal that is written to; the caller holds the lock.

    Parameters
    ----------
    path
        The file; made when the first line is written.

    Attributes
    ----------
    found
        What it held when it was opened.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.reload()

    def reload(self) -> None:
        """Read it anew, with what was appended.

        Raises
        ------
        InputError
            As `read_journal`.
        """
        self.found = read_journal(self._path)
        self._seal, self._torn, self._ended = self.found.seal, self.found.torn, self.found.ended
        self._lines = len(self.found.entries)

    def append(self, entry: Entry) -> None:
        """Add a line and wait until it is on the disk.

        Raises
        ------
        InputError
            When it cannot be written.
        """
        more = {"torn": _seal(self._torn)} if self._torn else {}
        text = json.dumps(
            {"format": FORMAT, "time": _now(), **entry, **more, "previous": self._seal},
            ensure_ascii=False,
        )
        line = encoded(text)
        # a torn line stays what it is: it is ended, not mended
        start = b"" if self._ended else b"\n"
        try:
            new = not self._path.exists()
            descriptor = os.open(self._path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
            before = os.fstat(descriptor).st_size
            try:
                _write_all(descriptor, start + line + b"\n")
                os.fsync(descriptor)
            except OSError:
                # a full disk took a part: it would tear the next line
                with contextlib.suppress(OSError):
                    os.ftruncate(descriptor, before)
                raise
            finally:
                os.close(descriptor)
            if new:
                sync_folder(self._path.parent)
        except OSError as error:
            raise InputError(
                f"the journal of uploads cannot be written: {error.strerror}", file=self._path
            ) from None
        self._seal, self._torn, self._ended = _seal(line), b"", True
        self._lines += 1
        write_head(self._path, UploadLogHead(self._lines, self._seal))


def _write_all(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data) :]


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def last_change(entries: Sequence[Entry]) -> Entry | None:
    """The last line that ended an upload with the new tables active; None: there was none."""
    ends = [e for e in entries if e["step"] == END and e.get("active") == "new"]
    return ends[-1] if ends else None
