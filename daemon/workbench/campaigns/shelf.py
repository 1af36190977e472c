"""The campaigns that a person may choose from: those that were named, those of a folder."""

from __future__ import annotations

import contextlib
import hashlib
import shutil
import tempfile
import threading
from collections.abc import Collection, Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from abbe.compcore.errors import InputError

_MOST = 500
"""Files of the folders that are listed, the newest."""
_HEAD = 4096
"""Bytes in which a campaign says what it is."""


class CampaignShelf:
    """Which campaigns there are; only these can be chosen, by what stands for them.

    Parameters
    ----------
    named
        Files that the command line names.
    folder
        Where files that the browser sends are kept, and whose files can be chosen; None: those that
        it sends are kept until the end.
    near
        Folders whose campaigns can be chosen as well: where ``abbe measure`` writes them.
    """

    def __init__(
        self, named: Sequence[Path], folder: Path | None = None, near: Sequence[Path] = ()
    ) -> None:
        self._named = list(named)
        self._near = list(dict.fromkeys([*(path.parent for path in named), *near]))
        self._folder, self.lasting = folder, folder is not None
        self._lock = threading.Lock()
        self._new: set[Path] = set()

    @property
    def folder(self) -> Path:
        """Where what is sent is kept; made where it is missing.

        Raises
        ------
        InputError
            Where it cannot be made.
        """
        with self._lock:
            if self._folder is None:
                self._folder = Path(tempfile.mkdtemp(prefix="abbe-campaigns-"))
            try:
                self._folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(
                    f"no folder for campaigns: {error.strerror}", file=self._folder
                ) from None
            return self._folder

    def files(self) -> list[Path]:
        """All of them: those that were named first, then the newest of the folders."""
        known = {path.resolve() for path in self._named}
        found: list[tuple[float, Path]] = []
        own = [] if self._folder is None else [self._folder]
        for folder in [*own, *self._near]:
            for path in folder.glob("*.csv"):
                with contextlib.suppress(OSError):
                    new = path.is_file() and path.resolve() not in known
                    if new and (folder in own or _says_so(path)):
                        known.add(path.resolve())
                        found.append((path.stat().st_mtime, path))
        newest = [path for _, path in sorted(found, reverse=True)[:_MOST]]
        return [*self._named, *newest]

    def listed(self, fitted: Collection[Path], held: Collection[Path]) -> list[dict[str, Any]]:
        """Every file for the page; `use` is what it is to the model at present."""
        rows = []
        for path in self.files():
            try:
                about = path.stat()
            except OSError:
                continue
            rows.append(
                {
                    "id": _stands_for(path),
                    "name": path.name,
                    "bytes": about.st_size,
                    "at": datetime.fromtimestamp(about.st_mtime, UTC).isoformat(timespec="minutes"),
                    "use": "fitted" if path in fitted else "held" if path in held else "",
                }
            )
        return rows

    def of(self, wanted: Iterable[str]) -> list[Path]:
        """The files that some words stand for.

        Raises
        ------
        InputError
            For one that stands for none.
        """
        known = {_stands_for(path): path for path in self.files()}
        found = []
        for word in dict.fromkeys(wanted):
            if word not in known:
                raise InputError("no such campaign here", field="campaign", found=word)
            found.append(known[word])
        return found

    def took(self, path: Path) -> str:
        """A file that was sent stands in the folder now; what stands for it."""
        with self._lock:
            self._new.add(path)
        return _stands_for(path)

    def proven(self, paths: Iterable[Path]) -> None:
        """They could be read."""
        with self._lock:
            self._new.difference_update(paths)

    def refused(self, paths: Iterable[Path]) -> None:
        """They could not be read together: of those that were sent and never read, none stays."""
        with self._lock:
            for path in self._new.intersection(paths):
                path.unlink(missing_ok=True)
                self._new.discard(path)

    def close(self) -> None:
        """What was kept until the end goes."""
        if not self.lasting and self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)


def _says_so(path: Path) -> bool:
    """Whether a file says of itself that it is a campaign: others are somebody else's tables."""
    with path.open("rb") as file:
        return b"abbe-campaign/" in file.read(_HEAD)


def _stands_for(path: Path) -> str:
    """A word for a file that says nothing of where it lies."""
    return hashlib.sha256(str(path.absolute()).encode("utf-8", "surrogateescape")).hexdigest()[:16]
