"""Sets of files in folders, one of which is current: switched whole, safe against power cuts.

::

    comp/                    the root
      sets/1f3a…/            one folder for each set, named by the SHA-256 of its list
        set.sha256           the set's files, as sha256sum writes and checks them
        x.comp …
      current -> sets/1f3a…  what acts; the only thing that is ever switched
      next -> sets/77b0…     what was written last (the staging area)
      switched.json          when; written after the switch

A set is complete, and forced to the disk, before anything points to it; a symbolic link is
replaced by renaming a new one over it, which file systems do as a whole. Power may be cut between
any two operations: what `current` leads to is an old set or a new one, never parts of both.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from abbe.compcore.files.text.atomic import sync_folder

LIST = "set.sha256"
_SETS, _CURRENT, _NEXT, _SWITCHED = "sets", "current", "next", "switched.json"
_UNFINISHED = ".unfinished"


class SetFolders:
    """The folders of one root.

    Parameters
    ----------
    root
        The folder that holds all of it; made when the first set is written.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    @property
    def current(self) -> Path:
        """The link that what reads the files goes through."""
        return self.root / _CURRENT

    def check(self) -> None:
        """See whether the current set can be switched at all.

        Raises
        ------
        ValueError
            When something else is where the link belongs; says what to do.
        """
        if self.current.exists() and not self.current.is_symlink():
            raise ValueError(
                f"{self.current} is a folder of its own and cannot be switched at one stroke. "
                f"Once, while nothing reads it: cd {self.root} && mv current mine && "
                "ln -s mine current"
            )

    def read_current(self, names: tuple[str, ...]) -> dict[str, str]:
        """The current set: name → text; empty when there is none.

        Parameters
        ----------
        names
            Files that are read where the folder has no list of its own (one made by hand).

        Raises
        ------
        ValueError
            When the folder is not what its list says.
        OSError
            When it cannot be read.
        """
        if not self.current.exists():
            return {}
        if (self.current / LIST).exists():
            return self._read(self.current.resolve())
        return {n: _text(self.current / n) for n in names if (self.current / n).exists()}

    def read_next(self) -> dict[str, str] | None:
        """The set written last: name → text; None when there is none, or it is not whole."""
        try:
            return self._read((self.root / _NEXT).resolve(strict=True))
        except (OSError, ValueError):
            return None

    def write_next(self, files: Mapping[str, str], fillers: Mapping[str, str]) -> None:
        """Write a set beside the current one, completely, and forced to the disk.

        Parameters
        ----------
        files
            The set's.
        fillers
            Files that have to exist beside them and do not belong to the set.

        Raises
        ------
        OSError
            When the disk is full, or the folder may not be written.
        """
        listing = _listing(files)
        name = hashlib.sha256(
            (listing + "".join(f"{n}\n{t}\n" for n, t in sorted(fillers.items()))).encode()
        ).hexdigest()
        sets = self.root / _SETS
        _make_folders(sets)
        folder = sets / name
        if not self._whole(folder, files, fillers):
            unfinished = sets / _UNFINISHED
            _remove(unfinished)
            unfinished.mkdir()
            for file, text in {**fillers, **files, LIST: listing}.items():
                _write(unfinished / file, text)
            sync_folder(unfinished)
            if folder.exists():
                # damaged; nothing whole is lost, and what is current is never removed
                self._refuse_current(folder)
                _remove(folder)
            unfinished.rename(folder)
            sync_folder(sets)
        self._point(_NEXT, f"{_SETS}/{name}")

    def is_own(self) -> bool:
        """Whether the current set was written here, not by hand."""
        return self.current.is_symlink() and self.current.readlink().parts[0] == _SETS

    def switch(self) -> None:
        """Make the set written last the current one: one rename.

        Raises
        ------
        OSError
            When there is none, or the folder may not be written.
        """
        self._point(_CURRENT, str((self.root / _NEXT).readlink()))

    def note(self, facts: Mapping[str, Any]) -> None:
        """Keep facts about the current set beside its name; see `switched`."""
        new = self.root / (_SWITCHED + ".new")
        _write(new, json.dumps({"set": str(self.current.readlink()), **facts}))
        new.replace(self.root / _SWITCHED)
        sync_folder(self.root)

    def switched(self) -> dict[str, Any] | None:
        """The facts that were kept about the current set; None when there are none."""
        try:
            facts: dict[str, Any] = json.loads(_text(self.root / _SWITCHED))
            return facts if facts["set"] == str(self.current.readlink()) else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def discard_next(self) -> None:
        """Remove the set written last, and everything else that is not current."""
        (self.root / _NEXT).unlink(missing_ok=True)
        sets = self.root / _SETS
        if not sets.is_dir():
            return
        kept = self.current.resolve()
        for folder in sets.iterdir():
            ours = len(folder.name) == 64 or folder.name == _UNFINISHED
            if ours and folder.resolve() != kept:
                _remove(folder)

    def _point(self, link: str, target: str) -> None:
        new = self.root / (link + ".new")
        new.unlink(missing_ok=True)
        new.symlink_to(target)
        new.replace(self.root / link)
        sync_folder(self.root)

    def _refuse_current(self, folder: Path) -> None:
        if self.current.resolve() == folder.resolve():
            raise OSError(
                f"{folder} is current and was damaged by somebody: make another set current first"
            )

    def _whole(self, folder: Path, files: Mapping[str, str], fillers: Mapping[str, str]) -> bool:
        try:
            return self._read(folder) == dict(files) and all(
                _text(folder / name) == text for name, text in fillers.items()
            )
        except (OSError, ValueError):
            return False

    @staticmethod
    def _read(folder: Path) -> dict[str, str]:
        listing = _text(folder / LIST)
        files = {}
        for line in listing.splitlines():
            stated, _, name = line.partition("  ")
            text = _text(folder / name)
            if hashlib.sha256(text.encode()).hexdigest() != stated:
                raise ValueError(f"{folder / name} is not the file that {LIST} lists")
            files[name] = text
        if _listing(files) != listing:
            raise ValueError(f"{folder / LIST} is damaged")
        return files


def _listing(files: Mapping[str, str]) -> str:
    return "".join(
        f"{hashlib.sha256(text.encode()).hexdigest()}  {name}\n"
        for name, text in sorted(files.items())
    )


def _text(path: Path) -> str:
    """A file's text with its line ends as they are."""
    return path.read_bytes().decode("utf-8")


def _write(path: Path, text: str) -> None:
    with path.open("wb") as stream:
        stream.write(text.encode())
        stream.flush()
        os.fsync(stream.fileno())


def _make_folders(folder: Path) -> None:
    missing = [f for f in (folder, *folder.parents) if not f.exists()]
    for one in reversed(missing):
        one.mkdir()
        sync_folder(one.parent)


def _remove(folder: Path) -> None:
    """Remove a folder of files; safe when it does not exist."""
    with contextlib.suppress(FileNotFoundError):
        for file in folder.iterdir():
            file.unlink()
        folder.rmdir()
