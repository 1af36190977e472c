"""First-order lag of a recorded signal: how the temperature of a body follows air or sensor.

``τ·dy/dt = T − y``. Between samples the input is taken as straight, for which the solution is exact
at any spacing, so recorded campaigns and the live path (`LagState`) give the same numbers. The
initial state is equilibrium with the first sample: ``y(t_0) = T(t_0)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

_SPAN = 200.0
"""Greatest exponent inside one vectorised block; e^200 is far from overflow."""
_SHORTEST = 1e-290
"""Step in time constants, far below any clock's, that stands for every shorter one."""


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """The times of some rows in order, each once: worked out once for many lags.

    Attributes
    ----------
    t
        Times, s, ascending, shape (k,).
    first, number
        A row of each time, (k,); each row's time, (n,).
    """

    t: F64
    first: NDArray[np.int64]
    number: NDArray[np.int64]

    @classmethod
    def of(cls, time: F64) -> Clock:
        """The clock of rows with times (n,), s, in any order."""
        t, first, number = np.unique(time, return_index=True, return_inverse=True)
        return cls(t, first, number.reshape(-1))

    def lag(self, value: F64, tau: float) -> F64:
        """As `first_order_lag` for values (n,) at the rows' times."""
        x = np.asarray(value, dtype=np.float64)[self.first]
        dt = np.diff(self.t)
        steps = np.maximum(dt / tau, _SHORTEST)
        decay = np.exp(-steps)
        followed = -np.expm1(-steps)
        gain = followed * x[:-1] + (1.0 - followed / steps) * np.diff(x)
        y = np.empty_like(x)
        y[0] = x[0]
        elapsed = np.concatenate([[0.0], np.cumsum(steps)])
        i = 0
        while i < len(dt):
            # the recursion y_k = d_k y_{k-1} + g_k, summed in closed form over a block in which
            # the exponentials stay finite; a step longer than that stands alone
            j = int(np.searchsorted(elapsed, elapsed[i] + _SPAN, side="right")) - 1
            if j <= i:
                y[i + 1] = decay[i] * y[i] + gain[i]
                i += 1
                continue
            grow = np.exp(elapsed[i + 1 : j + 1] - elapsed[i])
            y[i + 1 : j + 1] = (y[i] + np.cumsum(gain[i:j] * grow)) / grow
            i = j
        return y[self.number]


def first_order_lag(time: F64, value: F64, tau: float) -> F64:
    """A signal behind a first-order lag of time constant tau, at each row, in the signal's unit.

    Parameters
    ----------
    time, value
        Shape (n,), s and the signal's unit; rows in any order, rows of one time alike.
    tau
        Time constant, s, > 0.

    Returns
    -------
    Shape (n,), in the rows' own order.
    """
    return Clock.of(time).lag(value, tau)


@dataclass(slots=True)
class LagState:
    """First-order lag of a signal taken sample by sample, as the live path needs it.

    Attributes
    ----------
    tau
        Time constant, s.
    time, value, state
        Time (s) and value of the last sample, and the lagged value; NaN before the first sample.
    """

    tau: float
    time: float = math.nan
    value: float = math.nan
    state: float = math.nan

    def step(self, time: float, value: float) -> float:
        """Take a sample in and return the lagged value; a time not after the last changes nothing.

        `time` in s, on the same clock as before.
        """
        if math.isnan(self.state):
            self.time, self.value, self.state = time, value, value
            return value
        dt = time - self.time
        if dt > 0.0:
            step = max(dt / self.tau, _SHORTEST)
            followed = -math.expm1(-step)
            # as a change of the state, so that one in equilibrium stays as it is to the last bit
            self.state += followed * (self.value - self.state)
            self.state += (1.0 - followed / step) * (value - self.value)
            self.time, self.value = time, value
        return self.state
