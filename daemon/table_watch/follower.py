"""The state of a machine whose tables are watched: what the model needs, whether it is idle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.machine.lag import LagState
from abbe.compcore.model.lags import lags_of
from abbe.compcore.model.model import Model
from abbe.compcore.tables.change import predicted_change
from abbe.compcore.tables.volume import Volume

_STILL = {"mm": 0.01, "rad": 1e-5}
"""Motion below this is none."""


class Follower:
    """The slow state of a machine, and whether its tables are out of date. No I/O.

    Parameters
    ----------
    model, volume
        The model, and where its error counts.
    limit
        Change of the predicted error anywhere that asks for new tables, mm.
    idle_after
        s without motion after which the machine counts as idle.
    tool
        Tool offset, mm.

    Attributes
    ----------
    made_at
        State for which the last tables were made; None before the first.
    """

    def __init__(
        self,
        model: Model,
        volume: Volume,
        limit: float,
        idle_after: float,
        tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self._model, self._volume = model, volume
        self._limit, self._idle_after = limit, idle_after
        self._state = SlowState(tool=tool)
        self._lags = {key: LagState(key[1]) for key in lags_of(model)}
        self._needed = model.signals_needed()
        self._still_since = math.inf
        self._stood: tuple[float, ...] = ()
        self.made_at: SlowState | None = None

    def missing(self, signals: Mapping[str, float]) -> list[str]:
        """Signals that the model reads and that are not known."""
        return [n for n in self._needed if not math.isfinite(signals.get(n, math.nan))]

    def take(self, now: float, signals: Mapping[str, float]) -> SlowState:
        """Take in the present signals, all finite; `now` in s on a clock that keeps running."""
        values = {name: float(signals[name]) for name in self._needed}
        lags = {key: lag.step(now, values[key[0]]) for key, lag in self._lags.items()}
        self._state = replace(self._state, signals=values, lags=lags)
        return self._state

    def stand(self, now: float, positions: Sequence[float]) -> bool:
        """Take in the present positions (mm; rotary: rad; NaN: not known); True when idle."""
        axes = self._model.machine.structure.axes
        near = len(self._stood) == len(positions) and all(
            abs(a - b) <= _STILL["rad" if self._model.machine.axes[axis].rotary else "mm"]
            for axis, a, b in zip(axes, positions, self._stood, strict=True)
        )
        if not near or not all(map(math.isfinite, positions)):
            self._stood = tuple(positions)
            self._still_since = now if all(map(math.isfinite, positions)) else math.inf
        return now - self._still_since >= self._idle_after

    def change(self) -> float:
        """Largest change of the predicted error since the last tables, mm; infinite before any."""
        if self.made_at is None:
            return math.inf
        return predicted_change(self._model, self._volume, self.made_at, self._state).largest

    def due(self) -> bool:
        """Whether new tables are asked for."""
        return self.change() > self._limit

    def made(self) -> None:
        """The tables were made for the present state."""
        self.made_at = self._state
