"""Values of a piecewise linear table by least squares on a finely known curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.multilinear import interpolate

F64 = NDArray[np.float64]


def weights(positions: F64) -> F64:
    """Weights of the trapezoidal rule on increasing positions, (m,), mm or rad."""
    half = 0.5 * np.diff(positions)
    total = np.zeros(len(positions))
    total[:-1] += half
    total[1:] += half
    return total


def hats(positions: F64, nodes: F64) -> F64:
    """Hat functions of a piecewise linear table, (m, n): values at nodes → at positions."""
    if len(nodes) == 1:
        return np.ones((len(positions), 1))
    held = np.clip(positions, nodes[0], nodes[-1])
    left = np.clip(np.searchsorted(nodes, held, side="right") - 1, 0, len(nodes) - 2)
    part = (held - nodes[left]) / (nodes[left + 1] - nodes[left])
    matrix = np.zeros((len(positions), len(nodes)))
    rows = np.arange(len(positions))
    matrix[rows, left] = 1.0 - part
    matrix[rows, left + 1] = part
    return matrix


def operator(positions: F64, nodes: F64) -> F64:
    """Matrix (n, m) from a curve at fine positions to the best values at the nodes.

    Least squares over the positions' range; the mean of what is left is zero against every node's
    hat, and so over the range. Where the nodes stand as densely as the positions, so that some
    would be left without a say, the values are the curve's own.
    """
    matrix = hats(positions, nodes)
    weighted = matrix * weights(positions)[:, None]
    gram = weighted.T @ matrix
    own = np.diag(gram)
    dense = len(nodes) > len(positions) // 2 or bool((own < 1e-3 * own.max(initial=0.0)).any())
    if dense:
        return hats(nodes, positions)
    return np.asarray(np.linalg.solve(gram, weighted.T))


def deviation(positions: F64, curve: F64, nodes: F64, values: F64) -> float:
    """Largest deviation of a table from a curve (m,), in the curve's unit."""
    return float(np.abs(curve - interpolate((nodes,), values, (positions,))).max())


def node_weights(nodes: F64) -> F64:
    """Integrals of the nodes' hat functions over the table's range, (n,); 1 for a single node."""
    return weights(nodes) if len(nodes) > 1 else np.ones(1)
