"""Optimal nodes of a piecewise linear table: least interpolation error for their number.

Where spacing is free the best positions are found exactly, out of a finite set of candidates, for
all curves that share the points at once: a segment from candidate i to candidate j is allowed at a
tolerance ε when no candidate between them lies farther than ε from the chord, and the fewest
allowed segments from end to end are found by dynamic programming; the least ε at which they are no
more than wanted is found by bisection. (Imai and Iri, J. Inf. Process. 9 (1986), 'min-#' and
'min-ε' problems.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.tables.capability import Spacing
from abbe.compcore.tables.projection.curves.marginal import distinct

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_HALVINGS = 40
_CANDIDATES = 257


def place(
    positions: F64,
    curves: F64,
    spacing: Spacing,
    most: int,
    tolerance: float,
    through: float | None = None,
) -> F64:
    """The fewest nodes, shared by some curves, that keep a tolerance; at most as many as allowed.

    Parameters
    ----------
    positions
        (m,), increasing, mm or rad; the first and last are the ends of the table.
    curves
        (c, m): all in one unit, that of the tolerance.
    spacing
        Where points may stand.
    most
        Most points.
    tolerance
        Interpolation error that need not be bettered; 0: use all points.
    through
        One of the positions that must be a point where points stand freely.

    Returns
    -------
    Increasing positions, mm or rad.

    Raises
    ------
    InputError
        For fewer than two points.
    """
    if most < 2:
        raise InputError("a table needs at least two points", field="points", found=most)
    low, high = float(positions[0]), float(positions[-1])
    if spacing.rule == "free":
        return _free(positions, curves, spacing, most, tolerance, through)
    if spacing.rule == "power of two":
        return _powers(positions, curves, spacing, most, tolerance)
    needed = _needed(spacing, low, high)
    if most < needed:
        raise InputError(
            "too few points for a table with one at zero", field="points", found=most,
            expected=f"{needed} or more",
        )  # fmt: skip
    count = max(needed, min(most, _count_for(spacing, low, high)))
    if tolerance > 0.0:
        tried = needed
        while tried < count:
            nodes = equidistant(low, high, tried, spacing)
            if interpolation_error(positions, curves, nodes) <= tolerance:
                return nodes
            tried = max(tried + 1, math.ceil(1.2 * tried))
    return equidistant(low, high, count, spacing)


def interpolation_error(positions: F64, curves: F64, nodes: F64) -> float:
    """Largest interpolation error of tables that hold the curves' own values at the nodes.

    At a node beyond the curves' end: the value that lets the table end with the curve.
    """
    worst = 0.0
    for curve in np.atleast_2d(curves):
        values = np.interp(nodes, positions, curve)
        for end, node, inner in ((0, 0, 1), (-1, -1, -2)):
            beyond = (nodes[node] - positions[end]) * (nodes[node] - nodes[inner]) > 0.0
            reach = positions[end] - nodes[inner]
            if beyond and reach != 0.0:
                rise = (curve[end] - values[inner]) / reach
                values[node] = values[inner] + rise * (nodes[node] - nodes[inner])
        worst = max(worst, float(np.abs(curve - np.interp(positions, nodes, values)).max()))
    return worst


def equidistant(low: float, high: float, count: int, spacing: Spacing) -> F64:
    """At most `count` equidistant points that reach from low to high or a little beyond.

    With a unit, distance and positions are whole multiples of it; the distance is a round number
    where one is at most 15 % longer than it must be.
    """
    span = high - low
    if spacing.unit <= 0.0 and not spacing.through_zero:
        return np.linspace(low, high, count)
    unit = spacing.unit or span * 1e-9
    shortest = max(span / (count - 1), spacing.least, unit) / unit
    step = _round_number(shortest)
    needed = _needed(spacing, low, high)
    while True:
        grid = step if spacing.through_zero else 1
        first = math.floor(low / (grid * unit) + 1e-9) * grid
        number = math.ceil((high / unit - first) / step - 1e-9) + 1
        if number <= count or number == needed:
            return np.asarray((first + step * np.arange(number)) * unit, dtype=np.float64)
        step += 1 if step < 10 else max(1, step // 200)


def _needed(spacing: Spacing, low: float, high: float) -> int:
    """Points without which no range is covered: both ends, and zero between them if it must be."""
    return 3 if spacing.through_zero and low < 0.0 < high else 2


def _round_number(least: float) -> int:
    """A whole number from `least` up: 1, 2, 2.5 or 5 times a power of ten where one is near."""
    exact = math.ceil(least - 1e-9)
    power = 10.0 ** math.floor(math.log10(exact))
    for factor in (1.0, 2.0, 2.5, 5.0, 10.0):
        value = factor * power
        if exact <= value <= 1.15 * exact and value == round(value):
            return round(value)
    return exact


def _count_for(spacing: Spacing, low: float, high: float) -> int:
    least = max(spacing.least, spacing.unit)
    return int((high - low) / least + 1e-9) + 1 if least > 0.0 else 1_000_000


def _powers(positions: F64, curves: F64, spacing: Spacing, most: int, tolerance: float) -> F64:
    low, high = float(positions[0]), float(positions[-1])
    fitting: F64 | None = None
    for power in range(spacing.powers[1], spacing.powers[0] - 1, -1):
        distance = spacing.unit * 2.0**power
        number = max(2, math.ceil((high - low) / distance - 1e-9) + 1)
        if number > most:
            break
        fitting = np.asarray(low + np.arange(number) * distance, dtype=np.float64)
        if interpolation_error(positions, curves, fitting) <= tolerance:
            break
    if fitting is None:
        longest = spacing.unit * 2.0 ** spacing.powers[1] * (most - 1)
        raise InputError(
            "the axis is longer than the table can reach",
            field="points",
            found=f"{high - low:g}",
            expected=f"at most {longest:g}",
        )
    return fitting


def _free(
    positions: F64,
    curves: F64,
    spacing: Spacing,
    most: int,
    tolerance: float,
    through: float | None,
) -> F64:
    index = candidates(positions, curves)
    must: int | None = None
    if through is not None:
        index = np.union1d(index, [np.abs(positions - through).argmin()])
        must = int(np.abs(positions[index] - through).argmin())
    at, values = positions[index], curves[:, index]
    chosen = fewest(at, values, tolerance, spacing.least, must)
    if tolerance <= 0.0 or len(chosen) > most:
        chosen = best(at, values, most, spacing.least, must)
    nodes = at[chosen]
    if spacing.unit > 0.0:
        nodes = distinct(np.round(nodes / spacing.unit) * spacing.unit, 0.5 * spacing.unit)
    return nodes


def candidates(positions: F64, curves: F64) -> NDArray[np.intp]:
    """Indices of candidate nodes: spread evenly, and where the curves bend most."""
    m = len(positions)
    if m <= _CANDIDATES:
        return np.arange(m)
    steps = np.diff(positions)
    slopes = np.diff(curves, axis=1) / steps
    bend = np.zeros(m)
    bend[1:-1] = np.abs(np.diff(slopes, axis=1)).max(axis=0)
    half = _CANDIDATES // 2
    even = np.searchsorted(positions, np.linspace(positions[0], positions[-1], half))
    bent = np.argsort(bend, kind="stable")[-half:]
    return np.unique(np.concatenate([[0], np.clip(even, 0, m - 1), bent, [m - 1]]))


def allowed(
    positions: F64, curves: F64, tolerance: float, least: float = 0.0, must: int | None = None
) -> Bool:
    """Which segments (i, j), i < j, keep all candidates between within a tolerance, (m, m).

    None leaps over the candidate `must`.
    """
    m = len(positions)
    run = positions[None, :] - positions[:, None]
    later = np.triu(np.ones((m, m), dtype=bool), 1)
    good = later & (run >= least * (1.0 - 1e-9))
    if must is not None:
        good[:must, must + 1 :] = False
    run = np.where(later, run, np.inf)
    for curve in curves:
        rise = curve[None, :] - curve[:, None]
        slope = rise / run
        # lines from i that pass within the tolerance of every candidate up to k
        lowest = np.maximum.accumulate(np.where(later, (rise - tolerance) / run, -np.inf), axis=1)
        highest = np.minimum.accumulate(np.where(later, (rise + tolerance) / run, np.inf), axis=1)
        good &= (slope >= lowest) & (slope <= highest)
    return np.asarray(good)


def fewest(
    positions: F64, curves: F64, tolerance: float, least: float = 0.0, must: int | None = None
) -> NDArray[np.intp]:
    """Indices of the fewest candidates that keep a tolerance, the ends and `must` among them."""
    found = _path(allowed(positions, curves, max(tolerance, 0.0), least, must))
    return _ends(len(positions), must) if found is None else found


def _ends(count: int, must: int | None) -> NDArray[np.intp]:
    return np.unique([0, 0 if must is None else must, count - 1])


def best(
    positions: F64, curves: F64, count: int, least: float = 0.0, must: int | None = None
) -> NDArray[np.intp]:
    """Indices of at most `count` candidates with the least greatest interpolation error."""
    whole = _ends(len(positions), must)
    if len(positions) <= count and least <= 0.0:
        return np.arange(len(positions))
    worst = interpolation_error(positions, curves, positions[whole])
    low, high, chosen = 0.0, worst, whole
    for _ in range(_HALVINGS):
        if high - low <= 1e-9 * worst:
            break
        middle = 0.5 * (low + high)
        found = _path(allowed(positions, curves, middle, least, must))
        if found is not None and len(found) <= count:
            chosen, high = found, middle
        else:
            low = middle
    return chosen


def _path(good: Bool) -> NDArray[np.intp] | None:
    """The fewest steps from the first to the last candidate over allowed segments, if any."""
    m = len(good)
    steps = np.full(m, m + 1)
    steps[0] = 0
    came = np.zeros(m, dtype=np.intp)
    for j in range(1, m):
        reach = np.where(good[:j, j], steps[:j], m + 1)
        i = int(np.argmin(reach))
        if reach[i] <= m:
            steps[j], came[j] = reach[i] + 1, i
    if steps[-1] > m:
        return None
    found = [m - 1]
    while found[-1]:
        found.append(int(came[found[-1]]))
    return np.array(found[::-1])
