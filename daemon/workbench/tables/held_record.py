"""What the page *Tables* needs of the record beside a set of tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from abbe.compcore.errors import InputError
from abbe.compcore.files.table_set import RECORD_NAME, TableSet
from abbe.compcore.files.text.json_source import shaped
from abbe.daemon.answers.tables.make import NONE

_Finite = Annotated[float, Field(allow_inf_nan=False)]


class _HeldSection(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True)


class _LeftRecord(_HeldSection):
    max: _Finite
    p95: _Finite
    rms: _Finite
    worst: dict[str, _Finite]


class _HeldTable(_HeldSection):
    table: str
    points: list[int]
    start: Annotated[list[_Finite], Field(alias="from")]
    to: list[_Finite]
    directions: int
    largest: _Finite
    unit: str


class _HeldSignal(_HeldSection):
    value: _Finite
    unit: str


class _HeldRange(_HeldSection):
    start: Annotated[_Finite, Field(alias="from")]
    to: _Finite


class _HeldConditions(_HeldSection):
    signals: dict[str, _HeldSignal]
    time_s: _Finite
    tool_mm: Annotated[list[_Finite], Field(min_length=3, max_length=3)]
    volume: dict[str, _HeldRange]
    looked_up_at: Literal["indicated", "command"]


class _HeldModel(_HeldSection):
    file: str
    sha256: str
    versions_before: int = 0


class _HeldSureness(_HeldSection):
    largest: _Finite
    k: _Finite


class HeldRecord(_HeldSection):
    """The keys that are shown."""

    made: str
    by: str
    model: _HeldModel
    conditions: _HeldConditions
    active_while_measured: dict[str, str] = {}
    tables: list[_HeldTable]
    remaining: dict[str, _LeftRecord]
    uncertainty: _HeldSureness | None = None
    notes: list[str] = []


def record_of(made: TableSet, folder: Path) -> dict[str, Any]:
    """The record of a set, checked.

    Raises
    ------
    InputError
        Where it lacks what the page shows.
    """
    record = dict(made.record)
    path = folder / RECORD_NAME
    shaped(record, HeldRecord, path)
    for name in (NONE, made.controller):
        if name not in record["remaining"]:
            raise InputError(
                "does not say what remains", file=path, field=f"remaining.{name}",
                expected="the record as abbe table wrote it",
            )  # fmt: skip
    return record
