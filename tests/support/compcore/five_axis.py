"""Five-axis machines with known errors, and their chains of 4×4 matrices: no Abbe in them.

`chain` is the truth of the tests of rotary corrections: rigid bodies, one after the other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from abbe.compcore.effects.catalogue.error_grid import ErrorGrid, MeasuredTable
from abbe.compcore.files.grid_file import checksum, format_grid
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Composition, Model, Term

F64 = NDArray[np.float64]
Errors = Mapping[str, F64]

LINEAR = {"X": (0.0, 500.0), "Y": (-200.0, 200.0), "Z": (-300.0, 0.0)}
ROTARY = {"A": (-1.8, 1.8), "B": (-1.9, 1.9), "C": (-3.2, 3.2)}
LOCATION = {"A": (0.0, 30.0, -250.0), "B": (0.0, 0.0, 120.0), "C": (250.0, 20.0, 0.0)}
ON_HEAD = {"A": (0.0, 0.0, 90.0), "B": (0.0, 0.0, 120.0), "C": (0.0, 0.0, 0.0)}
CODES = {
    "head-head": "w b X Y Z C B t",
    "table-table": "w C' A' b Y X Z t",
    "mixed": "w Y' C' b X Z B t",
    "C table": "w C' b X Y Z t",
    "B head": "w X' b Y Z B (C) t",
}
ANYWHERE: Mapping[str, tuple[float, float, float]] = {}
NODES = {a: np.linspace(*t, 7) for a, t in {**LINEAR, **ROTARY}.items()}


def machine_of(code: str, places: Mapping[str, tuple[float, float, float]] = ANYWHERE) -> Machine:
    """A machine of some structure; `places`: a point of a rotary axis's line, mm."""
    structure = Structure.parse(code)
    axes = {}
    for a in structure.axes:
        if a in LINEAR:
            axes[a] = Axis(a, LINEAR[a])
        else:
            place = LOCATION if a in structure.workpiece_side else ON_HEAD
            axes[a] = Axis(a, ROTARY[a[0]], location=places.get(a) or place[a])
    return Machine(code, structure, axes)


def errors_of(machine: Machine, seed: int = 4) -> dict[str, F64]:
    """Axis → six error motions at its nodes, (6, 7): up to 2 µm and 30 µrad."""
    rng = np.random.default_rng(seed)
    size = np.array([2e-3] * 3 + [3e-5] * 3)[:, None]
    return {a: size * rng.uniform(-1.0, 1.0, (6, 7)) for a in machine.structure.axes}


def model_of(machine: Machine, errors: Errors, composition: Composition = "exact") -> Model:
    """The same machine to Abbe."""
    tables = [
        MeasuredTable(ErrorMotion(a, c), (a,), (NODES[a[0]],), errors[a][k])
        for a in machine.structure.axes
        for k, c in enumerate("XYZABC")
    ]
    text = format_grid(tables, {})
    grid = ErrorGrid(file="five-axis.grid.json").holding(tables, checksum(text), text)
    return Model(machine, (Term(grid),), composition)


def turn(axis: str, angle: float) -> F64:
    """A right-handed turn about A, B or C, rad."""
    c, s = math.cos(angle), math.sin(angle)
    m = np.eye(4)
    i, j = {"A": (1, 2), "B": (2, 0), "C": (0, 1)}[axis[0]]
    m[i, i] = m[j, j] = c
    m[i, j], m[j, i] = -s, s
    return m


def shift(vector: ArrayLike) -> F64:
    """A move, mm."""
    m = np.eye(4)
    m[:3, 3] = vector
    return m


def chain(
    machine: Machine, errors: Errors | None, q: Mapping[str, float], tool: ArrayLike
) -> tuple[F64, F64]:
    """Where the tool's tip is in the workpiece, and its direction: rigid bodies, one by one."""
    t = np.eye(4)
    for a in machine.structure.axes:
        e = np.eye(4)
        if errors is not None:
            x, y, z, ea, eb, ec = (np.interp(q[a], NODES[a[0]], v) for v in errors[a])
            e = shift((x, y, z)) @ turn("A", ea) @ turn("B", eb) @ turn("C", ec)
        on_table = a in machine.structure.workpiece_side
        if a in "XYZ":
            own = shift(np.eye(3)["XYZ".index(a)] * q[a])
            t = t @ (e @ own if on_table else own @ e)
        else:
            line = np.array(machine.axes[a].location)
            own = shift(line) @ turn(a, q[a]) @ shift(-line)
            about = shift(line) @ e @ shift(-line)
            t = t @ (own @ about if on_table else about @ own)
    return (t @ [*np.asarray(tool), 1.0])[:3], t[:3, 2]


def somewhere(machine: Machine, n: int, seed: int = 6) -> dict[str, F64]:
    """Positions within nine tenths of all travels, (n,) each."""
    rng = np.random.default_rng(seed)
    inside = {a: np.array(x.travel) * 0.9 for a, x in machine.axes.items()}
    return {a: rng.uniform(*ends, n) for a, ends in inside.items()}


def row(table: Mapping[str, F64], i: int) -> dict[str, float]:
    """One of many positions."""
    return {a: float(v[i]) for a, v in table.items()}


def angle(u: F64, v: F64) -> float:
    """Between unit vectors that differ by little, rad."""
    return float(np.linalg.norm(np.cross(u, v)))


TOOL = (5.0, -3.0, -160.0)
"""mm"""
