"""A machine's files as they are uploaded: models, campaigns, rows of check measurements."""

from __future__ import annotations

import csv
import hashlib
import json
import stat
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

_LARGEST = 200_000_000
"""Bytes of a file that is taken."""
_SETTLED = 30.0
"""s that a campaign has to be left alone: one that is still being measured grows."""
_MOST = 10_000
"""Files that a pattern may find."""
_CAMPAIGN = b'# format = "abbe-campaign/1"'
_HEAD = 4096


@dataclass(frozen=True, slots=True)
class StoredFile:
    """A file's content, and what is said of it.

    Attributes
    ----------
    path
        As the configuration reaches it.
    sha256
        Of the content.
    content
        All of it.
    changed
        s since 1970.
    """

    path: str
    sha256: str
    content: bytes
    changed: float


@dataclass(frozen=True, slots=True)
class CheckReading:
    """One row of a machine's check measurements.

    Attributes
    ----------
    key
        Which one it is, whatever stands beside it in the file.
    number
        Its place among the rows.
    time
        s since 1970.
    reading
        Column → what stands there; empty cells are left out.
    """

    key: str
    number: int
    time: float
    reading: dict[str, str]


class FolderFiles:
    """Files of some patterns, each read when it is new or has changed.

    Parameters
    ----------
    folder
        That relative names begin in.
    patterns
        Names or patterns.
    say
        Takes a sentence for the journal.
    """

    def __init__(self, folder: Path, patterns: Sequence[str], say: Callable[[str], None]) -> None:
        self._folder, self._patterns, self._say = folder, patterns, say
        self._known: dict[Path, tuple[int, int, int]] = {}
        self._said: set[Path] = set()

    def changed(self, *, settled: bool) -> Iterator[StoredFile]:
        """Those that are new or changed; each is known from when the next one is asked for."""
        for path in self._found():
            try:
                state = path.stat()
                mark = (state.st_ino, state.st_size, state.st_mtime_ns)
                if self._known.get(path) == mark or not stat.S_ISREG(state.st_mode):
                    continue
                if settled and 0.0 <= time.time() - state.st_mtime < _SETTLED:
                    continue
                if state.st_size > _LARGEST:
                    self._once(path, f"{path} is larger than {_LARGEST // 10**6} MB: not uploaded")
                    continue
                content = path.read_bytes()
            except OSError as error:
                self._once(path, f"{path} cannot be read: {error.strerror}")
                continue
            name = str(path.relative_to(self._folder) if _below(path, self._folder) else path)
            yield StoredFile(name, sha256_of(content), content, state.st_mtime)
            self._known[path] = mark
            self._said.discard(path)

    def _found(self) -> Iterator[Path]:
        taken = 0
        for pattern in self._patterns:
            root, inner = (Path("/"), pattern[1:]) if pattern.startswith("/") else (
                self._folder, pattern)  # fmt: skip
            for path in sorted(root.glob(inner.strip("/"))):
                taken += 1
                if taken > _MOST:
                    self._once(root, f"{pattern} finds more than {_MOST} files: the rest is left")
                    return
                yield path

    def _once(self, path: Path, text: str) -> None:
        if path not in self._said:
            self._said.add(path)
            self._say(text)


def sha256_of(content: bytes) -> str:
    """As ``sha256sum`` prints it."""
    return hashlib.sha256(content).hexdigest()


def is_campaign(content: bytes) -> bool:
    """Whether it begins as a campaign does; other tables lie about too."""
    return _CAMPAIGN in content[:_HEAD].replace(b"\xef\xbb\xbf", b"").replace(b"=  ", b"= ")


def fitted_at(content: bytes) -> datetime | None:
    """When a model was fitted, as its file says.

    Raises
    ------
    ValueError
        For what is no model.
    """
    data: dict[str, Any] = tomllib.loads(content.decode("utf-8"))
    if not str(data.get("format", "")).startswith("abbe-model/"):
        raise ValueError("not a model")
    said = data.get("fit", {}).get("date")
    if isinstance(said, datetime):
        return said
    try:
        return datetime.fromisoformat(str(said))
    except ValueError:
        return None


def check_readings(content: bytes) -> tuple[str, list[CheckReading]]:
    """The head of a file of check measurements, and its rows.

    Raises
    ------
    ValueError, KeyError
        For what is none.
    """
    lines = content.decode("utf-8-sig").splitlines(keepends=True)
    count = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    found: list[CheckReading] = []
    times: dict[str, int] = {}
    for number, row in enumerate(csv.DictReader(lines[count:])):
        # a column that comes later leaves the rows before it as they were
        reading = {k: v for k, v in row.items() if k is not None and v not in ("", None)}
        digest = sha256_of(json.dumps(reading, sort_keys=True).encode())[:32]
        times[digest] = times.get(digest, 0) + 1
        key = digest if times[digest] == 1 else f"{digest}-{times[digest]}"
        found.append(CheckReading(key, number, float(reading["time"]), reading))
    return "".join(lines[:count]), found


def _below(path: Path, folder: Path) -> bool:
    return path.is_relative_to(folder)
