"""The data of an `error_grid`, format ``abbe-error-grid/1``: JSON beside the model that uses it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.error_grid import ErrorGrid, MeasuredTable
from abbe.compcore.errors import InputError
from abbe.compcore.files.text.bounded_text import read_bounded
from abbe.compcore.files.text.json_source import MOST_BYTES, parse_json, shaped
from abbe.compcore.files.text.write_target import WriteTarget
from abbe.compcore.machine.error_motion import Component, ErrorMotion
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import (
    DISPLACEMENT,
    ROTATION,
    TRAVEL,
    TRAVEL_ROTARY,
    Range,
    position_range,
)
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]
FORMAT = "abbe-error-grid/1"

_Number = Annotated[float, Field(allow_inf_nan=False, strict=True)]
_Name = Annotated[str, Field(max_length=20)]


class _Lever(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    axis: _Name
    origin: _Number


class _GridTable(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    place: _Name
    component: Component
    axes: Annotated[list[_Name], Field(min_length=1, max_length=3)]
    nodes: Annotated[list[list[_Number]], Field(min_length=1, max_length=3)]
    values: list[_Number]
    down: list[_Number] | None = None
    lever: _Lever | None = None


class _GridFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    format: Literal["abbe-error-grid/1"]
    meaning: str = ""
    source: dict[str, Any] = {}
    tables: Annotated[list[_GridTable], Field(min_length=1)]


MEANING = (
    "errors (actual - indicated) in mm and rad over positions in mm and degrees, the last axis "
    "of a table running fastest; place 'point': moves along X, Y, Z, turns about them at the tool"
)


def checksum(text: str) -> str:
    """SHA-256 of a file's text."""
    return hashlib.sha256(text.encode()).hexdigest()


def format_grid(tables: Sequence[MeasuredTable], source: Mapping[str, Any]) -> str:
    """The text of a grid's file.

    Parameters
    ----------
    source
        Where the numbers come from: files with their checksums, dialect, sign, tool.

    Raises
    ------
    InputError
        When it would be larger than such a file may be.
    """
    sections = []
    for table in tables:
        section: dict[str, Any] = {
            "place": table.error_motion.place,
            "component": table.error_motion.component,
            "axes": list(table.axes),
            "nodes": [
                (np.degrees(nodes) if is_rotary(a) else nodes).round(9).tolist()
                for a, nodes in zip(table.axes, table.nodes, strict=True)
            ],
            "values": table.values.reshape(-1).tolist(),
        }
        if table.down is not None:
            section["down"] = table.down.reshape(-1).tolist()
        if table.lever is not None:
            section["lever"] = {"axis": table.lever[0], "origin": table.lever[1]}
        sections.append(json.dumps(section, ensure_ascii=False))
    head = json.dumps(
        {"format": FORMAT, "meaning": MEANING, "source": dict(source)}, ensure_ascii=False
    )
    text = head[:-1] + ', "tables": [\n' + ",\n".join(sections) + "\n]}\n"
    if len(text.encode()) > MOST_BYTES:
        raise InputError(
            "too many points for one grid", found=f"{len(text) / 1e6:.1f} MB",
            expected=f"{MOST_BYTES / 1e6:g} MB at most",
        )  # fmt: skip
    return text


def parse_grid(text: str, file: str | Path | None = None) -> tuple[MeasuredTable, ...]:
    """Tables from the text of a grid's file.

    Raises
    ------
    InputError
        Naming file, table, what was found and what was expected.
    """
    content = shaped(parse_json(text, file), _GridFile, file)
    return tuple(_table(i, section, file) for i, section in enumerate(content.tables))


def _table(index: int, section: _GridTable, file: str | Path | None) -> MeasuredTable:
    where = f"tables[{index}]"

    def refuse(problem: str, key: str, found: object, expected: str) -> InputError:
        return InputError(
            problem, file=file, field=f"{where}.{key}", found=found, expected=expected
        )

    if len(section.nodes) != len(section.axes):
        raise refuse("not as many lists of positions as axes", "nodes", len(section.nodes),
                     str(len(section.axes)))  # fmt: skip
    if len(set(section.axes)) != len(section.axes):
        raise refuse("an axis twice", "axes", ",".join(section.axes), "different axes")
    nodes: list[F64] = []
    for axis, given in zip(section.axes, section.nodes, strict=True):
        if axis[:1] not in tuple("XYZUVWRABC"):
            raise refuse("not the name of an axis", "axes", axis, "a letter of X Y Z U V W A B C")
        array = np.array(given, dtype=np.float64)
        if not len(array) or not (np.diff(array) > 0.0).all():
            raise refuse(f"positions of {axis} do not increase", "nodes", len(array), "≥ 1, rising")
        allowed = TRAVEL_ROTARY if is_rotary(axis) else TRAVEL
        if allowed.outside(array).any():
            worst = float(array[allowed.outside(array)][0])
            raise refuse(f"not a position of {axis}", "nodes", worst, str(allowed))
        nodes.append(np.radians(array) if is_rotary(axis) else array)
    shape = tuple(len(n) for n in nodes)
    motion = ErrorMotion(section.place, section.component)
    allowed, scale = (ROTATION, 1e6) if motion.rotation else (DISPLACEMENT, 1e3)
    if section.lever is not None:
        allowed = Range(-math.inf, math.inf, allowed.unit)  # judged with the machine's travel
    values = [
        _values(given, shape, scale, allowed, refuse, key)
        for key, given in (("values", section.values), ("down", section.down))
        if given is not None
    ]
    lever = None if section.lever is None else (section.lever.axis, section.lever.origin)
    down = values[1] if len(values) > 1 else None
    return MeasuredTable(motion, tuple(section.axes), tuple(nodes), values[0], down, lever)


