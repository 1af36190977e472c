"""A model with errors that others measured: files in any dialect, as one effect."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from abbe.compcore.effects.catalogue.error_grid import ErrorGrid, MeasuredTable
from abbe.compcore.errors import InputError
from abbe.compcore.files.grid_file import checksum, format_grid, load_grid
from abbe.compcore.files.model_file import load_model
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure, is_rotary
from abbe.compcore.model.model import Model, Term
from abbe.compcore.tables.table import Sign, Table, unit_of_position
from abbe.daemon.arguments.ranges import ranges
from abbe.daemon.arguments.tables.arguments import present_files
from abbe.daemon.installed import abbe_version
from abbe.drivers.controllers import make_controller

_WIDEST = 1e5
_WIDEST_TURN = math.radians(36e3)
"""Travel of axes while their files are read, mm and rad; the points then say what it is."""


@dataclass(frozen=True)
class GridRequest:
    """What is to be imported.

    Attributes
    ----------
    files, controller, options
        The files, or one folder; their dialect and its options.
    tool
        Offset with which a grid was measured, mm.
    out
        The model that is to be written; the grid's own file stands beside it.
    onto
        A model to which the errors are added; else `structure`, `travel` and `name` make one.
    """

    files: Sequence[Path]
    controller: str
    options: Mapping[str, str]
    tool: tuple[float, float, float]
    out: Path
    onto: Path | None = None
    structure: str = ""
    travel: Sequence[str] = ()
    name: str = ""


def imported(request: GridRequest) -> tuple[Model, list[str]]:
    """The model with the errors in it, and what is to be said about it.

    Raises
    ------
    InputError
        For files that cannot be read, that hold nothing, or that do not fit the machine.
    """
    texts: dict[str, str] = {}
    paths: dict[str, Path] = {}
    for path in request.files:
        for name, text in present_files(path, request.controller).items():
            if texts.setdefault(name, text) != text:
                raise InputError("two files of one name", file=path)
            paths[name] = path / name if path.is_dir() else path
    model = _provisional(request) if request.onto is None else load_model(request.onto)
    controller = make_controller(request.controller, model.machine, request.options)
    try:
        tables = controller.read(texts)
    except InputError as error:
        raise error.of_file(paths.get(error.file or "")) from None
    if not tables:
        raise InputError("no table in these files", file=", ".join(texts))
    if request.onto is None:
        model = replace(model, machine=_with_travel(model.machine, tables, request))
    source = {
        "controller": request.controller,
        "options": dict(request.options),
        "files": [{"file": n, "sha256": checksum(t)} for n, t in texts.items()],
        "abbe": abbe_version(),
    }
    text = format_grid([_measured(table) for table in tables], source)
    sha256 = checksum(text)
    name = f"{request.out.stem}-{sha256[:8]}.grid.json"
    grid = ErrorGrid(file=name, sha256=sha256, tool=request.tool)
    # as it will be read again
    grid = load_grid(grid, model.machine, None, {name: text})
    fit: dict[str, Any] = dict(model.fit) if request.onto is not None else {"abbe": abbe_version()}
    made = replace(model, terms=(*model.terms, Term(grid)), fit=fit)
    return made, _lines(made, grid, name, request)


def _provisional(request: GridRequest) -> Model:
    structure = Structure.parse(request.structure)
    axes = {
        a: Axis(a, (-_WIDEST_TURN, _WIDEST_TURN) if is_rotary(a) else (-_WIDEST, _WIDEST))
        for a in structure.axes
    }
    return Model(Machine(request.name or request.out.stem, structure, axes))


def _with_travel(machine: Machine, tables: Sequence[Table], request: GridRequest) -> Machine:
    """The travels as given, else from the first to the last point of the tables."""
    given = ranges(request.travel, machine, "travel")
    axes = {}
    for name, axis in machine.axes.items():
        ends = given.get(name)
        if ends is None:
            found = [
                float(nodes[end])
                for table in tables
                for axis_of, nodes in zip(table.inputs, table.nodes, strict=True)
                for end in (0, -1)
                if axis_of == name and len(nodes) > 1
            ]
            if not found:
                raise InputError(
                    f"the files do not say how far {name} travels", field="travel",
                    expected=f"--travel {name}=LOW,HIGH",
                )  # fmt: skip
            ends = min(found), max(found)
        if not ends[0] < ends[1]:
            raise InputError("not a travel", field=f"travel {name}", found=list(ends))
        axes[name] = replace(axis, travel=ends)
    return replace(machine, axes=axes)


def _measured(table: Table) -> MeasuredTable:
    errors = table.as_sign(Sign.ERROR)
    return MeasuredTable(
        errors.output, errors.inputs, errors.nodes, errors.forward, errors.backward, errors.lever
    )


def _lines(model: Model, grid: ErrorGrid, name: str, request: GridRequest) -> list[str]:
    points = sum(table.values.size for table in grid.tables)
    motions = ", ".join(dict.fromkeys(str(t.error_motion) for t in grid.tables))
    lines = [
        f"{request.out}: {model.machine.structure}, {len(grid.tables)} tables ({motions}), "
        f"{points} values; data in {name}"
    ]
    for axis, (low, high) in grid.ranges().items():
        unit, factor = unit_of_position(axis)
        ends = model.machine.axis(axis).travel
        if low > ends[0] + 1e-9 or high < ends[1] - 1e-9:
            lines.append(
                f"{axis} was measured from {low * factor:g} to {high * factor:g} {unit} of "
                f"{ends[0] * factor:g} to {ends[1] * factor:g}: beyond, the end's value is held"
            )
    turning = [t for t in grid.tables if t.error_motion.rotation]
    if not turning and np.any(request.tool):
        lines.append("without turns in the grid the tool changes nothing")
    return lines
