"""The metadata at the top of a campaign file: TOML behind ``# ``."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from abbe.compcore.campaign.campaign import Tool
from abbe.compcore.campaign.measuring_conditions import STATED, plain
from abbe.compcore.errors import InputError
from abbe.compcore.files.formats import CAMPAIGN
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.plausible import POINT, TOOL
from abbe.compcore.sentences import said

Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
_Vec = tuple[Finite, Finite, Finite]
BEGUN = "measured"
"""Section of the head that says what a measurement was begun with."""
SEEN = "seen"
"""Its key: columns of what the measurement saw beside the signals, where it saw it."""
MOST_ZEROS = 1000
"""Zeros that one set-up may have counted from."""
_PADDING = ",,"
_MOST_LINES = 100_000


class _HeadSection(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
    notes: str = ""


class _SetupSection(_HeadSection):
    free: tuple[Literal["zero", "slope", "frame"], ...]
    zeros_at: Annotated[tuple[Finite, ...], Field(max_length=MOST_ZEROS)] = ()


class _BaseSection(_HeadSection):
    position: _Vec


class _ToolSection(_HeadSection):
    offset: _Vec
    free: tuple[Literal["x", "y", "z"], ...] = ()


class _Head(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True, defer_build=True)
    format: Literal["abbe-campaign/1"]
    machine: str = ""
    instrument: str = ""
    notes: str = ""
    setups: dict[str, _SetupSection] = {}
    bases: dict[str, _BaseSection] = {}
    tools: dict[str, _ToolSection] = {}


@dataclass(frozen=True)
class CampaignHead:
    """The metadata at the top of a campaign file.

    Attributes
    ----------
    free
        Set-up → the words of its `free`; only set-ups that are listed.
    zeros_at
        Set-up → times, s, increasing, from each of which on its rows count from another zero.
    bases
        Base point → approximate coordinates, mm.
    tools
        Named tools.
    metadata
        machine, instrument, notes and whatever else a person wrote.
    seen
        Columns of what `abbe measure` saw beside the signals; blank where it did not.
    """

    free: Mapping[str, tuple[str, ...]]
    zeros_at: Mapping[str, tuple[float, ...]]
    bases: Mapping[str, tuple[float, float, float]]
    tools: Mapping[str, Tool]
    metadata: Mapping[str, Any]
    seen: frozenset[str] = frozenset()


def plain_line(line: str) -> str | None:
    """A line of metadata without ``# ``; None when the line is not metadata.

    Spreadsheets quote a cell that holds quotes and pad the line with empty cells: both undone.
    """
    if line.startswith('"#'):
        try:
            line = next(csv.reader([line]))[0]
        except csv.Error:
            return None  # a cell without end: no header either, which is reported with its line
    if not line.startswith("#"):
        return "" if not line.strip(", \t") else None
    while line.endswith(_PADDING):
        line = line.rstrip(",")
    return line[1:].removeprefix(" ")


def add_metadata(top: list[str], text: str, file: str) -> None:
    """Keep one more line of metadata.

    Raises
    ------
    InputError
        When there are more than any campaign has.
    """
    if len(top) == _MOST_LINES:
        raise InputError(
            "metadata without end",
            file=file,
            line=len(top) + 1,
            expected=said("a header and rows after at most {n} lines of metadata", n=_MOST_LINES),
        )
    top.append(text)


def read_head(lines: list[str], file: str) -> CampaignHead:
    """Read the metadata lines, ``# `` already taken off.

    Raises
    ------
    InputError
        Naming the line of the file and the key.
    """
    source = TomlSource("\n".join(lines), file)
    if "format" not in source.data:
        raise InputError(
            "not a campaign file: no format line",
            file=file,
            line=1,
            field="format",
            expected=said("{what}", what=f'# format = "{CAMPAIGN}"'),
        )
    try:
        parsed = _Head.model_validate(source.data)
    except ValidationError as error:
        raise source.invalid(error) from None
    for group in ("setups", "tools"):
        for name, section in getattr(parsed, group).items():
            if len(set(section.free)) < len(section.free):
                raise source.error("a word twice", (group, name, "free"), found=list(section.free))
    for name, setup in parsed.setups.items():
        if any(b <= a for a, b in pairwise(setup.zeros_at)):
            raise source.error(
                "times that do not increase", ("setups", name, "zeros_at"),
                found=list(setup.zeros_at),
            )  # fmt: skip
        if setup.zeros_at and "zero" not in setup.free:
            raise source.error(
                "another zero of a set-up whose zero is known", ("setups", name, "zeros_at"),
                found=list(setup.zeros_at), expected='free with "zero"',
            )  # fmt: skip
    places = [(POINT, ("bases", n, "position"), b.position) for n, b in parsed.bases.items()]
    places += [(TOOL, ("tools", n, "offset"), t.offset) for n, t in parsed.tools.items()]
    for allowed, path, vector in places:
        for component in vector:
            if not allowed.holds(component):
                raise source.error("not believable", path, found=component, expected=str(allowed))
    for key in STATED:
        if key in source.data and plain(source.data[key]) is None:
            raise source.error(
                "a condition is said in words", (key,), found=source.data[key],
                expected="a text, a number or a date",
            )  # fmt: skip
    kept = {k: v for k, v in source.data.items() if k not in ("setups", "bases", "tools")}
    return CampaignHead(
        {name: s.free for name, s in parsed.setups.items()},
        {name: s.zeros_at for name, s in parsed.setups.items() if s.zeros_at},
        {name: b.position for name, b in parsed.bases.items()},
        {name: Tool(name, t.offset, t.free) for name, t in parsed.tools.items()},
        kept,
        _seen(source.data.get(BEGUN)),
    )


def _seen(begun: object) -> frozenset[str]:
    names = begun.get(SEEN) if isinstance(begun, dict) else None
    found = names if isinstance(names, list) else []
    return frozenset(name for name in found if isinstance(name, str))
