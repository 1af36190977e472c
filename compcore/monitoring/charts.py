"""Control charts of standardised residuals: EWMA and CUSUM with one stated rate of false alarms.

Each of m series (a place that is checked, in one direction) has an EWMA for what moves slowly and a
CUSUM for what jumps. How often a sound machine is accused is shared evenly among all of them: by
Bonferroni's inequality not more often than stated, however the series hang together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.monitoring.run_length import (
    cusum_limit,
    cusum_run_length,
    ewma_limit,
    ewma_run_length,
)

F64 = NDArray[np.float64]
ChartName = Literal["EWMA", "CUSUM"]


@dataclass(frozen=True, slots=True)
class ChartDesign:
    """What the charts of a machine's checks are made for.

    Attributes
    ----------
    false_alarm_every
        Checks in which a sound machine is accused once, at most, on average.
    weight
        Of the newest value in the EWMA.
    reference
        Of the CUSUM, in standard deviations: half the shift that it is made for.
    """

    false_alarm_every: float = 5000.0
    weight: float = 0.1
    reference: float = 1.0

    def limits(self, series: int) -> tuple[float, float]:
        """Limits of EWMA and CUSUM for so many series, in standard deviations.

        Raises
        ------
        ValueError
            Without a series, or for a rate that no limit has.
        """
        if series < 1:
            raise ValueError(f"{series} series: expected 1 or more")
        each = self.false_alarm_every * 2 * series
        return ewma_limit(self.weight, each), cusum_limit(self.reference, each)

    def detects_within(self, series: int, shift: float) -> float:
        """Mean number of checks until a shift of one series is signalled, that one included.

        The shorter of both charts' own; of both together it is no longer.

        Parameters
        ----------
        shift
            In standard deviations of that series.
        """
        ewma, cusum = self.limits(series)
        return min(
            ewma_run_length(self.weight, ewma, shift),
            cusum_run_length(self.reference, cusum, shift),
        )


@dataclass(frozen=True, slots=True)
class Alarm:
    """The first value beyond a chart's limit.

    Attributes
    ----------
    check
        Index of the check.
    series
        Index of the series.
    chart
        Which chart signalled it.
    sign
        1 where the values had risen, −1 where they had fallen.
    since
        Index of the check from which on the chart had been on that side.
    """

    check: int
    series: int
    chart: ChartName
    sign: int
    since: int


@dataclass(frozen=True, eq=False)
class Charts:
    """The course of all charts over n checks of m series.

    Attributes
    ----------
    values
        Standardised residuals, (n, m); NaN where a series was not read.
    ewma
        The EWMA in its own standard deviations, (n, m).
    upper, lower
        Sums of what lies above and below, (n, m), both 0 or more.
    ewma_limit, cusum_limit
        What |ewma|, and upper or lower, must not exceed.
    alarm
        The first, or None.
    """

    values: F64
    ewma: F64
    upper: F64
    lower: F64
    ewma_limit: float
    cusum_limit: float
    alarm: Alarm | None

    @property
    def fullness(self) -> F64:
        """How full each chart is, (n, m): 1 at the limit; the fuller of EWMA and CUSUM."""
        cusum = np.maximum(self.upper, self.lower) / self.cusum_limit
        return np.asarray(np.maximum(np.abs(self.ewma) / self.ewma_limit, cusum))


def charted(values: F64, design: ChartDesign) -> Charts:
    """Lead standardised residuals through the charts.

    Parameters
    ----------
    values
        (n, m), independent from check to check and of variance 1 on a sound machine; NaN where a
        series was not read: its charts stay as they are.
    design
        What the charts are made for.
    """
    n, m = values.shape
    ewma_edge, cusum_edge = design.limits(max(m, 1))
    spread = math.sqrt(design.weight / (2.0 - design.weight))
    mean, up, down = np.zeros((n, m)), np.zeros((n, m)), np.zeros((n, m))
    last = np.zeros(m), np.zeros(m), np.zeros(m)
    for i, row in enumerate(values):
        read = np.isfinite(row)
        z = np.where(read, row, 0.0)
        mean[i] = np.where(read, last[0] + design.weight * (z - last[0]), last[0])
        up[i] = np.where(read, np.maximum(last[1] + z - design.reference, 0.0), last[1])
        down[i] = np.where(read, np.maximum(last[2] - z - design.reference, 0.0), last[2])
        last = mean[i], up[i], down[i]
    ewma = mean / spread
    alarm = _first(ewma / ewma_edge, up / cusum_edge, down / cusum_edge)
    return Charts(values, ewma, up, down, ewma_edge, cusum_edge, alarm)


def _first(ewma: F64, upper: F64, lower: F64) -> Alarm | None:
    """The first alarm, of the fullest chart where several tell at once; all in their limits."""
    sides: tuple[tuple[F64, ChartName, int], ...] = (
        (upper, "CUSUM", 1),
        (lower, "CUSUM", -1),
        (ewma, "EWMA", 1),
        (-ewma, "EWMA", -1),
    )
    full = np.stack([side for side, _, _ in sides])
    beyond = np.flatnonzero((full > 1.0).any(axis=(0, 2)))
    if not beyond.size:
        return None
    check = int(beyond[0])
    k, series = divmod(int(full[:, check].argmax()), full.shape[2])
    course, chart, sign = sides[k]
    away = np.flatnonzero(course[: check + 1, series] <= 0.0)
    return Alarm(check, series, chart, sign, int(away[-1]) + 1 if away.size else 0)
