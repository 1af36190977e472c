"""A set of tables with its files and its record: one thing to write, check and upload."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from abbe.compcore.errors import InputError
from abbe.compcore.files.formats import TABLES
from abbe.compcore.files.table_record import RecordFile
from abbe.compcore.files.text.atomic import write_together
from abbe.compcore.files.text.json_source import read_json, shaped
from abbe.compcore.tables.table import Table

RECORD_NAME = "abbe-tables.json"
"""The record beside the files of a set."""


def sha256(content: str | bytes) -> str:
    """SHA-256 of a file's content, hexadecimal."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    return hashlib.sha256(data).hexdigest()


@dataclass(frozen=True, eq=False)
class TableSet:
    """Tables for one controller.

    Attributes
    ----------
    controller
        Name of the controller's dialect.
    options
        Its options, as JSON values.
    files
        Name → text, exactly as the controller takes it.
    record
        What ISO/TR 16907, 9.1, asks for; see `abbe.compcore.tables.record`.
    tables
        What the files hold, as errors; empty where only the files are known.
    """

    controller: str
    options: Mapping[str, Any]
    files: Mapping[str, str]
    record: Mapping[str, Any] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()

    @property
    def checksums(self) -> dict[str, str]:
        """Name of each file → its SHA-256, hexadecimal."""
        return {name: sha256(text) for name, text in self.files.items()}

    @property
    def checksum(self) -> str:
        """One SHA-256 for all files and their names, hexadecimal."""
        lines = (f"{digest}  {name}\n" for name, digest in sorted(self.checksums.items()))
        return sha256("".join(lines))

    def document(self) -> dict[str, Any]:
        """The record file's content: the record, the controller and every file's checksum."""
        return {
            "format": TABLES,
            **self.record,
            "controller": self.controller,
            "options": dict(self.options),
            "files": self.checksums,
            "sha256": self.checksum,
        }

    def write(self, folder: str | Path) -> tuple[Path, ...]:
        """Write all files and the record, together, the record last; returns their paths.

        Raises
        ------
        InputError
            When the folder cannot be made or written.
        """
        target = Path(folder)
        try:
            target.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot be made: {error.strerror}", file=folder) from None
        document = json.dumps(self.document(), ensure_ascii=False, indent=1) + "\n"
        contents = {target / name: text for name, text in self.files.items()}
        contents[target / RECORD_NAME] = document
        write_together(contents)
        return tuple(contents)

    @classmethod
    def load(cls, folder: str | Path) -> TableSet:
        """Read a set that was written; its tables are left to the controller's dialect to read.

        Raises
        ------
        InputError
            When a file is missing, or is not what the record says.
        """
        path = Path(folder) / RECORD_NAME
        document, record = _record_in(path)
        files = {}
        for name, wanted in record.files.items():
            files[name] = read_text(path.parent / name)
            found = sha256(files[name])
            if found != wanted:
                raise InputError(
                    "the file was changed after it was made", file=path.parent / name,
                    field="sha256", found=found, expected=wanted,
                )  # fmt: skip
        rest = {k: v for k, v in document.items() if k not in _OWN_KEYS}
        made = cls(record.controller, record.options, files, rest)
        if made.checksum != record.sha256:
            raise InputError(
                "the record's list of files was changed after it was made", file=path,
                field="sha256", found=made.checksum, expected=record.sha256,
            )  # fmt: skip
        return made

    @staticmethod
    def checksums_in(folder: str | Path) -> dict[str, str]:
        """What the record in a folder says of its files: name → SHA-256; raises as `load`."""
        return dict(_record_in(Path(folder) / RECORD_NAME)[1].files)


_OWN_KEYS = frozenset({"format", "files", "controller", "options", "sha256"})


def _record_in(path: Path) -> tuple[dict[str, Any], RecordFile]:
    document = read_json(path)
    if not isinstance(document, dict) or document.get("format") != TABLES:
        raise InputError(
            "not a record of tables", file=path, field="format", expected=TABLES,
            found=document.get("format") if isinstance(document, dict) else None,
        )  # fmt: skip
    return document, shaped(document, RecordFile, path)


def read_text(path: str | Path) -> str:
    """A file's text with the line ends that it holds.

    Raises
    ------
    InputError
        When it cannot be read or is not text.
    """
    try:
        return Path(path).read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"not text (byte {error.start})", file=path) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from None
