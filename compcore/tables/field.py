"""The error field of a model at stated temperatures and tool, where tables look it up."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.errors import InputError, NotContractionError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.kinematics import Chain, exact, first_order
from abbe.compcore.model.model import Model
from abbe.compcore.tables.table import Table

F64 = NDArray[np.float64]
T = TypeVar("T")
Lookup = Literal["indicated", "command"]
"""Where a table is read: at the position that the scale shows, or at the one that is wanted."""

_SETTLED = 1e-6
"""mm: what another round may still change for a command to count as found."""
_ROUNDS = 50
_KEPT = 100
"""Errors that are remembered, some 0.3 MB each."""


@dataclass(frozen=True, eq=False)
class ErrorField:
    """A model's error as a function of positions, at one state of temperatures, load and tool.

    Attributes
    ----------
    model
        The model; its fitted effects count.
    state
        Temperatures and other signals, lags, time, tool; lags that are not given are in
        equilibrium with their signal.
    lookup
        ``indicated``: the error at the positions themselves, for a CMM's reading or a correction of
        the actual value. ``command``: the error that the machine will have when it stands at these
        positions in truth; it is then commanded to ``c`` with ``c + error(c) = position``.
    """

    model: Model
    state: SlowState
    lookup: Lookup = "indicated"
    _known: dict[bytes, F64] = field(default_factory=dict, repr=False)
    _moving: dict[bytes, dict[ErrorMotion, F64]] = field(default_factory=dict, repr=False)
    _found: dict[Hashable, object] = field(default_factory=dict, repr=False)

    def conditions(
        self, positions: Mapping[str, F64], directions: Mapping[str, F64] | None = None
    ) -> Conditions:
        """Conditions of this state at n rows of positions (mm or rad) and directions, each (n,)."""
        return self.state.conditions(positions, directions or {})

    def __call__(
        self, positions: Mapping[str, F64], directions: Mapping[str, F64] | None = None
    ) -> F64:
        """The error as moves of X, Y and Z, (n, 3), mm.

        Raises
        ------
        NotContractionError
            When the error changes too fast with position for a command to be found.
        """
        # several sets of tables are made from one field, each asking at the same places
        key = _places(positions, directions or {})
        if key not in self._known:
            if len(self._known) >= _KEPT:
                self._known.clear()
            self._known[key] = self._error(positions, directions)
        return self._known[key].copy()

    def _error(
        self, positions: Mapping[str, F64], directions: Mapping[str, F64] | None = None
    ) -> F64:
        here = self.conditions(positions, directions)
        error = self._at(here)
        if self.lookup == "indicated":
            return error
        moved = np.abs(error).max(initial=0.0)
        for _ in range(_ROUNDS):
            offset = {axis: -error[:, k] for k, axis in enumerate("XYZ")}
            before, error = error, self._at(here.moved(offset))
            last, moved = moved, np.abs(error - before).max(initial=0.0)
            # every round shrinks the change by the same factor or more
            if moved * moved <= _SETTLED * last:
                return error
        raise NotContractionError(
            "no command reaches some positions: the error changes by more than a millimetre per "
            "millimetre of travel; look for a wrong unit"
        )

    def _at(self, conditions: Conditions) -> F64:
        found = self.model.axis_error(conditions)
        return np.stack([found[axis] for axis in "XYZ"], axis=1)

    def motions(
        self, positions: Mapping[str, F64], directions: Mapping[str, F64] | None = None
    ) -> dict[ErrorMotion, F64]:
        """The error motions where tables are looked up, each (n,), mm or rad."""
        here = self.conditions(positions, directions)
        if self.lookup == "command":
            error = self(positions, directions)
            here = here.moved({axis: -error[:, k] for k, axis in enumerate("XYZ")})
        return self.model.error_motions(here)

    def found(self, key: Hashable, find: Callable[[], T]) -> T:
        """A result about this error field under a key, computed once.

        Several sets of tables are made from one field; all that they ask for is asked again.
        """
        if key not in self._found:
            self._found[key] = find()
        return cast("T", self._found[key])

    def removed(
        self,
        tables: Iterable[Table],
        positions: Mapping[str, F64],
        directions: Mapping[str, F64] | None = None,
    ) -> F64:
        """The error that tables compensate, as moves of X, Y and Z, (n, 3), mm.

        Error motions go through the machine's levers as the model composes them.
        """
        conditions = self.conditions(positions, directions)
        total = np.zeros((conditions.n, 3))
        motions: dict[ErrorMotion, F64] = {}
        for table in tables:
            value = table.value(conditions)
            if not table.direct:
                motions[table.output] = motions.get(table.output, 0.0) + value
            elif not table.output.rotation:
                total[:, "XYZ".index(table.output.component)] += value
        return total + self.composed(motions, conditions) if motions else total

    def composed(self, motions: Mapping[ErrorMotion, F64], conditions: Conditions) -> F64:
        """Moves of X, Y, Z that error motions compose to, (n, 3), mm."""
        return Chain(self.model.machine, conditions).as_moves(self.carried(motions, conditions))

    def carried(self, motions: Mapping[ErrorMotion, F64], conditions: Conditions) -> F64:
        """What error motions move the functional point by, in machine axes, (n, 3), mm.

        Also along axes that the machine does not have: an arm's joint turns the tip where no X is.
        """
        chain = Chain(self.model.machine, conditions)
        compose = exact if self.model.composition == "exact" else first_order
        return compose(chain, motions)[0]

    def reversing(self) -> tuple[str, ...]:
        """Axes on whose approach direction the error depends, in the structure's order."""
        used: set[str] = set()
        for term in self.model.terms:
            if term.fitted and term.effect.scope != "instrument":
                used.update(term.effect.directions_used())
        return tuple(a for a in self.model.machine.structure.axes if a in used)

    def kinks(self, axis: str) -> F64:
        """Positions inside the travel where some effect's slope may jump, (k,), mm or rad."""
        machine = self.model.machine
        found: set[float] = set()
        for term in self.model.terms:
            if term.fitted and term.effect.scope != "instrument":
                found.update(term.effect.kinks(machine).get(axis, ()))
        low, high = machine.axis(axis).travel
        return np.array(sorted(p for p in found if low < p < high))