def _values(
    given: list[float], shape: tuple[int, ...], scale: float, allowed: Range, refuse: Any, key: str
) -> F64:
    if len(given) != math.prod(shape):
        raise refuse("not a value for each point", key, len(given), str(math.prod(shape)))
    array = np.array(given, dtype=np.float64)
    with np.errstate(over="ignore"):
        bad = allowed.outside(scale * array)
    if bad.any():
        raise refuse("an error that nothing has", key, float(scale * array[bad][0]), str(allowed))
    return array.reshape(shape)


def load_grid(
    effect: ErrorGrid, machine: Machine, folder: Path | None, given: Mapping[str, str] | None = None
) -> ErrorGrid:
    """A grid with its data, read from its file and checked against its checksum and the machine.

    Parameters
    ----------
    folder
        The model's folder; None: the model is no file.
    given
        Name → text of files that are at hand, and are not read.

    Raises
    ------
    InputError
        Naming the file, what was found and what was expected.
    """
    text = (given or {}).get(effect.file)
    path = effect.file if folder is None else str(folder / effect.file)
    if text is None:
        if folder is None:
            raise InputError(
                "a grid's file is looked for beside the model, which is no file itself",
                field="file", found=effect.file,
            )  # fmt: skip
        text = read_bounded(path, MOST_BYTES, expected="the data of an error grid")
    found = checksum(text)
    if effect.sha256 != found:
        raise InputError(
            "the grid's file is not the one that the model was made with" if effect.sha256 else
            "the model does not say which content the grid's file has", file=path, field="sha256",
            found=effect.sha256, expected=found,
        )  # fmt: skip
    made = effect.holding(parse_grid(text, path), found, text)
    made.check(machine)
    for table in made.tables:
        if table.lever is not None:
            _check_lever(table, machine, path)
    return made


def _check_lever(table: MeasuredTable, machine: Machine, file: str) -> None:
    axis, origin = table.lever or ("", 0.0)
    reach = machine.axis(axis, "lever")
    if not position_range(reach).holds(origin):
        raise InputError("not a position of this axis", file=file, field="lever", found=origin)
    most = max(abs(end - origin) for end in reach.travel)
    rotation = table.error_motion.rotation
    allowed, scale = (ROTATION, 1e6) if rotation else (DISPLACEMENT, 1e3)
    with np.errstate(over="ignore"):
        largest = scale * most * float(np.abs(table.values).max())
    if not allowed.holds(largest):
        raise InputError(
            "an error that nothing has", file=file, found=largest, expected=str(allowed)
        )


def grid_files(effects: Sequence[Effect]) -> dict[str, str]:
    """Name → text of the files that a model's grids need beside it.

    Raises
    ------
    InputError
        When two grids give one name to different contents.
    """
    found: dict[str, str] = {}
    for effect in effects:
        if isinstance(effect, ErrorGrid) and effect.text:
            if found.get(effect.file, effect.text) != effect.text:
                raise InputError("two grids in one file", field="file", found=effect.file)
            found[effect.file] = effect.text
    return found


def files_to_write(effects: Sequence[Effect], model: str | Path) -> dict[Path, str]:
    """Path → text of what is still missing beside a model that is to be written.

    Raises
    ------
    InputError
        When a file of that name holds something else, or the model goes to standard output.
    """
    missing: dict[Path, str] = {}
    files = grid_files(effects)
    if files and not WriteTarget.of(model).replaced:
        raise InputError(
            "a model with a grid is two files", file=model, expected="the name of a file"
        )
    for name, text in files.items():
        path = Path(model).parent / name
        if not path.exists():
            missing[path] = text
        elif read_bounded(path, MOST_BYTES) != text:
            raise InputError(
                "there is another file where the model's grid belongs", file=path,
                expected="the same content, or a model in another folder",
            )  # fmt: skip
    return missing


__all__ = [
    "FORMAT",
    "checksum",
    "files_to_write",
    "format_grid",
    "grid_files",
    "load_grid",
    "parse_grid",
]
