"""A campaign file that grows row by row: what is added is on the disk before it counts.

Written as any campaign file; the head's section ``[measured]`` says what it was begun with, so that
nobody else's rows are ever added to it.
"""

from __future__ import annotations

import csv
import errno
import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import tomli_w

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.head import BEGUN
from abbe.compcore.files.campaign_csv.writing import as_cell
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.text.atomic import sync_folder, write_atomically
from abbe.compcore.files.text.bounded_text import read_bounded
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.machine import Machine

ZEROS_AT = "zeros_at"
"""Key of a set-up: times from which its rows count from zeros of their own."""
_MOST_BYTES = 1 << 30

Row = Mapping[str, str | float | None]


class GrowingCampaign:
    """A campaign file and the rows in it.

    Attributes
    ----------
    path
        The file.
    rows
        Rows that were there when it was opened: column → cell.
    """

    def __init__(
        self, path: Path, head: dict[str, Any], columns: Sequence[str], rows: list[dict[str, str]]
    ) -> None:
        self.path = path
        self.rows = rows
        self._head = head
        self._columns = tuple(columns)
        self._file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        self._size = os.fstat(self._file).st_size
        self._last = 0

    @property
    def begun_with(self) -> Mapping[str, Any]:
        """What the head says it was begun with."""
        found: Mapping[str, Any] = self._head[BEGUN]
        return found

    @classmethod
    def begin(cls, path: Path, head: Mapping[str, Any], columns: Sequence[str]) -> GrowingCampaign:
        """Begin a file; there must be none of that name.

        Parameters
        ----------
        head
            Its metadata, with `BEGUN`.

        Raises
        ------
        InputError
            When it cannot be written.
        """
        if path.exists() and path.stat().st_size:
            raise InputError("is there already", file=path, expected="a new name")
        write_atomically(path, top_of(head, columns))
        return cls(path, dict(head), columns, [])

    @classmethod
    def resume(
        cls,
        path: Path,
        begun: Mapping[str, str],
        columns: Sequence[str],
        machine: Machine,
        newer: Sequence[str] = (),
    ) -> GrowingCampaign:
        """Go on with a file, after its last whole row.

        Parameters
        ----------
        begun
            What `BEGUN` has to say: key → text.
        newer
            Columns that a file has all together or not at all: an earlier version had none.

        Raises
        ------
        InputError
            For a file that was not begun so, or in which something is wrong.
        """
        text = read_bounded(path, _MOST_BYTES, expected="a campaign that abbe measure began")
        lines = text.split("\n")
        torn = lines.pop()  # what follows the last line end
        top = [line.removeprefix("#").removeprefix(" ") for line in lines if line.startswith("#")]
        head = TomlSource("\n".join(top), str(path)).data
        found = head.get(BEGUN)
        if not isinstance(found, dict):
            raise InputError(
                "is there already, and abbe measure did not begin it",
                file=path,
                expected="a new name",
            )
        for key, wanted in begun.items():
            if found.get(key) != wanted:
                raise InputError(
                    f"was begun with another {key.replace('_', ' ').removesuffix(' sha256')}",
                    file=path,
                    field=f"{BEGUN}.{key}",
                    found=found.get(key),
                    expected=f"{wanted}, or a new name for what is measured now",
                )
        below = lines[len(top) :]
        titles = next(csv.reader(below[:1]), [])
        if titles not in (list(columns), [name for name in columns if name not in newer]):
            raise InputError(
                "its columns are not those that are measured now",
                file=path,
                line=len(top) + 1,
                found=", ".join(titles),
                expected=", ".join(columns),
            )
        rows = [dict(zip(titles, cells, strict=False)) for cells in csv.reader(below[1:])]
        if torn:
            whole = len(text.encode("utf-8")) - len(torn.encode("utf-8"))
            os.truncate(path, whole)
        if rows and begun.get("readings") is None:
            read_campaign(path, machine)  # whatever is wrong in it is said before it grows
        return cls(path, head, titles, rows)

    def cut(self, rows: int) -> None:
        """Take the last rows away, those of a target that was not read to its end."""
        kept = self.rows[: len(self.rows) - rows]
        text = top_of(self._head, self._columns) + "".join(self._line(row) for row in kept)
        self._renew(text)
        self.rows = kept

    def declare(
        self,
        setup: str,
        free: Sequence[str],
        perhaps_lost: Mapping[str, Sequence[float]] = MappingProxyType({}),
    ) -> None:
        """Add a set-up to the head; the whole file is written anew, at once or not at all.

        Parameters
        ----------
        perhaps_lost
            Set-up that is there → times, s, from which its rows may count from another zero.

        Raises
        ------
        OSError
            When it could not be; the file is what it was.
        """
        setups = dict(self._head.get("setups", {}))
        if setup in setups and not perhaps_lost:
            return
        setups.setdefault(setup, {"free": list(free)})
        for name, times in perhaps_lost.items():
            known = setups[name].get(ZEROS_AT, [])
            setups[name] = setups[name] | {ZEROS_AT: sorted({*known, *times})}
        head = self._head | {"setups": setups}
        old = len(top_of(self._head, self._columns).encode("utf-8"))
        rows = os.pread(self._file, self._size - old, old).decode("utf-8")
        self._renew(top_of(head, self._columns) + rows)
        self._head = head

    def append(self, rows: Sequence[Row]) -> None:
        """Add rows; when it returns they are on the disk.

        Raises
        ------
        OSError
            When they are not; the file is what it was.
        """
        data = "".join(self._line(row) for row in rows).encode("utf-8")
        try:
            done = 0
            while done < len(data):
                done += os.pwrite(self._file, data[done:], self._size + done)
            os.fsync(self._file)
        except OSError:
            os.ftruncate(self._file, self._size)
            raise
        self._size += len(data)
        self._last = len(data)

    def withdraw(self) -> None:
        """Take away what was appended last, once.

        Raises
        ------
        OSError
            When it could not be; the file is what it was.
        """
        os.ftruncate(self._file, self._size - self._last)
        self._size, self._last = self._size - self._last, 0
        os.fsync(self._file)

    def close(self) -> None:
        """Close the file; safe to call twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _renew(self, text: str) -> None:
        try:
            write_atomically(self.path, text)
            sync_folder(self.path.parent)
        except InputError as error:
            # who is told names the file, and that it cannot be written
            why = str(error.problem).removeprefix("cannot be written: ")
            raise OSError(errno.EIO, why) from None
        file = os.open(self.path, os.O_RDWR | os.O_CLOEXEC)
        os.close(self._file)
        self._file, self._size = file, os.fstat(file).st_size

    def _line(self, row: Row) -> str:
        return ",".join(as_cell(row.get(name)) for name in self._columns) + "\n"


def top_of(head: Mapping[str, Any], columns: Sequence[str]) -> str:
    """Head and header line of a campaign file."""
    text = tomli_w.dumps(dict(head)).rstrip("\n")
    out = io.StringIO()
    for line in text.split("\n"):
        out.write(f"# {line}".rstrip() + "\n")
    out.write(",".join(as_cell(name) for name in columns) + "\n")
    return out.getvalue()
