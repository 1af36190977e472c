"""A set of files that is, was or will be active, and its one SHA-256."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from abbe.compcore.files.table_set import TableSet
from abbe.drivers.stores.base import Files


def checksum(files: Files) -> str:
    """One SHA-256 of all files and their names, hexadecimal, as in a table's record; none: empty.

    >>> checksum({})
    ''
    """
    return TableSet("", {}, files).checksum if files else ""


def short(sha: str) -> str:
    """A SHA-256 for people.

    >>> short("")
    'no table'
    """
    return sha[:12] if sha else "no table"


@dataclass(frozen=True)
class Content:
    """The content of a table memory.

    Attributes
    ----------
    sha256
        Of all files; empty: no table.
    files
        The files, where they are at hand.
    """

    sha256: str
    files: Mapping[str, str] | None = None

    @classmethod
    def of(cls, files: Files) -> Content:
        """Of files."""
        return cls(checksum(files), dict(files))

    @property
    def none(self) -> bool:
        """Whether it is no table at all."""
        return not self.sha256

    def same(self, files: Files) -> bool:
        """Whether files are these, byte for byte."""
        if self.files is not None:
            return dict(files) == dict(self.files)
        return checksum(files) == self.sha256
