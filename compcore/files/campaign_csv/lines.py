"""A text file in pieces: its encoding, common line ends, line numbers kept, hashed on the way."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import BinaryIO, Self

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.encodings import shop_encoding
from abbe.compcore.sentences import said

CHUNK = 1 << 20
"""Bytes read at once: parsing needs some fifteen times this beside its result."""
LONGEST = 1 << 20
"""Bytes that a line may have."""
_BOM = b"\xef\xbb\xbf"
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")


class LineSource(AbstractContextManager["LineSource"]):
    """The lines of a file, read once from beginning to end.

    UTF-8; else Windows-1252 or GBK, as spreadsheets save them: what the first line with a letter
    beyond ASCII is written in holds for the whole file.

    Raises
    ------
    InputError
        When the file cannot be read or is not text in one of these; names the line.
    """

    def __init__(self, path: str | Path) -> None:
        self.file = str(path)
        self.next_line = 1
        self._path = Path(path)
        self._hash = hashlib.sha256()
        self._rest = b""
        self._ended = False
        self._encoding: str | None = None
        self._stream: BinaryIO

    def __enter__(self) -> Self:
        try:
            self._stream = self._path.open("rb")
        except FileNotFoundError:
            raise InputError("no such file", file=self.file) from None
        except IsADirectoryError:
            raise InputError("is a folder, not a file", file=self.file) from None
        except OSError as error:
            raise InputError(
                said("cannot be read: {why}", why=error.strerror), file=self.file
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    @property
    def sha256(self) -> str:
        """Hash of what was read so far, hexadecimal."""
        return self._hash.hexdigest()

    def chunks(self) -> Iterator[tuple[int, list[str]]]:
        """(number of the first line, whole lines without their ends), some MB at a time."""
        while not self._ended:
            block = self._read()
            if not block:
                continue
            first = self.next_line
            lines = self._decoded(block, first).split("\n")
            if not lines[-1]:
                lines.pop()
            self.next_line += len(lines)
            yield first, lines

    def _read(self) -> bytes:
        """Whole lines; what follows the last line end waits for the next block."""
        try:
            block = self._stream.read(CHUNK)
        except OSError as error:
            raise InputError(
                said("cannot be read: {why}", why=error.strerror), file=self.file
            ) from None
        self._hash.update(block)
        if not block:
            self._ended = True
            block, self._rest = self._rest, b""
            return block
        if b"\0" in block:
            before = (self._rest + block).partition(b"\0")[0]
            self._decoded(before, self.next_line)  # UTF-16 is reported as what it is
            line = self.next_line + before.count(b"\n")
            raise InputError("not a text file", file=self.file, line=line, found="\0")
        block = self._rest + block
        end = block.rfind(b"\n") + 1
        if len(block) - end > LONGEST:
            raise InputError(
                "not a text file of lines",
                file=self.file,
                line=self.next_line + block.count(b"\n"),
                found=f"a line of more than {LONGEST / 1e6:g} MB",
                expected="one observation a line",
            )
        self._rest = block[end:]
        return block[:end]

    def _decoded(self, block: bytes, first: int) -> str:
        if first == 1:
            block = block.removeprefix(_BOM)
        if self._encoding is None and not block.isascii():
            self._encoding = None if block.startswith(_UTF_16) else shop_encoding(block)
        try:
            text = block.decode(self._encoding or "utf-8")
        except UnicodeDecodeError as error:
            line = first + block.count(b"\n", 0, error.start)
            raise InputError(
                "not text in one encoding",
                file=self.file,
                line=line,
                found=block[error.start : error.start + 1],
                expected="a file saved as UTF-8 ('CSV UTF-8' in a spreadsheet) or Windows-1252",
            ) from None
        return text.replace("\r\n", "\n") if "\r" in text else text


def csv_cells(text: str, file: str, line: int, what: str) -> list[str]:
    """The cells of one line of comma-separated values.

    Raises
    ------
    InputError
        When it is not `what` it should be: quotes that do not end, a cell without end.
    """
    try:
        return next(csv.reader([text], strict=True))
    except csv.Error as error:
        wrong = said("not {what}: {why}", what=what, why=error)
        raise InputError(wrong, file=file, line=line, found=text[:40]) from None
