"""What each check is expected to read after all checks before it: residuals that are independent.

The model's parameters are uncertain, and their errors are the same in every check: a prediction
that is 3 µm off on the first day is 3 µm off on all days, and nothing has changed. Likewise the
place of a sphere that nobody calibrated, and what the model's shapes leave over at a place. These
unknowns are followed by a Kalman filter from check to check; what a check reads beyond what was
expected of it, in units of how sure that was, is independent of all checks before (the innovations:
Kailath, IEEE Transactions on Automatic Control 13 (1968), 646; without a model recursive residuals:
Brown, Durbin, Evans, Journal of the Royal Statistical Society B 37 (1975), 149). So charts keep
their rate of false alarms from the first check on, and no period of calibration is needed.

Length in µm, angles in µrad throughout.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.fitting.design.nuisance import SetupNuisances
from abbe.compcore.linalg import threads_for
from abbe.compcore.monitoring.readings import CheckReadings
from abbe.compcore.monitoring.scatter import DAY, HYPOTHESES, Weighing, quantiles

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_SEASON = 60.0 * DAY
"""s after which what the model leaves over at a place is another: it hangs on the season."""
_WANDERS = 0.5
"""Of what the fit left over: standard deviation of that wandering."""
_APART = 10.0
"""Of reading and fit together: how far all of a series may lie from its prediction. A model that is
wrong at a place from the first check on is no machine that has changed; it is said apart."""
_ANYWHERE = 1e4
"""µm or µrad: standard deviation of what nothing is known of."""
WILD = 3.5
"""Standard deviations beyond which a reading counts no more than that on a chart, and where a
series stands is not learned from it: a chip on the sphere is no changed machine. A changed machine
reads so again."""
_NEGLIGIBLE = 1e-3
"""Of the smallest uncertainty: combinations of parameters that move no reading by more."""


@dataclass(frozen=True, eq=False)
class ExpectedChecks:
    """Checks beside what was expected of them.

    Attributes
    ----------
    standardised
        Shape (checks, series): independent from check to check and standard normal as long as the
        machine is sound; NaN where a series was not read.
    surprise, sd
        What was read beyond what was expected, and its standard deviation, µm or µrad.
    """

    standardised: F64
    surprise: F64
    sd: F64

    @property
    def charted(self) -> F64:
        """The standardised values as charts take them, none beyond `WILD`, (checks, series)."""
        return np.clip(self.standardised, -WILD, WILD)


def expect(readings: CheckReadings) -> ExpectedChecks:
    """Follow the checks in order of time."""
    count, m = len(readings.times), len(readings.series)
    filters = _Filters(readings)
    weighing = Weighing(m)
    shape = (count, m)
    out = ExpectedChecks(*(np.full(shape, np.nan) for _ in range(3)))
    with threads_for(0):
        for check in range(count):
            rows = np.flatnonzero(readings.check == check)
            seen = filters.gathered(readings, rows)
            filters.pass_time(readings.times[check])
            ahead, spread = filters.ahead(seen)
            sd = np.sqrt(spread)
            z = ahead / sd
            at = check, seen.series
            weights = weighing.weights()[:, seen.series]
            out.standardised[at] = quantiles(weights, z)
            out.surprise[at] = (weights * ahead).sum(axis=0)
            square = (weights * (spread + ahead**2)).sum(axis=0)
            out.sd[at] = np.sqrt(square - out.surprise[at] ** 2)
            likely = np.abs(out.standardised[at]) < WILD
            weighing.learn(seen.series, z, sd)
            filters.take_in(likely)
    return out


@dataclass(frozen=True, eq=False)
class _Gathered:
    """The readings of one check, one for each of k series.

    `value` and `variance` (k,) of the measurement; `state` (k, d) what the filters' unknowns do to
    them; `free` (k, f) what is unknown in this check only.
    """

    series: Index
    value: F64
    variance: F64
    state: F64
    free: F64


class _Filters:
    """One Kalman filter for each hypothesis of scatter, all stepped at once.

    The unknowns: errors of the parameters, placings of instruments that stay, and for each series
    what the model leaves over there and how far the machine deviates at the time.
    """

    def __init__(self, readings: CheckReadings) -> None:
        m = len(readings.series)
        influence = _few(readings.influence, readings.sd)
        stays, self._passing = _placings(readings)
        # columns of everything that is the same in every check, row by row
        self._steady = np.hstack([influence, stays, np.eye(m)[readings.of]])
        self._m, self._fixed = m, self._steady.shape[1]
        size = self._fixed + 2 * m
        usual = np.array([np.median(readings.sd[readings.of == k]) for k in range(m)])
        times = np.array([h.times for h in HYPOTHESES])
        self._more = np.array([1.0 + h.more**2 for h in HYPOTHESES])
        self._lasts = np.array([h.lasts for h in HYPOTHESES])
        self._deviates = (times[:, None] * usual) ** 2
        self._wanders = (_WANDERS * readings.left_over) ** 2
        self._x = np.zeros((len(HYPOTHESES), size))
        self._p = np.zeros((len(HYPOTHESES), size, size))
        apart = (_APART * np.hypot(usual, readings.left_over)) ** 2
        free = np.full(stays.shape[1], _ANYWHERE**2)
        diagonal = np.concatenate([np.ones(influence.shape[1]), free, apart, self._wanders])
        at = np.arange(self._fixed + m)
        self._p[:, at, at] = diagonal
        at = np.arange(self._fixed + m, size)
        self._p[:, at, at] = self._deviates
        self._time: float | None = None

    def gathered(self, readings: CheckReadings, rows: Index) -> _Gathered:
        """The readings of some rows, each series' own averaged."""
        series, of = np.unique(readings.of[rows], return_inverse=True)
        of = of.reshape(-1)
        weight = 1.0 / readings.sd[rows] ** 2
        mean = np.zeros((len(series), len(rows)))
        mean[of, np.arange(len(rows))] = weight
        total = mean.sum(axis=1)
        mean /= total[:, None]
        own = np.zeros((len(series), 2 * self._m))
        own[np.arange(len(series)), series] = 1.0
        own[np.arange(len(series)), self._m + series] = 1.0
        passing = [block for block in self._passing if np.isin(block.rows, rows).any()]
        free = np.zeros((len(rows), sum(b.columns.shape[1] for b in passing)))
        first = 0
        place = np.full(len(readings.check), -1)
        place[rows] = np.arange(len(rows))
        for block in passing:
            width = block.columns.shape[1]
            free[place[block.rows], first : first + width] = block.columns
            first += width
        return _Gathered(
            series,
            mean @ readings.residual[rows],
            1.0 / total,
            np.hstack([mean @ self._steady[rows], own]),
            mean @ free,
        )

    def pass_time(self, now: float) -> None:
        """Let what changes by itself change until a check (s)."""
        if self._time is not None:
            gone = max(0.0, now - self._time)
            with np.errstate(divide="ignore"):
                stays = np.where(self._lasts > 0.0, np.exp(-gone / self._lasts), 0.0)
            keep = np.ones(self._x.shape)
            keep[:, self._fixed : self._fixed + self._m] = np.exp(-gone / _SEASON)
            keep[:, self._fixed + self._m :] = stays[:, None]
            self._x *= keep
            self._p *= keep[:, :, None] * keep[:, None, :]
            new = 1.0 - keep[:, self._fixed :] ** 2
            wide = np.hstack([np.tile(self._wanders, (len(new), 1)), self._deviates])
            at = np.arange(self._fixed, self._x.shape[1])
            self._p[:, at, at] += new * wide
        self._time = now

    def ahead(self, seen: _Gathered) -> tuple[F64, F64]:
        """What a check reads beyond what was expected, (g, k), and its variance."""
        self._across = self._p @ seen.state.T
        known = seen.state @ self._across
        at = np.arange(len(seen.series))
        known[:, at, at] += self._more[:, None] * seen.variance
        self._spread = known + _ANYWHERE**2 * (seen.free @ seen.free.T)
        self._beyond = seen.value - self._x @ seen.state.T
        return self._beyond, np.diagonal(self._spread, axis1=1, axis2=2)

    def take_in(self, likely: NDArray[np.bool_]) -> None:
        """Learn the unknowns from what is likely (k,) of the check that was looked at last."""
        self._spread[:, np.arange(len(likely)), np.arange(len(likely))] += np.where(
            likely, 0.0, _ANYWHERE**2
        )
        gain = np.swapaxes(np.linalg.solve(self._spread, np.swapaxes(self._across, 1, 2)), 1, 2)
        self._x += (gain @ self._beyond[:, :, None])[:, :, 0]
        self._p -= gain @ np.swapaxes(self._across, 1, 2)
        self._p = 0.5 * (self._p + np.swapaxes(self._p, 1, 2))


def _few(influence: F64, sd: F64) -> F64:
    """The same influence by as few independent unknowns as the readings tell apart, (n, q)."""
    if not influence.size:
        return influence
    values, vectors = np.linalg.eigh(influence.T @ influence)
    keep = values > (_NEGLIGIBLE * float(sd.min())) ** 2
    return np.asarray(influence @ vectors[:, keep])


def _placings(readings: CheckReadings) -> tuple[F64, list[SetupNuisances]]:
    """Columns (n, z) of placings that several checks share; the others, of one check each."""
    stays: list[F64] = []
    passing: list[SetupNuisances] = []
    for block in readings.placings:
        size = np.abs(block.columns).max(axis=0)
        unit = replace(block, columns=block.columns / np.where(size > 0.0, size, 1.0))
        if len(np.unique(readings.check[block.rows])) == 1:
            passing.append(unit)
            continue
        columns = np.zeros((len(readings.check), unit.columns.shape[1]))
        columns[block.rows] = unit.columns
        stays.append(columns)
    return np.hstack([np.zeros((len(readings.check), 0)), *stays]), passing
