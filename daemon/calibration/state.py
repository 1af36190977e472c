"""The state of a calibration: which steps are done, and from which files."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
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
_MOST_OUTCOME = 2000


class StepRecord(BaseModel):
    """A step that was done: when, the SHA-256 of what it was made from, how, and what came out."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    at: str
    made_from: dict[str, str]
    settings: dict[str, str] = {}
    note: Annotated[str, Field(max_length=1000)] = ""
    outcome: Annotated[str, Field(max_length=_MOST_OUTCOME)] = ""


def at_the_wall(at: str) -> str:
    """A step's time as the clock at the wall shows it, to the minute.

    >>> at_the_wall("somebody wrote here")
    'somebody wrote here'
    """
    try:
        return f"{datetime.fromisoformat(at).astimezone():%Y-%m-%d %H:%M}"
    except (ValueError, OverflowError, OSError):
        return at


class _StateDocument(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["abbe-calibration/1"]
    configuration: str
    steps: dict[str, StepRecord]
    asked: dict[str, Annotated[str, Field(max_length=1000)]] = {}
    begun: bool = False


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
    asked
        What the page *Calibrate* of the workbench was asked for: time, tools, … as text.
    begun
        Whether a step was begun: what lies in the folder since then is the calibration's.
    """

    folder: Path
    configuration: Path
    steps: dict[str, StepRecord] = field(default_factory=dict)
    asked: dict[str, str] = field(default_factory=dict)
    begun: bool = False

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
        begun = found.begun or bool(found.steps)
        return cls(folder, configuration, dict(found.steps), dict(found.asked), begun)

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

    def outcome(self, step: str) -> str:
        """What came out of a step that was done; empty where it was not, or says nothing."""
        record = self.steps.get(step)
        return "" if record is None else record.outcome

    def note(
        self,
        step: str,
        made_from: Iterable[Path],
        note: str = "",
        settings: Mapping[str, str] | None = None,
        outcome: str = "",
    ) -> None:
        """Record that a step is done.

        Raises
        ------
        InputError
            When it cannot be written.
        """
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self.steps[step] = StepRecord(
            at=now, made_from=_digests(made_from), note=note, settings=dict(settings or {}),
            outcome=outcome[:_MOST_OUTCOME],
        )  # fmt: skip
        self._write()

    def begin(self, makes: Iterable[Path]) -> None:
        """Record that this calibration writes into the folder from now on.

        Parameters
        ----------
        makes
            All files that it will write.

        Raises
        ------
        InputError
            Where one of them is there although nothing was begun, and when it cannot be written.
        """
        if self.begun:
            return
        for path in makes:
            if os.path.lexists(path):
                raise InputError(
                    "is there already, and this calibration did not make it", file=path,
                    expected="another --folder, or the file elsewhere",
                )  # fmt: skip
        self.begun = True
        self._write()

    def ask_for(self, asked: Mapping[str, str]) -> None:
        """Keep what is asked for; raises `InputError` when it cannot be written."""
        self.asked = dict(asked)
        self._write()

    def _write(self) -> None:
        document: Mapping[str, object] = {
            "format": CALIBRATION,
            "configuration": str(self.configuration.resolve()),
            "steps": {name: record.model_dump() for name, record in self.steps.items()},
            **({"asked": self.asked} if self.asked else {}),
            **({"begun": True} if self.begun and not self.steps else {}),
        }
        text = json.dumps(document, ensure_ascii=False, indent=1)
        write_atomically(self.folder / STATE_NAME, text + "\n")


def make_folder(folder: Path) -> None:
    """Make the folder of a calibration.

    Raises
    ------
    InputError
        Where it cannot be.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror}", file=folder) from None


@contextlib.contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """While it lasts nobody else does a step of the same calibration.

    Raises
    ------
    InputError
        Where somebody does.
    """
    opened = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                "a step of this calibration is under way elsewhere", file=folder,
                expected="its end; then the same goes on here",
            ) from None  # fmt: skip
        yield
    finally:
        os.close(opened)


def _digests(paths: Iterable[Path]) -> dict[str, str]:
    return {str(p.name): hashlib.sha256(p.read_bytes()).hexdigest() for p in paths if p.exists()}
