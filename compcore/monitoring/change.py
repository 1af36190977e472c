"""What has changed in a machine that its checks accuse: since when, where, growing with what.

The checks before and after are laid side by side. Which moment, and whether at once or ever more,
is what explains most of the difference; which component, and growing with which axis or signal, is
the least that explains it (Schwarz's criterion). This is a description and no cause: causes are
`abbe diagnose`'s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.linalg import svd, threads_for
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.monitoring.charts import Alarm
from abbe.compcore.monitoring.expected import ExpectedChecks
from abbe.compcore.monitoring.readings import CheckReadings

F64 = NDArray[np.float64]
Course = Literal["at once", "ever more"]

_EARLIER = 15
"""Checks before a chart began to move: so much earlier the change may have begun."""
_MOST = 3
"""Patterns that are named."""
_WORTH = 0.05
"""Of all that is to be explained: a pattern that explains less is not named."""
_FEWEST = 5
"""Checks since the change from which on it may hang on a signal."""
_RISING = 3
"""Checks that show whether something grows ever more."""
_STILL = 0.05
"""Of a signal's unit: one that varied by less was constant."""


@dataclass(frozen=True, slots=True)
class ChangePattern:
    """One part of what has changed.

    Attributes
    ----------
    component
        ``X``, ``Y``, ``Z``, or ``A``, ``B``, ``C`` for rotations about these.
    along
        The axis or signal with which it grows; empty: it is the same everywhere.
    constant, constant_sd
        In the middle of what was read, µm or µrad: after the change, or by the last check.
    slope, slope_sd
        Per mm, degree, or unit of the signal; 0 without `along`.
    unit
        Of `along`: mm, degree or the signal's.
    """

    component: str
    along: str
    constant: float
    constant_sd: float
    slope: float = 0.0
    slope_sd: float = 0.0
    unit: str = ""


@dataclass(frozen=True)
class MachineChange:
    """How a machine has changed since an earlier check.

    Attributes
    ----------
    last_sound, first_changed
        Indices of the checks between which it happened, or from which on it grew.
    course
        Whether it happened at once, or grows ever more.
    patterns
        The least that describes it, the largest first; empty where nothing simple does.
    explained
        Part of the difference that they describe, 0 … 1.
    largest
        Index of the series that changed most, in its standard deviations.
    """

    last_sound: int
    first_changed: int
    course: Course
    patterns: tuple[ChangePattern, ...]
    explained: float
    largest: int


def machine_change(
    readings: CheckReadings, expected: ExpectedChecks, alarm: Alarm
) -> MachineChange:
    """Describe the change that a chart has signalled, by all checks until the last one.

    Parameters
    ----------
    readings
        All checks.
    expected
        What was expected of them: how sure each series' readings are.
    alarm
        Which chart signalled it, at which check.
    """
    table = _Table(readings, expected)
    rows = readings.of == alarm.series
    with threads_for(0):
        own = np.eye(len(readings.series))[readings.of]
        moments = range(max(1, alarm.since - _EARLIER), alarm.check + 1)
        first, course, _ = _moment(table, moments, own)
        chosen = _patterns(table, table.course(first, course), rows)
        if chosen:
            # what it is tells better when it began
            shapes = np.hstack([c.shape for c in chosen])
            first, course, _ = _moment(table, moments, shapes)
            chosen = _patterns(table, table.course(first, course), rows)
        grown = table.course(first, course)
        whole, moved, covariance = _explained(table.project(own * grown[:, None]), table.y)
        patterns, fall = _estimated(table, grown, chosen)
    size = np.abs(moved) / np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return MachineChange(
        first - 1,
        first,
        course,
        patterns,
        min(1.0, fall / max(whole, 1e-300)),
        int(size.argmax()),
    )


