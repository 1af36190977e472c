"""Backups of what was active before an upload: folders named by time and SHA-256, kept."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from abbe.compcore.errors import InputError
from abbe.compcore.files.table_set import TableSet
from abbe.compcore.files.text.atomic import sync_folder
from abbe.daemon.upload.history.content import Content

NOTHING = "no-table.json"
"""The file of a backup of a controller without tables."""


def save(
    folder: Path, content: Content, controller: str, options: Mapping[str, Any],
    record: Mapping[str, Any],
) -> Path:  # fmt: skip
    """Write a backup; it appears whole or not at all, and none is ever overwritten.

    Parameters
    ----------
    folder
        Where backups are.
    content
        The files.
    controller, options
        Their dialect.
    record
        What else to keep: which controller, when, by whom.

    Returns
    -------
    The backup's own folder, which `load` reads.

    Raises
    ------
    InputError
        When it cannot be written.
    """
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    name = f"{stamp}-{content.sha256[:12] or 'none'}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=folder, prefix=".new-"))
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", file=folder) from None
    try:
        if content.files:
            TableSet(controller, dict(options), content.files, dict(record)).write(temporary)
        else:
            (temporary / NOTHING).write_text(json.dumps(dict(record)) + "\n", encoding="utf-8")
        temporary.chmod(0o755)
        sync_folder(temporary)
        target = _free(folder, name)
        # a folder is never renamed over one that has something in it
        temporary.rename(target)
        sync_folder(folder)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", file=folder) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    if not content.same(load(target).files or {}):
        raise InputError("the backup does not read back as it was written", file=target)
    return target


def _free(folder: Path, name: str) -> Path:
    target, number = folder / name, 2
    while target.exists():
        target, number = folder / f"{name}-{number}", number + 1
    return target


def load(folder: Path) -> Content:
    """A backup's files, their checksums verified.

    Raises
    ------
    InputError
        When it is missing or was changed.
    """
    if (folder / NOTHING).exists():
        return Content.of({})
    return Content.of(TableSet.load(folder).files)
