"""The metric of a fold: an error motion's size in mm at the largest lever in the volume."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.nodes.distinct import distinct
from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

_SAMPLES = 400
_BETWEEN_SAMPLES = 1.1
"""Levers between random samples of a rotary machine's volume may be longer than at them."""


def influences(
    machine: Machine, error_motions: Sequence[ErrorMotion], conditions: Conditions
) -> F64:
    """Moves of X, Y, Z (mm) per unit of each error motion on n rows, (n, 3, motions).

    Where the machine lacks one of the three, also what would be its move: by exact composition it
    has a part in the others' moves.
    """
    chain = Chain(machine, conditions)
    if not error_motions:
        return np.zeros((conditions.n, 3, 0))
    moved = np.stack([chain.influence(c)[0] for c in error_motions], axis=2)
    return chain.along_axes(moved)


class Metric:
    """The size of an error in the error motions, in mm at the worst functional point.

    On a machine with linear axes only, the error is affine in each position: its largest norm is
    met at a corner of the volume. With rotary axes the largest influence of each error motion is
    sampled, and the errors' sizes are added up.

    Parameters
    ----------
    reach
        Tools up to this length are reckoned with, mm.
    """

    def __init__(
        self, machine: Machine, error_motions: Sequence[ErrorMotion], reach: float
    ) -> None:
        self.reach = reach
        self._some: dict[tuple[int, ...], tuple[int, int, F64]] = {}
        axes = machine.structure.axes
        corners = [machine.axis(a).travel for a in axes]
        self._vectors = not machine.structure.rotary
        if self._vectors:
            ends = np.array(list(itertools.product(*corners)))
        else:
            rng = np.random.default_rng(230)
            ends = np.array([rng.uniform(low, high, _SAMPLES) for low, high in corners]).T
        # the bare tool vector: a spindle that turns it cannot make it longer than `reach`
        tools = np.array(list(itertools.product((-reach, reach), repeat=3)))
        rows = np.tile(ends, (len(tools), 1))
        where = {a: rows[:, i] for i, a in enumerate(axes)}
        conditions = SlowState().conditions(where, {})
        tool = np.repeat(tools, len(ends), axis=0)
        every = influences(machine, error_motions, replace(conditions, tool=tool))
        if self._vectors:
            self._matrix = every[distinct(every)]
        else:
            largest = np.linalg.norm(every, axis=1).max(axis=0) * _BETWEEN_SAMPLES
            self._matrix = np.diag(largest)[None]

    def largest(self, error_motion: int) -> float:
        """The most that one unit of an error motion does, mm per mm or per rad."""
        return float(np.linalg.norm(self._matrix[:, :, error_motion], axis=1).max())

    def project(self, values: F64, error_motions: Sequence[int]) -> F64:
        """Error motions of shape (m, g, len(error_motions)) as what `size` compares, (m, w, f).

        f functions for each of the g given: one for each corner of the volume that differs.
        """
        w, q, matrix = self._corners(tuple(error_motions))
        m, g, _ = values.shape
        projected = (values @ matrix).reshape(m, g, w, q)
        return np.asarray(projected.transpose(0, 2, 1, 3).reshape(m, w, g * q))

    def _corners(self, error_motions: tuple[int, ...]) -> tuple[int, int, F64]:
        """The w components at the q corners that differ, and their matrix (motions, w·q)."""
        if error_motions not in self._some:
            matrix = self._matrix[:, :, error_motions]
            matrix = matrix[distinct(matrix)]
            q, w, k = matrix.shape
            self._some[error_motions] = w, q, matrix.transpose(2, 1, 0).reshape(k, w * q)
        return self._some[error_motions]

    def size(self, projected: F64) -> F64:
        """Size in mm of projected errors, (…, w, f) → (…, f)."""
        if self._vectors:
            x, y, z = (projected[..., i, :] for i in range(3))
            return np.asarray(np.sqrt(x * x + y * y + z * z))
        return np.asarray(np.abs(projected).sum(axis=-2))