class _Table:
    """Readings of all checks with what does not change taken out: weighted, projected."""

    def __init__(self, readings: CheckReadings, expected: ExpectedChecks) -> None:
        self.readings = readings
        m = len(readings.series)
        # late checks are the surest of how far a series scatters
        known = [expected.sd[np.isfinite(expected.sd[:, k]), k] for k in range(m)]
        spread = np.array([np.median(sd[len(sd) // 2 :]) for sd in known])
        repeats = np.ones(len(readings.check))
        key = readings.check * m + readings.of
        _, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
        repeats = count[inverse.reshape(-1)]
        self.weight = 1.0 / (spread[readings.of] * np.sqrt(repeats))
        steady = [np.eye(m)[readings.of]]
        for block in readings.placings:
            columns = np.zeros((len(readings.check), block.columns.shape[1]))
            columns[block.rows] = block.columns
            steady.append(columns)
        self._basis = _span(np.hstack(steady) * self.weight[:, None])
        self.y = self.project(readings.residual)

    def project(self, columns: F64) -> F64:
        """Columns, (n,) or (n, k), in standard deviations and without what stays the same."""
        weighted = columns * (self.weight if columns.ndim == 1 else self.weight[:, None])
        return np.asarray(weighted - self._basis @ (self._basis.T @ weighted))

    def course(self, first: int, course: Course) -> F64:
        """How far the change has gone at each row, (n,): 1 at its end."""
        check = self.readings.check
        if course == "at once":
            return np.asarray((check >= first).astype(np.float64))
        times = self.readings.times
        gone = times[check] - times[first - 1]
        return np.asarray(np.clip(gone / max(times[-1] - times[first - 1], 1.0), 0.0, None))


def _span(columns: F64) -> F64:
    u, s, _ = svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
    return u[:, s > 1e-9 * s[0]]


def _explained(columns: F64, y: F64) -> tuple[float, F64, F64]:
    """The fall of χ² by projected columns (n, k), their coefficients and covariance."""
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 1e-9, size, np.inf)
    u, s, vt = svd(columns / size)
    keep = s > 1e-6
    seen = u[:, keep].T @ y
    inverse = vt[keep].T / s[keep]
    coefficients = inverse @ seen / size
    covariance = (inverse @ inverse.T) / np.outer(size, size)
    return float(seen @ seen), coefficients, covariance


def _moment(table: _Table, moments: range, shapes: F64) -> tuple[int, Course, float]:
    """The first changed check and how it went on, of what has these shapes (n, k); fall of χ²."""
    last = len(table.readings.times)
    courses: tuple[Course, ...] = ("at once", "ever more")
    tried = [
        (_explained(table.project(shapes * table.course(m, c)[:, None]), table.y)[0], m, c)
        for m in moments
        for c in courses
        if c == "at once" or last - m >= _RISING
    ]
    if not tried:
        raise ValueError("there is only one check: nothing can have changed since")
    fall, first, course = max(tried, key=lambda t: t[0])
    return first, course, fall


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A pattern that is tried: its shape (n, 1) or (n, 2), constant first, then the slope."""

    component: str
    along: str
    unit: str
    shape: F64


def _candidates(table: _Table, grown: F64) -> Iterator[_Candidate]:
    readings = table.readings
    campaign = readings.campaign
    c = campaign.conditions
    if c.u is None:
        return
    after = grown > 0.0
    rotation = campaign.kind == Kind.ROTATION
    checks = len(np.unique(readings.check[after]))
    for k, name in enumerate("XYZABC"):
        seen = np.where(rotation == (k > 2), c.u[:, k % 3], 0.0)
        rows = after & (np.abs(seen) > 0.0)
        if not rows.any():
            continue
        yield _Candidate(name, "", "", seen[:, None])
        beside: list[tuple[str, F64, str]] = [
            (axis, np.degrees(q), "degree") if is_rotary(axis) else (axis, q, "mm")
            for axis, q in c.positions.items()
            if len(np.unique(readings.of[rows])) > 1
        ]
        if checks >= _FEWEST:
            beside += [(name, values, "") for name, values in c.signals.items()]
        for along, values, unit in beside:
            spread = float(np.std(values[rows]))
            if spread > (_STILL if not unit else 1.0):
                slope = seen * (values - float(np.mean(values[rows])))
                yield _Candidate(name, along, unit, np.stack([seen, slope], axis=1))


def _patterns(table: _Table, grown: F64, accusing: NDArray[np.bool_]) -> list[_Candidate]:
    """The least set of patterns that describes a change of a known course (n,).

    The first is of a component that the accusing series reads, the rows `accusing` (n,).
    """
    own = np.eye(len(table.readings.series))[table.readings.of] * grown[:, None]
    whole = _explained(table.project(own), table.y)[0]
    price = math.log(max(2, int((grown > 0.0).sum())))
    tried = [(c, table.project(c.shape * grown[:, None])) for c in _candidates(table, grown)]
    # the best of many is good by chance
    choice = 2.0 * math.log(max(1, len(tried)))
    chosen: list[tuple[_Candidate, F64]] = []
    fall = 0.0
    while len(chosen) < _MOST:
        best: tuple[float, float, tuple[_Candidate, F64]] | None = None
        for one in tried:
            if not chosen and not np.abs(one[1][accusing]).max() > 0.0:
                continue
            found = _explained(np.hstack([*(c for _, c in chosen), one[1]]), table.y)[0]
            value = found - fall - price * one[1].shape[1] - choice
            if best is None or value > best[0]:
                best = value, found, one
        if best is None or best[0] <= 0.0 or best[1] - fall < _WORTH * whole:
            break
        chosen.append(best[2])
        fall = best[1]
    return [c for c, _ in chosen]


def _estimated(
    table: _Table, grown: F64, chosen: Sequence[_Candidate]
) -> tuple[tuple[ChangePattern, ...], float]:
    """Patterns with their sizes, and the fall of χ² by them."""
    if not chosen:
        return (), 0.0
    columns = table.project(np.hstack([c.shape for c in chosen]) * grown[:, None])
    fall, values, covariance = _explained(columns, table.y)
    return tuple(_named(chosen, values, covariance)), fall


def _named(chosen: Sequence[_Candidate], values: F64, covariance: F64) -> Iterator[ChangePattern]:
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    at = 0
    for one in chosen:
        width = one.shape.shape[1]
        pairs = [(float(values[i]), float(sd[i])) for i in range(at, at + width)]
        slope = pairs[1] if width > 1 else (0.0, 0.0)
        yield ChangePattern(one.component, one.along, *pairs[0], *slope, one.unit)
        at += width
