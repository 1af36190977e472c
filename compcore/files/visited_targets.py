"""Targets that a machine was followed to while an instrument wrote a file of its own."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.head import BEGUN
from abbe.compcore.files.text.bounded_text import read_bounded
from abbe.compcore.files.text.toml_source import TomlSource

READINGS, IN_A_FILE = "readings", "file"
"""Key of the head's section ``[measured]``, and what it says where readings come afterwards."""
_MOST_BYTES = 1 << 28


@dataclass(frozen=True)
class VisitedTargets:
    """The rows of such a file: all of a campaign's but the value.

    Attributes
    ----------
    path
        The file.
    head
        Its metadata.
    columns
        Titles, in the file's order.
    rows
        Column → cell; of one set-up.
    lines
        Line of each row.
    setup
        The set-up.
    """

    path: Path
    head: dict[str, Any]
    columns: tuple[str, ...]
    rows: tuple[dict[str, str], ...]
    lines: tuple[int, ...]
    setup: str

    @classmethod
    def read_all(cls, path: Path) -> tuple[VisitedTargets, ...]:
        """Read the rows of every set-up, in the file's order.

        Raises
        ------
        InputError
            As `read`, and where no target was read.
        """
        read_head(path)
        columns, rows = _rows(path)
        names = dict.fromkeys(row.get("setup", "") for _, row in rows)
        if "setup" not in columns or not names:
            raise InputError("no target was read", file=path, expected="abbe measure to its end")
        return tuple(cls.read(path, name) for name in names)

    @classmethod
    def read(cls, path: Path, setup: str) -> VisitedTargets:
        """Read the rows of a set-up; empty: of the only one there is.

        Raises
        ------
        InputError
            For a file that abbe measure did not write so, a set-up that it does not have, and rows
            that have a value.
        """
        head = read_head(path)
        columns, rows = _rows(path)
        names = list(dict.fromkeys(row.get("setup", "") for _, row in rows))
        wanted = setup or (names[0] if len(names) == 1 else "")
        if wanted not in names:
            raise InputError(
                "no such set-up" if setup else "several set-ups, and one file",
                file=path,
                field="setup",
                found=setup or ", ".join(names),
                expected="one of " + ", ".join(names),
            )
        own = [(n, row) for n, row in rows if row["setup"] == wanted]
        for number, row in own:
            if row.get("value", "").strip():
                raise InputError(
                    "has its value already", file=path, line=number, field="value",
                    found=row["value"], expected="a set-up whose readings are in a file",
                )  # fmt: skip
        return cls(path, head, columns, tuple(r for _, r in own), tuple(n for n, _ in own), wanted)


def read_head(path: Path) -> dict[str, Any]:
    """The head of such a file; raises `InputError` as `VisitedTargets.read`."""
    head = dict(TomlSource("\n".join(_top(_lines(path))), str(path)).data)
    if not isinstance(head.get(BEGUN), dict) or head[BEGUN].get(READINGS) != IN_A_FILE:
        raise InputError(
            "no targets whose readings come afterwards",
            file=path,
            field=f"{BEGUN}.{READINGS}",
            expected='what abbe measure writes of an instrument with reads = "file"',
        )
    return head


def _lines(path: Path) -> list[str]:
    text = read_bounded(path, _MOST_BYTES, expected="targets that abbe measure followed")
    return text.split("\n")


def _top(lines: list[str]) -> list[str]:
    return [line.removeprefix("#").removeprefix(" ") for line in lines if line.startswith("#")]


def _rows(path: Path) -> tuple[tuple[str, ...], list[tuple[int, dict[str, str]]]]:
    """Titles, and each row with its line."""
    lines = _lines(path)
    above = len(_top(lines))
    table = list(csv.reader(lines[above:]))
    columns = tuple(table[0]) if table else ()
    numbered = [(above + 2 + i, cells) for i, cells in enumerate(table[1:]) if cells]
    for number, cells in numbered:
        if len(cells) != len(columns):
            raise InputError(
                "a row of another length", file=path, line=number, found=len(cells),
                expected=f"{len(columns)} cells",
            )  # fmt: skip
    return columns, [(n, dict(zip(columns, cells, strict=True))) for n, cells in numbered]
