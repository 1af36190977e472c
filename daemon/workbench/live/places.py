"""Where a run's stream and records are, by its configuration; the run has read it before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.daemon.config.folders import data_folder
from abbe.daemon.config.sections.config_file import RecordsSection
from abbe.daemon.config.sections.http import HttpSection
from abbe.daemon.status.run_status import RunStatus


def file_of(status: RunStatus, role: str) -> Path | None:
    """The run's file of that role."""
    return next((Path(f.path) for f in status.files if f.role == role), None)


def stream_of(config: Path) -> Path | None:
    """The Unix socket at which a run streams its cycles; None where it does not."""
    section = _section(config, "http")
    if section is None:
        return None
    name = section.get("socket", HttpSection().socket)
    return data_folder(config).absolute() / name if isinstance(name, str) else None


def records_of(config: Path) -> Path | None:
    """The database of a run's records; None where it keeps none.

    Raises
    ------
    InputError
        For a configuration that is not in order.
    """
    section = _section(config, "records")
    if section is None:
        return None
    try:
        records = RecordsSection.model_validate(section)
    except ValidationError as error:
        raise TomlSource.read(config).invalid(error, ("records",)) from None
    return data_folder(config).absolute() / records.file


def _section(config: Path, name: str) -> dict[str, Any] | None:
    try:
        found = TomlSource.read(config).data.get(name)
    except InputError:
        return None
    return found if isinstance(found, dict) else None
