"""The errors of a machine all over its volume, in one state: at nodes, and along lines of a box."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError, require_type
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import own_component
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]

_ALONG = 17
"""Points of each line of the box."""


@dataclass(frozen=True, eq=False)
class ErrorVolume:
    """Errors at the functional point all over the volume.

    Attributes
    ----------
    axes
        The linear axis that moves along X, along Y, along Z; empty where there is none.
    nodes, error
        Where the axes stand, and the error there, shape (n, 3), mm.
    lines, line_error
        The same along the lines of a box, shape (lines, points, 3), mm.
    edges
        Which of the lines are the box's edges, shape (lines,).
    """

    axes: tuple[str, str, str]
    nodes: F64
    error: F64
    lines: F64
    line_error: F64
    edges: NDArray[np.bool_]

    @property
    def largest(self) -> float:
        """Greatest length of the error vector, at the nodes and on the lines, mm."""
        return float(np.linalg.norm(self.error, axis=1).max())

    @property
    def worst(self) -> F64:
        """Where that is, among the nodes, (3,), mm."""
        found: F64 = self.nodes[int(np.argmax(np.linalg.norm(self.error, axis=1)))]
        return found


def error_volume(
    model: Model,
    at: Mapping[str, float],
    *,
    signals: Mapping[str, float] | None = None,
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
    time: float = 0.0,
    points: int = 5,
) -> ErrorVolume:
    """Errors of a fitted model over the travel of its linear axes.

    Parameters
    ----------
    model
        The model.
    at
        Where the other axes stand, mm (rotary: rad); the middle of their travel where not given.
    signals
        Name → value; temperatures that are not given are at the reference temperature, other
        signals 0.
    tool
        Tool or probe offset, mm, machine axes.
    time
        s.
    points
        Nodes along each axis.

    Raises
    ------
    InputError
        When the machine has no linear axis.
    """
    require_type(model, Model, "model")
    machine = model.machine
    across = ["", "", ""]
    for name in reversed(machine.structure.linear):
        across["XYZ".index(own_component(name))] = name
    if not any(across):
        raise InputError("has no linear axis, so there is no volume", field="machine")
    ends = [machine.axes[a].travel if a else (0.0, 0.0) for a in across]
    grid = [
        np.linspace(*e, points) if a else np.zeros(1) for a, e in zip(across, ends, strict=True)
    ]
    nodes = np.stack([g.ravel() for g in np.meshgrid(*grid, indexing="ij")], axis=1)
    lines, edges = _box(across, ends)
    every = np.concatenate([nodes, lines.reshape(-1, 3)])
    n = len(every)
    positions = {a: np.full(n, at.get(a, machine.axes[a].middle)) for a in machine.structure.axes}
    positions |= {a: every[:, k] for k, a in enumerate(across) if a}
    values = {
        s.name: machine.reference_temperature if s.temperature else 0.0
        for s in machine.signals.values()
    }
    conditions = Conditions(
        positions,
        tool=np.tile(np.asarray(tool, dtype=np.float64), (n, 1)),
        time=np.full(n, time),
        signals={k: np.full(n, v) for k, v in (values | dict(signals or {})).items()},
    )
    error = model.predict(conditions).translation
    return ErrorVolume(
        (across[0], across[1], across[2]),
        nodes,
        error[: len(nodes)],
        lines,
        error[len(nodes) :].reshape(lines.shape),
        edges,
    )


def _box(across: list[str], ends: list[tuple[float, float]]) -> tuple[F64, NDArray[np.bool_]]:
    """Lines on the faces of the travel: at the ends and in the middle of the other axes."""
    lines, edges = [], []
    for k, name in enumerate(across):
        if not name:
            continue
        others = [j for j in range(3) if j != k]
        places = [(e[0], 0.5 * (e[0] + e[1]), e[1]) if a else (0.0,)
                  for a, e in zip(across, ends, strict=True)]  # fmt: skip
        for one, two in product(*(range(len(places[j])) for j in others)):
            line = np.zeros((_ALONG, 3))
            line[:, k] = np.linspace(*ends[k], _ALONG)
            for j, chosen in zip(others, (one, two), strict=True):
                line[:, j] = places[j][chosen]
            lines.append(line)
            edges.append(one != 1 and two != 1)
    return np.stack(lines), np.array(edges)
