"""Accuracy and repeatability of positioning of one axis, ISO 230-2, from a campaign's set-ups.

Clause numbers are those of ISO 230-2:2006; the edition of 2014 keeps the formulas and says 'error'
where that of 2006 says 'deviation' or 'value'. x_ij = P_ij − P_i, actual minus target, is a
campaign's value as it stands (error = actual − indicated).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.repeats import SAME_ANGLE, SAME_POSITION, approach
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.sentences import said

F64 = NDArray[np.float64]

STANDARD_RUNS = 5
"""Runs in each direction that ISO 230-2, 4.3.2 asks for (axes up to 2 m)."""
STANDARD_TARGETS = 5
"""Least number of target positions (ISO 230-2, 4.3.2: five per metre and at least five)."""
_ALONG = 0.9999
"""Least |u · direction of the axis| of a positioning measurement: a cosine error of 1e-4."""


@dataclass(frozen=True, eq=False)
class Runs:
    """The readings of one positioning test: targets, approaches, directions (ISO 230-2).

    Attributes
    ----------
    setup, axis, unit
        The set-up, the axis that moved, and ``mm`` or ``rad``.
    targets
        Shape (m,), mm or rad, ascending.
    up, down
        Shape (m, n): errors of run j at target i, approached upwards and downwards, mm or rad; NaN
        where that run did not stop there.
    """

    setup: str
    axis: str
    unit: str
    targets: F64
    up: F64
    down: F64


@dataclass(frozen=True, eq=False)
class PositioningResult:
    """The results of a positioning test by ISO 230-2: A, R, B, E, M, mm or rad; None: unknown.

    Attributes
    ----------
    runs
        The readings.
    mean_up, mean_down
        x̄_i↑, x̄_i↓: mean unidirectional error at a target (2.10), shape (m,).
    mean
        x̄_i = (x̄_i↑ + x̄_i↓)/2 (2.11), shape (m,).
    reversal
        B_i = x̄_i↑ − x̄_i↓ (2.12), shape (m,).
    s_up, s_down
        s_i: estimator of the standard uncertainty of unidirectional repeatability,
        √(Σ_j (x_ij − x̄_i)²/(n − 1)) (2.15), shape (m,).
    repeatability_up, repeatability_down
        R_i↑ = 4 s_i↑, R_i↓ = 4 s_i↓ (2.16), shape (m,).
    repeatability
        R_i = max(2 s_i↑ + 2 s_i↓ + |B_i|; R_i↑; R_i↓) (2.17), shape (m,).
    B, B_mean
        Reversal of the axis max |B_i| (2.13) and its mean ΣB_i/m (2.14).
    R, R_up, R_down
        Greatest R_i, R_i↑, R_i↓ (2.18).
    E_up, E_down
        Unidirectional systematic error, max x̄_i − min x̄_i (2.19).
    E
        Bidirectional systematic error, max(x̄_i↑; x̄_i↓) − min(x̄_i↑; x̄_i↓) (2.20).
    M
        Range of the mean bidirectional error, max x̄_i − min x̄_i (2.21).
    A_up, A_down
        Unidirectional accuracy, max(x̄_i + 2 s_i) − min(x̄_i − 2 s_i) (2.22).
    A
        Bidirectional accuracy, max(x̄_i↑ + 2 s_i↑; x̄_i↓ + 2 s_i↓) −
        min(x̄_i↑ − 2 s_i↑; x̄_i↓ − 2 s_i↓) (2.23).
    notes
        In what the test falls short of the standard's.
    """

    runs: Runs
    mean_up: F64
    mean_down: F64
    mean: F64
    reversal: F64
    s_up: F64
    s_down: F64
    repeatability_up: F64
    repeatability_down: F64
    repeatability: F64
    B: float | None
    B_mean: float | None
    R: float | None
    R_up: float | None
    R_down: float | None
    E: float | None
    E_up: float | None
    E_down: float | None
    M: float | None
    A: float | None
    A_up: float | None
    A_down: float | None
    notes: tuple[str, ...]


RESULTS = ("A", "A_up", "A_down", "R", "R_up", "R_down", "E", "E_up", "E_down", "M", "B", "B_mean")
"""The results of an axis, in the order in which ISO 230-2 tabulates them."""


def positioning_runs(campaign: Campaign, machine: Machine) -> list[Runs]:
    """The positioning tests of a campaign: its set-ups along one axis.

    That is: of one linear axis its displacement along its own direction, of one rotary axis its
    rotation about its own axis, at more than one target, nothing else moving.
    """
    setup = campaign.conditions.setup
    if setup is None:
        return []
    found = []
    for name in campaign.setups:
        rows = np.flatnonzero(setup == name)
        axis = _only_mover(campaign, rows)
        if axis is not None and (sign := _sign(campaign, machine, axis, rows)) is not None:
            found.append(_runs(campaign, name, axis, rows, sign))
    return found


def _only_mover(campaign: Campaign, rows: NDArray[np.int64]) -> str | None:
    moving = [
        axis
        for axis, q in campaign.conditions.positions.items()
        if np.ptp(q[rows]) > (SAME_ANGLE if is_rotary(axis) else SAME_POSITION)
    ]
    return moving[0] if len(moving) == 1 else None


def _sign(campaign: Campaign, machine: Machine, axis: str, rows: NDArray[np.int64]) -> F64 | None:
    """±1 for each row by the sense of u; None when the rows measure something else."""
    u = campaign.conditions.u
    wanted = Kind.ROTATION if machine.axes[axis].rotary else Kind.DISPLACEMENT
    if u is None or (campaign.kind[rows] != wanted).any():
        return None
    along = u[rows] @ np.array(machine.axes[axis].direction)
    return np.sign(along) if (np.abs(along) > _ALONG).all() else None


def _runs(campaign: Campaign, name: str, axis: str, rows: NDArray[np.int64], sign: F64) -> Runs:
    c = campaign.conditions
    order = np.argsort(c.time[rows], kind="stable")
    rows, sign = rows[order], sign[order]
    step = SAME_ANGLE if is_rotary(axis) else SAME_POSITION
    error, sense = campaign.value[rows] * sign, approach(campaign, axis)[rows]
    unit = "rad" if is_rotary(axis) else "mm"
    return tabulate(name, axis, unit, c.positions[axis][rows], error, sense, step)


def tabulate(
    setup: str,
    axis: str,
    unit: str,
    position: F64,
    error: F64,
    sense: NDArray[np.int64],
    step: float,
) -> Runs:
    """Readings in the order of time, sorted into targets, approaches and directions.

    Positions (n,) less than `step` (mm or rad) apart are one target; `sense` (n,) is 1 upwards,
    −1 downwards.
    """
    order = np.argsort(position, kind="stable")
    at = np.empty(len(position), dtype=np.int64)
    at[order] = np.cumsum(np.r_[0, np.diff(position[order]) > step])
    targets = np.bincount(at, position) / np.bincount(at)
    tables = []
    for direction in (1, -1):
        mine = np.flatnonzero(sense == direction)
        run = _count_before(at[mine])
        table = np.full((len(targets), int(run.max()) + 1 if len(run) else 0), np.nan)
        table[at[mine], run] = error[mine]
        tables.append(table)
    return Runs(setup, axis, unit, targets, *tables)


def _count_before(codes: NDArray[np.int64]) -> NDArray[np.int64]:
    """How often each element has occurred before it."""
    order = np.argsort(codes, kind="stable")
    ordered = codes[order]
    start = np.searchsorted(ordered, ordered)
    count = np.empty(len(codes), dtype=np.int64)
    count[order] = np.arange(len(codes)) - start
    return count


def evaluate_positioning(runs: Runs) -> PositioningResult:
    """Evaluate one positioning test by ISO 230-2; formulas at `PositioningResult`.

    Targets that only one direction visited count for that direction's results alone. With a single
    reading s_i is not known, and neither are A and R.
    """
    mean_up, s_up = _mean_and_deviation(runs.up)
    mean_down, s_down = _mean_and_deviation(runs.down)
    reversal = mean_up - mean_down
    mean = 0.5 * (mean_up + mean_down)
    r_up, r_down = 4.0 * s_up, 4.0 * s_down
    both = 2.0 * s_up + 2.0 * s_down + np.abs(reversal)
    repeatability = np.maximum(both, np.maximum(r_up, r_down))
    means = np.r_[mean_up, mean_down]
    high = np.r_[mean_up + 2.0 * s_up, mean_down + 2.0 * s_down]
    low = np.r_[mean_up - 2.0 * s_up, mean_down - 2.0 * s_down]
    m = len(runs.targets)
    twice = bool(np.isfinite(reversal).any())
    known = np.isfinite(repeatability)
    return PositioningResult(
        runs=runs,
        mean_up=mean_up,
        mean_down=mean_down,
        mean=mean,
        reversal=reversal,
        s_up=s_up,
        s_down=s_down,
        repeatability_up=r_up,
        repeatability_down=r_down,
        repeatability=repeatability,
        B=_greatest(np.abs(reversal)),
        B_mean=float(np.nanmean(reversal)) if twice else None,
        R=_greatest(repeatability) if (known == np.isfinite(reversal)).all() else None,
        R_up=_greatest(r_up),
        R_down=_greatest(r_down),
        E=_range(means, means) if twice else None,
        E_up=_range(mean_up, mean_up),
        E_down=_range(mean_down, mean_down),
        M=_range(mean, mean),
        A=_range(high, low) if twice and _known(s_up, s_down, mean_up, mean_down) else None,
        A_up=_range(high[:m], low[:m]),
        A_down=_range(high[m:], low[m:]),
        notes=tuple(_notes(runs)),
    )


def _known(s_up: F64, s_down: F64, mean_up: F64, mean_down: F64) -> bool:
    """Whether every mean that counts has its standard deviation."""
    return bool(
        (np.isfinite(s_up) == np.isfinite(mean_up)).all()
        and (np.isfinite(s_down) == np.isfinite(mean_down)).all()
    )


def _mean_and_deviation(readings: F64) -> tuple[F64, F64]:
    """Mean and standard deviation of each row, shape (m,); NaN with too few readings."""
    n = np.isfinite(readings).sum(axis=1)
    total = np.nansum(readings, axis=1)
    mean = np.divide(total, n, out=np.full(len(n), np.nan), where=n > 0)
    square = np.nansum((readings - mean[:, None]) ** 2, axis=1)
    variance = np.divide(square, n - 1, out=np.full(len(n), np.nan), where=n > 1)
    return mean, np.sqrt(variance)


def _greatest(values: F64) -> float | None:
    return float(np.nanmax(values)) if np.isfinite(values).any() else None


def _range(high: F64, low: F64) -> float | None:
    if not np.isfinite(high).any():
        return None
    return float(np.nanmax(high) - np.nanmin(low))


def _notes(runs: Runs) -> Sequence[str]:
    notes = []
    for name, table in ((said("towards plus"), runs.up), (said("towards minus"), runs.down)):
        n = int(np.isfinite(table).sum(axis=1).max(initial=0))
        if n == 0:
            notes.append(said("not measured {way}", way=name))
        elif n == 1:
            notes.append(
                said("1 run {way}, the standard asks for {all}", way=name, all=STANDARD_RUNS)
            )
        elif n < STANDARD_RUNS:
            notes.append(
                said(
                    "{n} runs {way}, the standard asks for {all}", n=n, way=name, all=STANDARD_RUNS
                )
            )
        if n and (np.isfinite(table).sum(axis=1) != n).any():
            notes.append(said("not every target was read in every run {way}", way=name))
    if len(runs.targets) < STANDARD_TARGETS:
        notes.append(
            said(
                "{n} targets, the standard asks for at least {all}",
                n=len(runs.targets),
                all=STANDARD_TARGETS,
            )
        )
    return notes
