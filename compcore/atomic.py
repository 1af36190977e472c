"""Writing a file whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from compcore.errors import InputError


def write_atomically(path: str | Path, content: str | bytes | Iterable[str]) -> None:
    """Write a file so that a reader, or a power cut, sees the old or the new content, never a part.

    Text is written as UTF-8 with the line ends that it holds; long text may come in pieces. The
    mode of an existing file is kept.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written.
    """
    target = Path(path)
    pieces = (content,) if isinstance(content, str | bytes) else content
    try:
        mode = target.stat().st_mode & 0o777 if target.exists() else 0o644
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", file=path) from None
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            for piece in pieces:
                stream.write(piece.encode("utf-8") if isinstance(piece, str) else piece)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.chmod(mode)
        temporary.replace(target)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise InputError(f"cannot be written: {error.strerror}", file=path) from None
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