def _places(*tables: Mapping[str, F64]) -> bytes:
    """A fingerprint of positions and directions."""
    named = blake2b()
    for table in tables:
        for name, values in table.items():
            named.update(f"{name} {len(values)} ".encode())
            named.update(np.asarray(values, dtype=np.float64).tobytes())
        named.update(b";")
    return named.digest()


def table_state(
    model: Model,
    signals: Mapping[str, float],
    *,
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
    time: float = 0.0,
    spindle_angle: float | None = None,
) -> SlowState:
    """The state (temperatures, load, tool) at which tables are made; all signals must be stated.

    Parameters
    ----------
    signals
        Name → value in the signal's own unit.
    tool
        Tool or probe offset, mm.
    time
        s since the model's time zero, for drifts and events.
    spindle_angle
        Angle of the spindle in brackets, rad.

    Raises
    ------
    InputError
        For a signal that the machine does not have, or one that is missing.
    """
    known = model.machine.signals
    for name in signals:
        if name not in known:
            raise InputError(
                "the model's machine has no such signal",
                field=name,
                expected="one of " + (", ".join(known) or "none"),
            )
    missing = [name for name in model.signals_needed() if name not in signals]
    if missing:
        named = ", ".join(f"{n} ({known[n].unit})" if n in known else n for n in missing)
        raise InputError(
            "a table holds at stated conditions, and the model reads signals that are not stated",
            field=missing[0],
            expected=f"values of {named} (--at {missing[0]}=…, or --at reference)",
        )
    return SlowState(time=time, signals=dict(signals), tool=tool, spindle_angle=spindle_angle)
