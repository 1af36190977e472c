"""The check of the active table's effect, at the positions that the controller shows."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.errors import AbbeError
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import said
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.table import Table
from abbe.drivers.stores.base import ShownCorrection, Store


class WrongEffectError(AbbeError):
    """The controller adds something else than the table says."""


@dataclass(frozen=True)
class EffectCheck:
    """The findings of a check of the effect.

    Attributes
    ----------
    looks
        How often a correction was compared; 0: the controller shows none.
    worst
        Largest difference, µm (rotary: µrad).
    largest
        Largest correction that was shown, µm (rotary: µrad).
    """

    looks: int = 0
    worst: float = 0.0
    largest: float = 0.0

    def words(self) -> str:
        """For people."""
        if not self.looks:
            return said(
                "the controller shows no correction that could be compared: its effect is not "
                "checked; check one point with an indicator"
            )
        return said(
            "the controller adds what the table says: {looks} corrections up to {largest} µm "
            "compared, worst difference {worst} µm",
            looks=self.looks,
            largest=f"{self.largest:.2f}",
            worst=f"{self.worst:.3f}",
        )


@dataclass(frozen=True)
class Expectation:
    """The correction that tables make a controller add.

    Attributes
    ----------
    tables
        As errors; none: nothing is added.
    model
        For the levers.
    tool
        Tool offset, mm.
    adds_error
        As in `abbe.drivers.stores.base.Store`.
    """

    tables: Sequence[Table]
    model: Model
    tool: tuple[float, float, float]
    adds_error: bool = False

    def comparable(self, effect: ShownCorrection) -> bool:
        """Whether the positions that the tables look up are all known."""
        needed = {a for t in self.tables for a in t.inputs}
        needed |= {t.lever[0] for t in self.tables if t.lever is not None}
        if not self._turns and any(not t.direct for t in self.tables):
            needed |= set(self.model.machine.axes)
        return needed <= set(effect.position)

    def at(self, effect: ShownCorrection) -> dict[str, tuple[float, float]]:
        """Axis → least and largest correction at an effect's position, mm (rotary: rad).

        They differ where a direction is not known and the table has two.
        """
        ways = {
            axis: (float(way),) if (way := effect.direction.get(axis, 0)) else (-1.0, 1.0)
            for axis in effect.position
            if any(axis == t.inputs[0] and t.directional for t in self.tables)
        }
        found = [
            self._one(effect.position, dict(zip(ways, chosen, strict=True)))
            for chosen in itertools.product(*ways.values())
        ]
        return {
            axis: (min(f[axis] for f in found), max(f[axis] for f in found))
            for axis in effect.correction
            if axis in found[0]
        }

    @property
    def _turns(self) -> bool:
        """Whether a table of a rotary axis turns that axis: the controller reckons no levers."""
        return all(t.direct or _own_turn(t) for t in self.tables)

    def _one(
        self, position: Mapping[str, float], direction: Mapping[str, float]
    ) -> dict[str, float]:
        where = {a: np.array([p]) for a, p in position.items() if a in self.model.machine.axes}
        ways = {a: np.array([d]) for a, d in direction.items()}
        field = ErrorField(self.model, SlowState(tool=self.tool))
        sign = 1.0 if self.adds_error else -1.0
        turns = self._turns
        moving = [t for t in self.tables if t.direct or not turns]
        moved = field.removed(moving, where, ways)[0]
        turned: dict[str, float] = {a: 0.0 for a in self.model.machine.axes if is_rotary(a)}
        conditions = field.conditions(where, ways)
        for table in self.tables:
            if turns and table.output.rotation:
                axis = table.output.component if table.direct else table.output.place
                if axis in turned:
                    turned[axis] += float(table.value(conditions)[0])
        moves = dict(zip("XYZ", (float(m) for m in moved), strict=True))
        return {axis: sign * value for axis, value in (moves | turned).items()}


def _own_turn(table: Table) -> bool:
    place = table.output.place
    return table.output.rotation and is_rotary(place) and table.output.component == place[0]


async def check_effect(
    store: Store, expected: Expectation, *, tolerance: float, looks: int, every: float
) -> EffectCheck:
    """Compare what the controller shows with what the table says, several times.

    Parameters
    ----------
    tolerance
        µm (rotary: µrad).
    looks, every
        How often, and s in between.

    Raises
    ------
    WrongEffectError
        When two looks in a row are off.
    LinkError
        When nothing can be read.
    """
    seen, off_before = EffectCheck(), False
    for look in range(looks):
        if look:
            await asyncio.sleep(every)
        wrong = ""
        for effect in await store.effects():
            if not expected.comparable(effect):
                continue
            seen, off = _compared(effect, expected, tolerance, seen)
            wrong = wrong or off
        if wrong and (off_before or looks == 1):
            raise WrongEffectError(wrong)
        off_before = bool(wrong)
    if off_before:
        raise WrongEffectError(wrong)
    return seen


def _compared(
    effect: ShownCorrection, expected: Expectation, tolerance: float, seen: EffectCheck
) -> tuple[EffectCheck, str]:
    looks, worst, largest, wrong = seen.looks, seen.worst, seen.largest, ""
    for axis, (low, high) in expected.at(effect).items():
        unit, factor = ("µrad", 1e6) if is_rotary(axis) else ("µm", 1e3)
        shown = effect.correction[axis]
        off = max(low - shown, shown - high, 0.0) * factor
        looks += 1
        if not off <= tolerance:
            place = ", ".join(f"{a} {p:.3f}" for a, p in effect.position.items())
            wrong = (
                f"at {place} the controller adds {shown * factor:.2f} {unit} to {axis}, the table "
                f"says {0.5 * (low + high) * factor:.2f} {unit}"
            )
        else:
            worst, largest = max(worst, off), max(largest, abs(shown) * factor)
    return EffectCheck(looks, worst, largest), wrong
