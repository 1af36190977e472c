"""Conditions that come in blocks of rows: lagged signals go on where the last block ended."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.lag import first_order_lag

F64 = NDArray[np.float64]


class Lags:
    """The state of every lag at the end of the rows so far."""

    def __init__(self) -> None:
        self._states: dict[tuple[str, float], tuple[float, float, float]] = {}
        self._next: dict[tuple[str, float], tuple[float, float, float]] = {}

    def follow(self, name: str, tau: float, time: F64, value: F64) -> F64:
        """A signal behind a lag over one piece, shape (n,); time (s) not before the piece before.

        Asked again for the same piece it answers alike, until `settle`.
        """
        key = (name, tau)
        if key not in self._states:
            lagged = first_order_lag(time, value, tau)
        else:
            when, was, state = self._states[key]
            joined = first_order_lag(np.append(when, time), np.append(was, value), tau)[1:]
            # the lag is linear: what the state was off equilibrium decays on its own
            lagged = joined + (state - was) * np.exp(-(time - when) / tau)
        last = int(np.argmax(time))
        self._next[key] = (float(time[last]), float(value[last]), float(lagged[last]))
        return lagged

    def settle(self) -> None:
        """The piece is done with; the next one follows on it."""
        self._states |= self._next


@dataclass(frozen=True, eq=False)
class StreamedConditions(Conditions):
    """A piece of a longer table in the order of time; `flow` keeps the lags between pieces."""

    flow: Lags = field(default_factory=Lags)

    def lag(self, name: str, tau: float) -> F64:
        """A signal behind a first-order lag of time constant `tau` (s), shape (n,)."""
        return self.flow.follow(name, tau, self.time, self.signal(name))
