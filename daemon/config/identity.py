"""Identity of a run: Abbe's version, model and configuration with their SHA-256."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

from abbe.compcore.effects.catalogue.error_grid import ErrorGrid
from abbe.daemon.config import Configuration
from abbe.daemon.installed import abbe_version

_SHOWN = 12
"""Digits of a SHA-256 that people are shown."""


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, hexadecimal; empty where it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""


@dataclass(frozen=True)
class RunIdentity:
    """The version and the files of a run.

    Attributes
    ----------
    version
        Of Abbe.
    files
        Path and SHA-256 (hexadecimal) of the configuration, the model and the model's grids.
    """

    version: str
    files: tuple[tuple[Path, str], ...]
    _seen: tuple[tuple[int, int], ...] = field(default=(), compare=False, repr=False)

    @classmethod
    def of(cls, configuration: Configuration) -> RunIdentity:
        """By the files as they are now."""
        model = configuration.model_path
        grids = {
            model.parent / term.effect.file
            for term in configuration.model.terms
            if isinstance(term.effect, ErrorGrid)
        }
        paths = (configuration.path, model, *sorted(grids))
        seen = tuple(_stamp(path) for path in paths)
        return cls(abbe_version(), tuple((path, sha256_of(path)) for path in paths), seen)

    def words(self) -> str:
        """In one line, for people.

        ``Abbe 0.1.0, config.toml (SHA-256 1f0c…), model.toml (SHA-256 77ab…)``.
        """
        files = (f"{path.name} (SHA-256 {digest[:_SHOWN]})" for path, digest in self.files)
        return ", ".join((f"Abbe {self.version}", *files))

    def changed(self) -> tuple[Path, ...]:
        """Files that are no longer what they were; asks for contents only where times differ."""
        return tuple(
            path
            for (path, digest), seen in zip(self.files, self._seen, strict=True)
            if _stamp(path) != seen and sha256_of(path) != digest
        )


def _stamp(path: Path) -> tuple[int, int]:
    try:
        found = path.stat()
    except OSError:
        return 0, 0
    return found.st_mtime_ns, found.st_size
