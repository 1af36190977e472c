"""Other ways to the same error, for the compensator's benchmark: plain NumPy, SciPy's grids, C.

All of them take the machine ``w b Y X Z t`` with 18 error motions tabulated on even nodes, in one
state of temperatures; squareness and thermal expansion are in the tables already.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import map_coordinates

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]
Errors = Callable[[F64], F64]
"""Positions (n, 3) in the order Y X Z → errors (n, 3) in the order X Y Z, mm."""

_SOURCE = Path(__file__).with_name("compensator_loop.c")


class Tabulated:
    """A model's error motions on even nodes.

    Attributes
    ----------
    axes
        The structure's order: Y, X, Z.
    grid
        Nodes of each axis, mm, (3, nodes).
    motions
        E_X E_Y E_Z E_A E_B E_C of each axis at its nodes, (3, nodes, 6), mm and rad.
    tool
        mm.
    """

    def __init__(
        self, model: Model, signals: dict[str, float], tool: tuple[float, float, float], nodes: int
    ) -> None:
        machine = model.machine
        self.axes = machine.structure.axes
        self.tool = np.array(tool)
        self.grid = np.stack([np.linspace(*machine.axis(a).travel, nodes) for a in self.axes])
        self.motions = np.zeros((3, nodes, 6))
        for i, axis in enumerate(self.axes):
            conditions = Conditions.at(
                {a: self.grid[i] if a == axis else machine.axis(a).middle for a in self.axes},
                signals=signals,
            )
            found = model.error_motions(conditions)
            for k, component in enumerate("XYZABC"):
                error_motion = ErrorMotion(axis, component)  # type: ignore[arg-type]
                self.motions[i, :, k] = found.get(error_motion, 0.0)


def with_np_interp(tables: Tabulated) -> Errors:
    """What one writes first: ``np.interp`` for each of 18 error motions, then cross products."""
    t = tables.tool

    def errors(positions: F64) -> F64:
        y, x, z = positions.T
        zero = np.zeros_like(x)
        levers = [
            np.stack([x + t[0], zero + t[1], z + t[2]], axis=1),
            np.stack([zero + t[0], zero + t[1], z + t[2]], axis=1),
            np.broadcast_to(t, positions.shape),
        ]
        total = np.zeros(positions.shape)
        for a, q in enumerate((y, x, z)):
            moved = [np.interp(q, tables.grid[a], tables.motions[a, :, k]) for k in range(6)]
            total += np.stack(moved[:3], axis=1)
            total += np.cross(np.stack(moved[3:], axis=1), levers[a])
        return total

    return errors


def volume(tables: Tabulated, exact: Errors, nodes: int) -> tuple[list[F64], F64]:
    """The errors on a grid of `nodes`³ points: its axes Y X Z, and (nodes, nodes, nodes, 3), mm."""
    axes = [np.linspace(g[0], g[-1], nodes) for g in tables.grid]
    at = np.stack([m.reshape(-1) for m in np.meshgrid(*axes, indexing="ij")], axis=1)
    return axes, exact(at).reshape(nodes, nodes, nodes, 3)


def with_regular_grid(axes: list[F64], errors: F64) -> Errors:
    """SciPy's `RegularGridInterpolator`, linear, on the grid of errors."""
    return RegularGridInterpolator(axes, errors)


def with_map_coordinates(axes: list[F64], errors: F64) -> Errors:
    """SciPy's `map_coordinates`, linear, on the grid of errors, component by component."""
    low = np.array([a[0] for a in axes])
    per_mm = np.array([(len(a) - 1) / (a[-1] - a[0]) for a in axes])
    parts = [np.ascontiguousarray(errors[..., c]) for c in range(3)]

    def interpolate(positions: F64) -> F64:
        at = ((positions - low) * per_mm).T
        found = [map_coordinates(part, at, order=1, mode="nearest") for part in parts]
        return np.stack(found, axis=1)

    return interpolate


class Loop:
    """``compensator_loop.c`` by the system's compiler, -O3 for this processor, through ctypes."""

    def __init__(self, tables: Tabulated) -> None:
        self._folder = tempfile.TemporaryDirectory()
        library = Path(self._folder.name) / "loop.so"
        subprocess.run(
            ["cc", "-O3", "-march=native", "-shared", "-fPIC", "-o", library, _SOURCE], check=True
        )
        self._loop = ctypes.CDLL(str(library)).errors
        self._loop.argtypes = [ctypes.c_size_t, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t]
        self._loop.argtypes += [ctypes.c_void_p] * 4
        self._loop.restype = None
        nodes = tables.grid.shape[1]
        self._kept = [
            np.ascontiguousarray(tables.grid[:, 0]),
            (nodes - 1) / (tables.grid[:, -1] - tables.grid[:, 0]),
            np.ascontiguousarray(tables.motions),
            np.ascontiguousarray(tables.tool, dtype=np.float64),
        ]
        self._constants = (nodes, *(array.ctypes.data for array in self._kept))
        self._one_in, self._one_out = (ctypes.c_double * 3)(), (ctypes.c_double * 3)()
        self._one = (1, ctypes.addressof(self._one_in), ctypes.addressof(self._one_out))

    def errors(self, positions: F64) -> F64:
        """Many points."""
        out = np.empty(positions.shape)
        self._loop(len(positions), positions.ctypes.data, out.ctypes.data, *self._constants)
        return out

    def step(self, row: Sequence[float]) -> tuple[float, ...]:
        """One point, without any array."""
        self._one_in[:] = row
        self._loop(*self._one, *self._constants)
        return tuple(self._one_out)
