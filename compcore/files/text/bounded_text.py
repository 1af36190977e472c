"""Reading a text file that anybody may have written: whole, but not more than is believable."""

from __future__ import annotations

from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.encodings import decoded
from abbe.compcore.sentences import said


def read_bounded(
    path: str | Path, most: int, *, expected: str | None = None, foreign: bool = False
) -> str:
    """A file's text, UTF-8 with or without a byte order mark, with the line ends that it holds.

    Parameters
    ----------
    path
        The file; a pipe is read as one.
    most
        Bytes that it may hold.
    expected
        What should have stood there, for the message about a file that is longer.
    foreign
        Whether another program may have written it: in UTF-16, GBK or Windows-1252 too.

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
        raise InputError(said("cannot be read: {why}", why=error.strerror), file=path) from None
    except ValueError:
        raise InputError("not the name of a file", file=path) from None
    if len(data) > most:
        raise InputError(
            said("too large: more than {size} MB", size=f"{most / 1e6:g}"),
            file=path,
            expected=expected or "a text file",
        )
    try:
        return decoded(data) if foreign else data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(
            said("not UTF-8 text (byte {number})", number=error.start),
            file=path,
            line=line,
            expected="a file saved as UTF-8 (in an editor: Save as, encoding UTF-8)",
        ) from None
