"""The target of a write: the file, device or open descriptor that a path leads to."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import InputError

STANDARD_OUTPUT = "-"
"""A path that means standard output."""
_MOST_LINKS = 40
"""Symbolic links that are followed, as many as the system follows."""


@dataclass(frozen=True)
class WriteTarget:
    """The file, device or open descriptor that a path leads to.

    Attributes
    ----------
    path
        The file itself, symbolic links followed.
    descriptor
        The descriptor of this process that the path names (``-``, ``/dev/stdout``,
        ``/dev/fd/3``); None: it names none.
    status
        What is there now; None: nothing.
    """

    path: Path
    descriptor: int | None = None
    status: os.stat_result | None = None

    @classmethod
    def of(cls, path: str | Path) -> WriteTarget:
        """Follow a path.

        Raises
        ------
        InputError
            When links go in a circle, or the folder cannot be entered.
        """
        text = os.fspath(path)
        if text == STANDARD_OUTPUT:
            return cls(Path(text), 1, _status_of(1))
        try:
            return cls._followed(Path(text))
        except OSError as error:
            raise InputError(f"cannot be written: {error.strerror}", file=path) from None
        except RuntimeError:
            raise InputError("cannot be written: links go in a circle", file=path) from None
        except ValueError:
            raise InputError("not the name of a file", file=path, found=text) from None

    @classmethod
    def _followed(cls, path: Path) -> WriteTarget:
        own = Path(f"/proc/{os.getpid()}/fd")
        for _ in range(_MOST_LINKS):
            path = path.parent.resolve() / path.name
            if path.parent == own and path.name.isdigit():
                return cls(path, int(path.name), _status_of(int(path.name)))
            if not path.is_symlink():
                break
            path = path.parent / path.readlink()
        try:
            return cls(path, None, path.stat())
        except FileNotFoundError:
            return cls(path)

    @property
    def regular(self) -> bool:
        """Whether an ordinary file is there."""
        return self.status is not None and stat.S_ISREG(self.status.st_mode)

    @property
    def replaced(self) -> bool:
        """Whether writing puts a new file in its place; else what is there is written to."""
        return self.descriptor is None and (self.status is None or self.regular)

    @property
    def identity(self) -> tuple[object, ...] | None:
        """Equal for two paths to one ordinary file, however they are spelt; None for a stream."""
        if self.status is not None:
            return (self.status.st_dev, self.status.st_ino) if self.regular else None
        try:
            folder = self.path.parent.stat()
        except OSError:
            return (str(self.path),)
        return folder.st_dev, folder.st_ino, self.path.name

    def require_writable(self, path: str | Path) -> None:
        """Refuse what must not be written; `path` is how the user named it.

        Raises
        ------
        InputError
            For a folder, a disk, a file that is write-protected, a folder that does not exist.
        """
        if self.status is None:
            if self.descriptor is None and not self.path.parent.is_dir():
                raise InputError(
                    "cannot be written: No such file or directory",
                    file=path,
                    found=str(self.path.parent),
                    expected="a folder that exists (mkdir -p makes it)",
                )
            return
        mode = self.status.st_mode
        if stat.S_ISDIR(mode):
            raise InputError(
                "cannot be written: Is a directory", file=path, expected="the name of a file"
            )
        if stat.S_ISBLK(mode):
            raise InputError(
                "cannot be written: it is a disk", file=path, expected="the name of a file"
            )
        # the folder's permission would be enough to replace it: the owner said otherwise
        protected = not mode & 0o222 or not os.access(self.path, os.W_OK)
        if self.replaced and protected:
            raise InputError(
                "cannot be written: it is write-protected",
                file=path,
                expected="another name, or a file that may be written (chmod u+w)",
            )


def _status_of(descriptor: int) -> os.stat_result | None:
    try:
        return os.fstat(descriptor)
    except OSError:
        return None
