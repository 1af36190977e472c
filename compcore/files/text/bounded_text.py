"""Reading a text file that anybody may have written: whole, but not more than is believable."""

from __future__ import annotations

from pathlib import Path

from abbe.compcore.errors import InputError


def read_bounded(path: str | Path, most: int, *, expected: str | None = None) -> str:
    """A file's text, UTF-8 with or without a byte order mark, with the line ends that it holds.

    Parameters
    ----------
    path
        The file; a pipe is read as one.
    most
        Bytes that it may hold.
    expected
        What should have stood there, for the message about a file that is longer.

    Raises
    ------
    InputError
        When it cannot be read, is longer, or is not UTF-8.
    """
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(most + 1)
    except FileNotFoundError:
        raise InputError("no such file", file=path) from None
    except IsADirectoryError:
        raise InputError("is a folder, not a file", file=path) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from None
    except ValueError:
        raise InputError("not the name of a file", file=path) from None
    if len(data) > most:
        raise InputError(
            f"too large: more than {most / 1e6:g} MB", file=path, expected=expected or "a text file"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"not UTF-8 text (byte {error.start})", file=path, line=line) from None
