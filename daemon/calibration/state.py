"""The state of a calibration: which steps are done, and from which files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from abbe.compcore.errors import InputError
from abbe.compcore.files.formats import CALIBRATION
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.files.text.bounded_text import read_bounded

STATE_NAME = "calibration.json"
_MOST_BYTES = 1_000_000


class StepRecord(BaseModel):
    """A step that was done: when, the SHA-256 of what it was made from, and how."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    at: str
    made_from: dict[str, str]
    settings: dict[str, str] = {}
    note: Annotated[str, Field(max_length=1000)] = ""


class _StateDocument(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["abbe-calibration/1"]
    configuration: str
    steps: dict[str, StepRecord]


@dataclass
class CalibrationState:
    """The steps that are done in a folder.

    Attributes
    ----------
    folder
        Where all of it is.
    configuration
        The machine's configuration.
    steps
        Step → its record.
    """

    folder: Path
    configuration: Path
    steps: dict[str, StepRecord] = field(default_factory=dict)

    @classmethod
    def read(cls, folder: Path, configuration: Path) -> CalibrationState:
        """The state of a folder; a new one where nothing was begun.

        Raises
        ------
        InputError
            For a file that is none, and a folder of another configuration.
        """
        path = folder / STATE_NAME
        if not path.exists():
            return cls(folder, configuration)
        text = read_bounded(path, _MOST_BYTES, expected="the state of a calibration")
        try:
            found = _StateDocument.model_validate_json(text)
        except ValidationError:
            raise InputError(
                "is not the state of a calibration", file=path, expected="another --folder"
            ) from None
        if Path(found.configuration) != configuration.resolve():
            raise InputError(
                "is the calibration of another configuration",
                file=path,
                found=found.configuration,
                expected=f"{configuration.resolve()}, or another --folder",
            )
        return cls(folder, configuration, dict(found.steps))

    def done(
        self,
        step: str,
        made_from: Iterable[Path],
        makes: Iterable[Path],
        settings: Mapping[str, str] | None = None,
    ) -> bool:
        """Whether a step was done so, from these files as they are, and what it made is there."""
        record = self.steps.get(step)
        return (
            record is not None
            and all(path.exists() for path in makes)
            and record.settings == dict(settings or {})
            and record.made_from == _digests(made_from)
        )

    def note(
        self,
        step: str,
        made_from: Iterable[Path],
        note: str = "",
        settings: Mapping[str, str] | None = None,
    ) -> None:
        """Record that a step is done.

        Raises
        ------
        InputError
            When it cannot be written.
        """
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self.steps[step] = StepRecord(
            at=now, made_from=_digests(made_from), note=note, settings=dict(settings or {})
        )
        document: Mapping[str, object] = {
            "format": CALIBRATION,
            "configuration": str(self.configuration.resolve()),
            "steps": {name: record.model_dump() for name, record in self.steps.items()},
        }
        text = json.dumps(document, ensure_ascii=False, indent=1)
        write_atomically(self.folder / STATE_NAME, text + "\n")


def _digests(paths: Iterable[Path]) -> dict[str, str]:
    return {str(p.name): hashlib.sha256(p.read_bytes()).hexdigest() for p in paths if p.exists()}
