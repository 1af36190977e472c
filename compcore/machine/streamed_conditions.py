"""Conditions read in blocks of rows, with lagged signals that continue from block to block."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.lag import first_order_lag

F64 = NDArray[np.float64]


class LagStates:
    """The lagged signals' state at the end of the rows read so far."""

    def __init__(self) -> None:
        self._states: dict[tuple[str, float], tuple[float, float, float]] = {}
        self._next: dict[tuple[str, float], tuple[float, float, float]] = {}

    def follow(self, name: str, tau: float, time: F64, value: F64) -> F64:
        """A lagged signal over one block, shape (n,); time (s) not before the last block's.

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
        """Close a block: the next one continues from its last row."""
        self._states |= self._next


@dataclass(frozen=True, eq=False)
class StreamedConditions(Conditions):
    """A block of a longer table in the order of time; `flow` carries the lags between blocks."""

    flow: LagStates = field(default_factory=LagStates)

    def lag(self, name: str, tau: float) -> F64:
        """A signal behind a first-order lag of time constant `tau` (s), shape (n,)."""
        return self.flow.follow(name, tau, self.time, self.signal(name))

    def aside(self) -> StreamedConditions:
        """The same rows with lags of their own: what is asked of them leaves no trace here."""
        return replace(self, flow=copy.deepcopy(self.flow), _lags={}, _made={})
