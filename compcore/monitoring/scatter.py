"""How checks of a sound machine may scatter: a few hypotheses, weighed by the checks themselves.

The stated uncertainty of a reading says what scatters within a check. From check to check more
does: the probe is qualified anew, the artefact is as warm as it is, the morning is colder than the
evening. How much, and for how long it lasts, nobody knows beforehand; it differs from place to
place, and differs again from what is stated. So each series begins with all hypotheses, and its
checks weigh them (Bayes). What is then expected of the next check is their mixture, with the
broad tails that little knowledge has.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

DAY = 86400.0


class Scatter(NamedTuple):
    """One hypothesis.

    Attributes
    ----------
    times
        Standard deviation from check to check, as a multiple of the stated one of a reading.
    lasts
        Time after which a deviation has fallen to 1/e, s; 0: the next check has a new one.
    chance
        Before the first check.
    more
        Standard deviation of what is new in every check and lasts no longer, beyond the stated one
        of a reading, as a multiple of it.
    """

    times: float
    lasts: float
    chance: float
    more: float = 0.0


_TIMES = {0.0: 0.1, 0.5: 0.1, 1.0: 0.15, 1.5: 0.15, 2.0: 0.15, 3.0: 0.15, 4.0: 0.1, 6.0: 0.1}
_MORE = {0.0: 0.5, 1.0: 0.5}
_LASTS = {0.0: 0.4, 1.0 * DAY: 0.2, 2.0 * DAY: 0.1, 5.0 * DAY: 0.15, 15.0 * DAY: 0.15}

HYPOTHESES: tuple[Scatter, ...] = tuple(
    Scatter(times, lasts, chance * often * share, more)
    for lasts, chance in _LASTS.items()
    for times, often in _TIMES.items()
    # what does not last is all of one kind
    for more, share in (_MORE.items() if lasts else ((0.0, 1.0),))
)
_KINDS = np.array([[h.lasts == lasts for h in HYPOTHESES] for lasts in _LASTS])
"""(lasts, hypothesis): which hypotheses say that deviations last so long."""
_GROSS = 6.0
"""Standard deviations beyond which a reading is a mistake, and says nothing of how others scatter.
"""
_OTHERS = 0.5
"""What another series' evidence counts: they hang together, and are not all alike."""


class Weighing:
    """The hypotheses' weights, series by series.

    How far a series scatters is its own. How long deviations last is the machine's and its hall's:
    all series weigh that together.

    Parameters
    ----------
    series
        How many.
    """

    def __init__(self, series: int) -> None:
        self._log = np.zeros((len(HYPOTHESES), series))
        self._prior = np.log([h.chance for h in HYPOTHESES])

    def weights(self) -> F64:
        """Weights of the hypotheses for all series, (g, m)."""
        own = self._prior[:, None] + self._log
        top = own.max(axis=0)
        # of how long deviations last, what each series says
        said = np.log(_KINDS @ np.exp(own - top)) - np.log(_KINDS @ np.exp(self._prior))[:, None]
        others = _OTHERS * (said.sum(axis=1, keepdims=True) - said)
        found = own + _KINDS.T @ others
        found = np.exp(found - found.max(axis=0))
        return np.asarray(found / found.sum(axis=0))

    def learn(self, series: NDArray[np.int64], z: F64, sd: F64) -> None:
        """Weigh by values standardised under each hypothesis, (g, k), of k series.

        `sd` (g, k) are the standard deviations that they were expected to have.
        """
        self._log[:, series] += -0.5 * np.minimum(np.abs(z), _GROSS) ** 2 - np.log(sd)
        self._log[:, series] -= self._log[:, series].max(axis=0)


def quantiles(weights: F64, z: F64) -> F64:
    """What values standardised under each hypothesis, (g, k), are under their mixture, (k,).

    Standard normal where the machine is sound.
    """
    # the smaller tail, so that far values are told apart
    side = np.where((weights * z).sum(axis=0) < 0.0, -1.0, 1.0)
    tail = (weights * _beyond(z * side)).sum(axis=0)
    return np.asarray(side * _quantile_beyond(tail))


_erfc = np.frompyfunc(math.erfc, 1, 1)
_FARTHEST = 38.0
"""Standard deviations beyond which the tail is no number any more."""


def _beyond(z: F64) -> F64:
    """Chance of more than z, standard normal."""
    return np.asarray(0.5 * _erfc(z * math.sqrt(0.5)), dtype=np.float64)


def _quantile_beyond(tail: F64) -> F64:
    """What a standard normal value exceeds with these chances (k,); by halving."""
    low, high = np.full(tail.shape, -_FARTHEST), np.full(tail.shape, _FARTHEST)
    for _ in range(60):
        middle = 0.5 * (low + high)
        more = _beyond(middle) > tail
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    return np.asarray(0.5 * (low + high))
