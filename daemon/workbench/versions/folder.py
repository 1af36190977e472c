"""The versions of a model as files in one folder: never one over another, each whole."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.model_file import load_model
from abbe.compcore.model.model import Model
from abbe.daemon.report.model.history import versions_of
from abbe.daemon.workbench.versions.seen_file import SeenFile

_MOST = 200
"""Versions that are read from a folder, the newest."""
_LAST = 9999


@dataclass(frozen=True, eq=False)
class ModelVersion:
    """A version of the model.

    Attributes
    ----------
    path
        Its file.
    model
        What stands in it.
    seen
        The file as it was read or written.
    given
        Whether it is the file that the workbench was opened with.
    """

    path: Path
    model: Model
    seen: SeenFile
    given: bool = False

    @classmethod
    def read(cls, path: Path, *, given: bool = False) -> ModelVersion:
        """The version in a file; raises as `load_model`."""
        seen = SeenFile(path)
        return cls(path, load_model(path), seen, given)

    @property
    def record(self) -> Mapping[str, Any] | None:
        """Its record, as ``abbe history`` has it; None where it was never fitted."""
        return versions_of(self.model)[-1] if self.model.fit else None


class VersionFolder:
    """Where versions are kept.

    Parameters
    ----------
    folder
        Is made where it is missing; None: nothing is kept.
    model
        The model that the workbench was opened with: its name begins theirs.

    Raises
    ------
    InputError
        For a folder that cannot be.
    """

    def __init__(self, folder: Path | None, model: Path) -> None:
        self.folder = folder
        self._stem = re.sub(r"-[0-9]{1,4}\Z", "", model.stem)
        self._reserved: Path | None = None
        if folder is not None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(
                    f"no folder for versions: {error.strerror}", file=folder, field="--versions"
                ) from None

    def earlier(self, given: Model) -> Iterator[ModelVersion]:
        """Versions of the same machine that an earlier session left there, oldest first."""
        if self.folder is None:
            return
        numbered = []
        for path in self.folder.glob("*.toml"):
            found = re.fullmatch(rf"{re.escape(self._stem)}-([0-9]{{1,4}})", path.stem)
            if found:
                numbered.append((int(found[1]), path))
        for _, path in sorted(numbered)[-_MOST:]:
            # what is no model, or another machine's, is somebody else's file
            with contextlib.suppress(AbbeError):
                version = ModelVersion.read(path)
                if version.model.machine == given.machine:
                    yield version

    @contextlib.contextmanager
    def next_file(self) -> Iterator[Path]:
        """A new file's name, taken at once so that nobody else takes it; empty until written.

        Where nothing was written it is gone afterwards.

        Raises
        ------
        InputError
            Where no folder was stated, or it takes no file.
        """
        if self.folder is None:
            raise InputError(
                "no folder for versions was stated, so nothing is written",
                expected="abbe open … --versions FOLDER",
            )
        self._reserved = path = self._reserve(self.folder)
        try:
            yield path
        finally:
            self.release()

    def release(self) -> None:
        """Give a name back that was taken and not used."""
        path, self._reserved = self._reserved, None
        if path is not None:
            with contextlib.suppress(OSError):
                if not path.stat().st_size:
                    path.unlink()

    def _reserve(self, folder: Path) -> Path:
        for number in range(2, _LAST):
            path = folder / f"{self._stem}-{number}.toml"
            try:
                os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            except FileExistsError:
                continue
            except OSError as error:
                raise InputError(
                    f"cannot be written: {error.strerror}", file=path, field="--versions"
                ) from None
            return path
        raise InputError("holds too many versions", file=folder, expected="another folder")
