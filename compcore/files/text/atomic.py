"""Writing a file whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO, cast

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.write_target import WriteTarget
from abbe.compcore.sentences import said

_LONGEST_NAME = 200
"""Bytes of a file's name that go into the name of its temporary file."""


def write_atomically(path: str | Path, content: str | bytes | Iterable[str]) -> None:
    """Write a file so that a reader, or a power cut, sees the old or the new content, never a part.

    Text is written as UTF-8 with the line ends that it holds; long text may come in pieces. A
    symbolic link stays one: what it leads to is replaced. A new file gets the mode that the umask
    allows; that of an existing one is kept, and its owner where the system lets us. A device, a
    pipe or an open descriptor (``-`` and ``/dev/stdout`` are standard output) is not replaced but
    written to, and only when the content is whole.

    Raises
    ------
    InputError
        When it cannot be written; it is then what it was.
    """
    write_together({Path(path): content})


def write_together(contents: Mapping[Path, str | bytes | Iterable[str]]) -> None:
    """Write several files as `write_atomically` does: all of them are whole before one is in place.

    Raises
    ------
    InputError
        When one cannot be written; all are then what they were.
    """
    ready: dict[Path, tuple[Path, Path]] = {}
    streams = []
    try:
        for path, content in contents.items():
            target = WriteTarget.of(path)
            target.require_writable(path)
            pieces = (content,) if isinstance(content, str | bytes) else content
            if not target.replaced:
                streams.append((path, target, pieces))
                continue
            with _errors_named(path):
                ready[path] = (_prepared(target, pieces), target.path)
        for path, target, pieces in streams:
            with _errors_named(path):
                _write_through(target, pieces)
        for path, (temporary, final) in ready.items():
            with _errors_named(path):
                temporary.replace(final)
    except BaseException:
        for temporary, _ in ready.values():
            temporary.unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def _errors_named(path: Path) -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise InputError(said("cannot be written: {why}", why=error.strerror), file=path) from None


def encoded(text: str) -> bytes:
    r"""UTF-8; what is left of a file name that is none becomes the sign for the unknown.

    >>> encoded("µm \udcff").decode()
    'µm �'
    """
    try:
        return text.encode("utf-8")
    except UnicodeEncodeError:
        raw = text.encode("utf-8", "surrogateescape")
        return raw.decode("utf-8", "replace").encode("utf-8")


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk; raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _prepared(target: WriteTarget, pieces: Iterable[str | bytes]) -> Path:
    """The content in a file beside the target, on the disk, with the target's rights."""
    start = os.fsdecode(os.fsencode(target.path.name)[:_LONGEST_NAME])
    temporary = target.path.with_name(f".{start}.{secrets.token_hex(4)}")
    # made with all rights: the system takes off what the umask or the folder's defaults forbid
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    try:
        with os.fdopen(handle, "wb") as stream:
            if target.status is not None:
                with contextlib.suppress(PermissionError):
                    os.fchown(handle, target.status.st_uid, target.status.st_gid)
                os.fchmod(handle, target.status.st_mode & 0o777)
            _pour(pieces, stream)
            stream.flush()
            os.fsync(handle)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return temporary


def _write_through(target: WriteTarget, pieces: Iterable[str | bytes]) -> None:
    with tempfile.TemporaryFile() as whole:
        _pour(pieces, cast(BinaryIO, whole))
        whole.seek(0)
        if target.descriptor == 1:
            if sys.stdout is None:
                raise OSError(errno.EBADF, "it is closed")
            sys.stdout.flush()
            if hasattr(sys.stdout, "buffer"):
                shutil.copyfileobj(whole, sys.stdout.buffer)
            else:
                sys.stdout.write(whole.read().decode("utf-8"))
            sys.stdout.flush()
            return
        handle = (
            os.open(target.path, os.O_WRONLY | os.O_CLOEXEC | os.O_NOCTTY)
            if target.descriptor is None
            else os.dup(target.descriptor)
        )
        with os.fdopen(handle, "wb") as stream:
            shutil.copyfileobj(whole, stream)


def _pour(pieces: Iterable[str | bytes], stream: BinaryIO) -> None:
    for piece in pieces:
        stream.write(encoded(piece) if isinstance(piece, str) else piece)
