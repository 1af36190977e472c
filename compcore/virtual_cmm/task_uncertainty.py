"""The uncertainty of a measuring task: intervals, bias and budget out of many draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.virtual_cmm.features import PartCharacteristic
from abbe.compcore.virtual_cmm.simulation import MeasuredBlock, VirtualMeasurement

F64 = NDArray[np.float64]

COVERAGE = 0.95
_GROUPS = 10
"""Groups of draws from whose scatter it is known how sure the interval is itself."""
_BINS = 60


@dataclass(frozen=True, eq=False)
class TaskDistribution:
    """Where the measured less the true value lies, mm (angles: rad).

    Attributes
    ----------
    bias, sd
        Mean and standard deviation of the draws.
    low, high
        The interval that holds 95 % of them, as many beyond either end.
    of_draws
        Standard uncertainty of `expanded` by the number of draws.
    edges, counts
        A histogram.
    """

    bias: float
    sd: float
    low: float
    high: float
    of_draws: float
    edges: F64
    counts: NDArray[np.int64]

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U, 95 %: half of the interval's width."""
        return 0.5 * (self.high - self.low)

    @property
    def most(self) -> float:
        """The farthest end of the interval: what is to be reckoned with where nothing corrects."""
        return max(abs(self.low), abs(self.high))


@dataclass(frozen=True, slots=True)
class CauseInBudget:
    """One cause's part of a characteristic's uncertainty.

    Attributes
    ----------
    cause
        An effect, or what else errs.
    alone
        Root of the mean square that it makes alone, mm (angles: rad).
    share
        Its part of the variance, 1 = all: covariance with the whole; negative where it takes off
        what another adds. None for form and position, which are no sums.
    """

    cause: str
    alone: float
    share: float | None


@dataclass(frozen=True, eq=False)
class TaskUncertainty:
    """One characteristic's uncertainty, with and without correction."""

    characteristic: PartCharacteristic
    nominal: float
    corrected: TaskDistribution
    uncorrected: TaskDistribution
    budget: tuple[CauseInBudget, ...]


def gathered(
    measurement: VirtualMeasurement, blocks: Sequence[MeasuredBlock]
) -> tuple[TaskUncertainty, ...]:
    """The uncertainties of all characteristics, out of all blocks in their order."""
    corrected = np.concatenate([b.corrected for b in blocks])
    uncorrected = np.concatenate([b.uncorrected for b in blocks])
    alone = np.concatenate([b.alone for b in blocks])
    whole = np.concatenate([b.corrected[: len(b.alone)] for b in blocks])
    found = []
    for c, one in enumerate(measurement.program.characteristics):
        budget = _budget(measurement.causes, alone[:, :, c], whole[:, c], one)
        found.append(
            TaskUncertainty(
                one,
                float(measurement.true[c]),
                distribution(corrected[:, c]),
                distribution(uncorrected[:, c]),
                budget,
            )
        )
    return tuple(found)


def distribution(values: F64) -> TaskDistribution:
    """Describe draws of one figure, shape (d,)."""
    low, high = _interval(values)
    each = [np.subtract(*_interval(g)[::-1]) / 2.0 for g in np.array_split(values, _GROUPS)]
    counts, edges = np.histogram(values, _BINS)
    return TaskDistribution(
        float(values.mean()),
        float(values.std(ddof=1)),
        low,
        high,
        float(np.std(each, ddof=1) / np.sqrt(_GROUPS)),
        edges,
        counts,
    )


def _interval(values: F64) -> tuple[float, float]:
    beyond = 0.5 * (1.0 - COVERAGE)
    low, high = np.quantile(values, [beyond, 1.0 - beyond])
    return float(low), float(high)


def _budget(
    causes: Sequence[str], alone: F64, whole: F64, one: PartCharacteristic
) -> tuple[CauseInBudget, ...]:
    rows: list[CauseInBudget] = []
    variance = float(np.var(whole))
    for g, cause in enumerate(causes):
        size = float(np.sqrt(np.mean(alone[:, g] ** 2)))
        share = None
        if not one.one_sided and variance > 0.0:
            share = float(np.mean((alone[:, g] - alone[:, g].mean()) * (whole - whole.mean())))
            share /= variance
        rows.append(CauseInBudget(cause, size, share))
    return tuple(sorted(rows, key=lambda r: -(r.alone if r.share is None else abs(r.share))))


def greatest(found: Sequence[TaskUncertainty]) -> Mapping[str, float]:
    """Cause → its greatest part, alone, of any characteristic's standard uncertainty, 1 = all."""
    most: dict[str, float] = {}
    for task in found:
        for row in task.budget:
            if task.corrected.sd > 0.0:
                part = row.alone / task.corrected.sd
                most[row.cause] = max(most.get(row.cause, 0.0), part)
    return dict(sorted(most.items(), key=lambda item: -item[1]))
