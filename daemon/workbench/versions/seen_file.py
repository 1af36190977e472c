"""A file as it was when it was read, and whether what lies on the disk now is another one."""

from __future__ import annotations

import hashlib
from pathlib import Path

_Stamp = tuple[int, int, int, int]


class SeenFile:
    """A file that is about to be read; may be asked from any thread.

    Parameters
    ----------
    path
        The file.

    Attributes
    ----------
    path, sha256
        The file, and its SHA-256 as it was; empty where it was not there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        # in this order: what is written in between is seen as another file
        self._stamp = _stamp(path)
        self.sha256 = _sha256(path)
        self._known = (self._stamp, False)

    @property
    def differs(self) -> bool:
        """Whether it is not there any more, or another one than was read."""
        now = _stamp(self.path)
        if self._known[0] != now:
            self._known = (now, _sha256(self.path) != self.sha256)
        return self._known[1]


def _stamp(path: Path) -> _Stamp | None:
    try:
        about = path.stat()
    except OSError:
        return None
    return about.st_ino, about.st_size, about.st_mtime_ns, about.st_ctime_ns


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""
