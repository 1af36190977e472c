"""A campaign that a browser sends: bounded, text and nothing packed, whole or not there at all."""

from __future__ import annotations

import asyncio
import codecs
import contextlib
import hashlib
import os
import re
import secrets
from collections.abc import AsyncIterator, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from fastapi import HTTPException

from abbe.compcore.errors import InputError

LARGEST = 256_000_000
"""Bytes of a campaign that is sent: some three million rows."""
PAUSE = 15.0
"""s within which more has to come."""
WITHIN = 300.0
"""s in which all has to be there."""
_LONGEST_NAME = 120
_NAME = re.compile(r"[\w+(][\w .,+()=°-]*\.csv", re.IGNORECASE)
_DEVICE = re.compile(r"(con|prn|aux|nul|(com|lpt)[0-9¹²³]) *\.", re.IGNORECASE)
"""How names begin that Windows takes for a device: what a folder holds may go there."""
_PACKED = (b"PK", b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"7z\xbc\xaf", b"Rar!", b"\x28\xb5\x2f\xfd")
"""How files begin that hold others."""


def named(name: str) -> str:
    """The name of a file that is sent, if it may be one.

    Raises
    ------
    HTTPException
        Where it is none: a path, a device, markup, control characters, too long, no ``.csv``.
    """
    if len(name.encode("utf-8", "replace")) > _LONGEST_NAME or not _NAME.fullmatch(name):
        raise HTTPException(
            422,
            "this name cannot be taken: a campaign's name has letters, figures, spaces and "
            f". , + ( ) = - only, at most {_LONGEST_NAME} bytes, and ends with .csv; rename it",
        )
    if _DEVICE.match(name):
        raise HTTPException(
            422, "this name cannot be taken: Windows keeps it for a device; rename it"
        )
    return name


def require_bounded(headers: Mapping[str, str]) -> None:
    """Refuse by its head what is packed or too large.

    Raises
    ------
    HTTPException
        With one sentence.
    """
    if headers.get("content-encoding", "identity").strip().lower() != "identity":
        raise HTTPException(415, "campaigns are sent as they are, never packed")
    length = headers.get("content-length", "")
    if length.isdigit() and int(length) > LARGEST:
        raise _too_large()


async def received(sent: AsyncIterator[bytes], folder: Path, name: str) -> Path:
    """Keep what is sent as a file of its own; nothing is written over, and half a file never stays.

    Parameters
    ----------
    sent
        Its bytes as they come.
    folder
        Where.
    name
        From `named`; where another file has it, ``name-2.csv`` and so on. A file that is there
        with the same content is taken for it.

    Raises
    ------
    HTTPException
        For what is too large, packed, no text, or does not come in time.
    InputError
        Where it cannot be written.
    """
    part = folder / f".{secrets.token_hex(8)}.part"
    try:
        with _errors_of(folder), part.open("xb") as file:
            digest = await _written(sent, file)
        return _placed(part, folder, name, digest)
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


async def _written(sent: AsyncIterator[bytes], file: BinaryIO) -> str:
    """Write what comes; its SHA-256."""
    text = codecs.getincrementaldecoder("utf-8")()
    digest, length = hashlib.sha256(), 0
    try:
        async with asyncio.timeout(WITHIN):
            while True:
                async with asyncio.timeout(PAUSE):
                    piece = await anext(sent, None)
                if piece is None:
                    break
                length += len(piece)
                if length > LARGEST:
                    raise _too_large()
                if length == len(piece) and piece.startswith(_PACKED):
                    raise HTTPException(415, "this is packed: send the campaign itself, a CSV file")
                if b"\0" in piece:
                    raise HTTPException(415, "this is no text: a campaign is a CSV file")
                text.decode(piece)
                digest.update(piece)
                file.write(piece)
            text.decode(b"", final=True)
    except TimeoutError:
        raise HTTPException(408, "the file did not come in time") from None
    except UnicodeDecodeError:
        raise HTTPException(415, "this is no text: a campaign is a CSV file in UTF-8") from None
    if not length:
        raise HTTPException(422, "the file is empty")
    file.flush()
    os.fsync(file.fileno())
    return digest.hexdigest()


def _placed(part: Path, folder: Path, name: str, digest: str) -> Path:
    """Its name; nothing is written over."""
    stem = name[: -len(".csv")]
    for number in range(1, 1000):
        path = folder / (name if number == 1 else f"{stem}-{number}.csv")
        with _errors_of(folder):
            try:
                os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            except FileExistsError:
                if path.is_file() and _digest(path) == digest:
                    return path
                continue
            part.replace(path)
        return path
    raise InputError("too many files have this name", file=folder, found=name)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextlib.contextmanager
def _errors_of(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", file=folder) from None


def _too_large() -> HTTPException:
    return HTTPException(
        413,
        f"larger than {LARGEST // 1_000_000} MB: name it where the workbench is started, "
        "abbe open MODEL.toml CAMPAIGN.csv",
        # what still comes is not read
        {"connection": "close"},
    )
