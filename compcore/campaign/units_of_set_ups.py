"""Set-ups whose positions are in another unit, or of the other sign, than those of all others.

Lines are measured at the same targets again and again. Where no target of a set-up is one of the
others', and nearly all are after multiplying by what inches, metres or a turned sign make of them,
nobody needs a model to see it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.likely_units import INCH, RADIAN
from abbe.compcore.machine.machine import Machine
from abbe.compcore.sentences import Sentence, said

F64 = NDArray[np.float64]

_FEWEST = 5
"""Different targets of a set-up from which on that they are another's is no chance."""
_MOST, _LEAST = 0.8, 0.25
"""Part of the targets that has to be another's after multiplying, and may be before."""
_NEAR = 2e-4
"""Part of a set-up's range within which two targets are one: inches are written with 2 digits."""
_CROWDED = 0.05
"""Part of a set-up's range that its targets, each as wide as that, may fill."""
_WHOLE = 0.4
"""Part of a travel that a line goes over at the least, if it is in another unit."""
_BEYOND = 0.02
"""Part of a travel by which positions may lie beyond its ends."""


@dataclass(frozen=True)
class OtherUnit:
    """One axis's positions in one set-up, and what they have to be multiplied by.

    Attributes
    ----------
    factor
        As it is said: 25.4, 1000, 57.2958 or −1.
    same, targets
        How many of its targets are then others', of how many.
    """

    setup: str
    axis: str
    factor: float
    same: int
    targets: int

    def words(self, campaign: Campaign, machine: Machine) -> Sentence:
        """What is suspicious about it, by what, and what to do."""
        rows = campaign.conditions.setup == self.setup
        position = campaign.conditions.positions[self.axis][rows]
        times, unit = (np.rad2deg(1.0), "°") if machine.axes[self.axis].rotary else (1.0, "mm")
        low, high = float(position.min()) * times, float(position.max()) * times
        least, most = (end * times for end in machine.axes[self.axis].travel)
        seen = said(
            "multiplied by {factor}, {same} of its {targets} targets are those of another set-up",
            factor=self._times, same=self.same, targets=self.targets,
        )  # fmt: skip
        return said(
            "the positions of {axis} in the set-up {setup} {look} ({low} … {high} of {least} … "
            "{most} {unit}): {seen}. Multiply its column {axis} by {factor}",
            axis=self.axis, setup=self.setup, look=_LOOK[self.factor],
            low=f"{low:.4g}", high=f"{high:.4g}", least=f"{least:.4g}", most=f"{most:.4g}",
            unit=unit, factor=self._times,
            seen=seen if self.same else said("so the values ask"),
        )  # fmt: skip

    @property
    def _times(self) -> str:
        return f"{self.factor:g}".replace("-", "−")


_LOOK = {
    INCH: said("look like inches"),
    1e3: said("look like metres"),
    RADIAN: said("look like radians"),
    -1.0: said("have the other sign"),
}
_LINEAR, _ROTARY = (INCH, 1e3, -1.0), (RADIAN, -1.0)
"""µm are far beyond any travel, and are refused where they are read."""


def other_units(campaign: Campaign, machine: Machine) -> Iterator[OtherUnit]:
    """Every set-up with an axis whose targets are the others' only in another unit or sense."""
    setup = campaign.conditions.setup
    if setup is None:
        return
    for axis, position in campaign.conditions.positions.items():
        if axis not in machine.axes:
            continue
        targets = {name: _targets(position, setup == name) for name in campaign.setups}
        moving = {name: own for name, own in targets.items() if len(own) >= _FEWEST}
        for name, own in moving.items():
            others = [q for n, q in moving.items() if n != name]
            if not others:
                continue
            factors = _ROTARY if machine.axes[axis].rotary else _LINEAR
            within = [f for f in factors if _within(own * f, machine.axes[axis].travel)]
            if _within(own, machine.axes[axis].travel):
                # to the other side of 0 a line may go on this machine
                within = [f for f in within if f > 0.0]
            found = _factor(own, others, within)
            if found is not None:
                yield OtherUnit(name, axis, *found, len(own))


def perhaps_other_units(
    campaign: Campaign, machine: Machine, setups: Iterable[str]
) -> Iterator[OtherUnit]:
    """Positions of some set-ups that could be in another unit or sense, as far as travels say."""
    setup = campaign.conditions.setup
    if setup is None:
        return
    for name in setups:
        for axis, position in campaign.conditions.positions.items():
            if axis not in machine.axes:
                continue
            (low, high), rotary = machine.axes[axis].travel, machine.axes[axis].rotary
            own = _targets(position, setup == name)
            for factor in (_ROTARY if rotary else _LINEAR) if len(own) >= _FEWEST else ():
                whole = abs(factor) * float(np.ptp(own)) > _WHOLE * (high - low) or factor < 0.0
                if whole and _within(own * factor, (low, high)):
                    yield OtherUnit(name, axis, factor, 0, len(own))


def of_set_ups(campaign: Campaign, machine: Machine) -> Iterator[Sentence]:
    """The same in words."""
    for found in other_units(campaign, machine):
        yield found.words(campaign, machine)


def _within(position: F64, travel: tuple[float, float]) -> bool:
    """Whether all positions are within a travel, or hardly beyond."""
    low, high = travel
    beyond = _BEYOND * (high - low)
    return bool(low - beyond <= position.min() and position.max() <= high + beyond)


def _targets(position: F64, rows: NDArray[np.bool_]) -> F64:
    return np.unique(np.round(position[rows], 9))


def _factor(own: F64, others: Sequence[F64], factors: Sequence[float]) -> tuple[float, int] | None:
    """With which factor a set-up's targets are one other's, and how many of them then are."""
    for factor in factors:
        same = max(_same(own * factor, q) for q in others)
        as_is = max(_same(own, q) for q in others)
        if same >= max(_FEWEST, _MOST * len(own)) and as_is <= _LEAST * len(own):
            return factor, same
    return None


def _same(some: F64, others: F64) -> int:
    """How many of some places are targets of another set-up, sorted; 0 where those are crowded."""
    range_ = max(float(np.ptp(others)), float(np.ptp(some)))
    near = _NEAR * range_
    if 2.0 * near * len(others) > _CROWDED * range_:
        return 0
    at = np.searchsorted(others, some)
    below = np.abs(some - others[np.clip(at - 1, 0, len(others) - 1)])
    above = np.abs(some - others[np.clip(at, 0, len(others) - 1)])
    return int((np.minimum(below, above) <= near).sum())
