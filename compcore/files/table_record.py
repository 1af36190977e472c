"""The record beside a set of tables: what it must hold; whatever else stands in it is kept."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints

_LONGEST_NAME = 255
"""Bytes of a file's name that systems allow."""


def _plain_name(name: str) -> str:
    """A file in the record's own folder: no path, no hidden way out of it."""
    plain = name not in ("", ".", "..") and not set(name) & set("/\\\0")
    if not plain or len(name.encode("utf-8", "replace")) > _LONGEST_NAME:
        raise ValueError("the name of a file in the same folder")
    return name


Name = Annotated[str, AfterValidator(_plain_name)]
Checksum = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _RecordSection(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True, strict=True)


class _Model(_RecordSection):
    sha256: str = ""
    machine: str = ""
    structure: str = ""
    versions_before: int | None = None


class _Conditions(_RecordSection):
    tool_mm: Annotated[list[Finite], Field(min_length=3, max_length=3)] | None = None


class _RecordTable(_RecordSection):
    table: str
    largest: Finite
    unit: str


class RecordFile(_RecordSection):
    """The record's keys that are read again."""

    format: Literal["abbe-tables/1"]
    controller: str
    options: dict[str, Any]
    files: dict[Name, Checksum]
    sha256: Checksum
    model: _Model = _Model()
    conditions: _Conditions = _Conditions()
    tables: list[_RecordTable] = []
