"""The head beside the journal of uploads: how many lines it has, and the last one's SHA-256."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.files.text.json_source import read_json, shaped

FORMAT = "abbe-uploads-head/1"


class _Shape(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    format: Literal["abbe-uploads-head/1"]
    lines: Annotated[int, Field(ge=1)]
    last: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


@dataclass(frozen=True)
class UploadLogHead:
    """The least that a journal must hold.

    Attributes
    ----------
    lines
        Whole lines.
    last
        SHA-256 of the last of them.
    """

    lines: int
    last: str


def path_of(journal: Path) -> Path:
    """Where the head of a journal is."""
    return journal.with_name(journal.name + ".head")


def read_head(journal: Path) -> UploadLogHead | None:
    """The head of a journal; None where there is none.

    Raises
    ------
    InputError
        When it cannot be read, or is something else.
    """
    path = path_of(journal)
    if not path.exists():
        return None
    found = shaped(read_json(path), _Shape, path)
    return UploadLogHead(found.lines, found.last)


def write_head(journal: Path, head: UploadLogHead) -> None:
    """Write it, whole or not at all.

    Raises
    ------
    InputError
        When it cannot be written.
    """
    reported = {"format": FORMAT, "lines": head.lines, "last": head.last}
    write_atomically(path_of(journal), json.dumps(reported) + "\n")
