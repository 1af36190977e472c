"""A machine's models and campaigns taken out of the store, as files in a folder."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from abbe.compcore.errors import AbbeError
from abbe.compcore.files.text.atomic import write_atomically
from abbe.daemon.fleet.asked.reading import FleetFile, FleetMachine, FleetStore
from abbe.daemon.fleet.uploading.machine_files import sha256_of


@dataclass(frozen=True, slots=True)
class TakenOut:
    """Files of a machine.

    Attributes
    ----------
    model
        The one that runs, or the newest; None: there is none.
    models
        All others, oldest first.
    campaigns
        Oldest first.
    checks
        Its check measurements; None: there are none.
    """

    model: Path | None
    models: Sequence[Path]
    campaigns: Sequence[Path]
    checks: Path | None


def take_out(store: FleetStore, machine: FleetMachine, folder: Path) -> TakenOut:
    """Write a machine's files into a folder, each checked against its SHA-256.

    Parameters
    ----------
    store, machine
        Who is asked, of which machine.
    folder
        Empty; is made where it is missing.

    Raises
    ------
    AbbeError
        For a content that is not what was uploaded.
    InputError
        When a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    taken: set[str] = set()
    models = store.models(machine)
    running = next((f for f in models if f.sha256 == machine.model), models[-1] if models else None)
    first: Path | None = None
    others: list[Path] = []
    for file in models:
        path = _write(folder, file, store.model_content(machine, file.sha256), taken)
        if file is running:
            first = path
        else:
            others.append(path)
    campaigns = [
        _write(folder, file, store.campaign_content(machine, file.sha256), taken)
        for file in store.campaigns(machine)
    ]
    head, readings = store.checks(machine)
    checks = None
    if readings:
        checks = folder / _free("checks.csv", "", taken)
        write_atomically(checks, _checks_text(head, readings))
    return TakenOut(first, others, campaigns, checks)


def _write(folder: Path, file: FleetFile, content: bytes, taken: set[str]) -> Path:
    if sha256_of(content) != file.sha256:
        raise AbbeError(f"{file.path} in the store is not what was uploaded (its SHA-256 differs)")
    path = folder / _free(PurePosixPath(file.path).name, file.sha256, taken)
    write_atomically(path, content)
    if file.at is not None:
        # a campaign that does not say when it was measured is as old as its file
        os.utime(path, (file.at.timestamp(), file.at.timestamp()))
    return path


def _free(name: str, sha256: str, taken: set[str]) -> str:
    """A file's own name; with its digest where another one has it already."""
    plain = re.sub(r"[^\w.+-]", "-", name).lstrip(".-") or "file"
    if plain in taken:
        stem, dot, ending = plain.rpartition(".")
        plain = f"{stem or plain}-{sha256[:8]}{dot}{ending if stem else ''}"
    taken.add(plain)
    return plain


def _checks_text(head: str, readings: Sequence[dict[str, str]]) -> str:
    import csv
    from io import StringIO

    columns = list(dict.fromkeys(key for reading in readings for key in reading))
    text = StringIO()
    text.write(head)
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(readings)
    return text.getvalue()
