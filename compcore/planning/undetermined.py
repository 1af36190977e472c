"""What a plan leaves undetermined: combinations of unknowns that its rows do not feel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from string import Formatter

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect
from abbe.compcore.linalg import svd
from abbe.compcore.machine.error_motion import ABOUT
from abbe.compcore.planning.choice import Knowledge
from abbe.compcore.planning.knowledge import unknowns
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.sentences import said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_FELT = 1e-4
"""mm in the volume below which nobody misses a combination."""
_MOST = 6
_SHARE = 0.15
"""Part of a combination from which an effect is named."""


@dataclass(frozen=True, slots=True)
class Undecided:
    """A combination of unknowns that stays as it was believed.

    Attributes
    ----------
    effects
        The effects that take part, as they are typed, those with most of it first.
    words
        The same as they are said.
    size
        What a believable amount of it does over the volume, root of the mean square, mm.
    """

    effects: tuple[str, ...]
    words: tuple[str, ...]
    size: float

    def __str__(self) -> str:
        what: str = self.words[0]
        for other in self.words[1:]:
            what = said("{one} with {other}", one=what, other=other)
        size = f"{in_digits(self.size * 1e3)} µm"
        return said("{what}: {size} over the volume", what=what, size=size)


def undecided(task: SurveyTask, known: Knowledge, start: Knowledge) -> Iterator[Undecided]:
    """Combinations that the rows say less of than was known before, largest in the volume first."""
    gained = known.precision - start.precision
    half = np.linalg.cholesky(start.covariance)
    values, vectors = np.linalg.eigh(half.T @ gained @ half)
    left = half @ vectors[:, values < 1.0]
    if not left.shape[1]:
        return
    felt = known.volume.field @ left
    _, size, turned = svd(felt)
    points = max(len(felt) // 3, 1)
    owner = unknowns(task.model)
    found: dict[tuple[str, ...], Undecided] = {}
    for k in range(min(_MOST, len(size))):
        amount = float(size[k] / np.sqrt(points))
        if amount < _FELT:
            break
        share = (left @ turned[k]) ** 2
        parts = np.bincount(owner, share, minlength=len(task.model.effects))
        order = [int(i) for i in np.argsort(-parts)]
        # of many that take part alike none has much
        most = [i for i in order if parts[i] > _SHARE * parts.sum()] or order
        named = [task.model.effects[i] for i in most[:3]]
        one = Undecided(tuple(e.spec for e in named), tuple(map(_words, named)), amount)
        # several combinations of the same effects are one to who reads it
        alike = tuple(sorted(one.effects))
        before = found.get(alike, one)
        both = amount if before is one else float(np.hypot(before.size, amount))
        found[alike] = replace(before, size=both)
    yield from sorted(found.values(), key=lambda one: -one.size)


_TITLES = {
    "positioning": "positioning of {axis} (E_{axis}{axis})",
    "scale": "scale of {axis} (E_{axis}{axis})",
    "straightness": "straightness of {axis} in {direction} (E_{direction}{axis})",
    "angular": "tilt of {axis} about {about} (E_{letter}{axis})",
    "squareness": "squareness of {first} and {second}",
    "backlash": "play of {axis}",
    "rotary_positioning": "angle of {axis} (E_{axis}{axis})",
    "rotary_radial": "radial motion of {axis} in {direction} (E_{direction}{axis})",
    "rotary_axial": "axial motion of {axis}",
    "rotary_tilt": "tilt of {axis} about {direction} while it turns",
    "rotary_location": "where the line of {axis} lies",
    "cyclic": "waves along {axis}",
    "reversal_angle": "tilt of {axis} about {about} when it reverses",
    "lateral_reversal": "sidestep of {axis} in {direction} when it reverses",
    "cross_angular": "tilt of {axis} about {about} by where {by} stands",
    "scale_expansion": "expansion of the scale of {axis}",
    "screw_heating": "heating of the screw of {axis}",
    "thermal_bending": "bending of {axis} about {about} by heat",
    "thermal_tilt": "lean of {axis} about {about} by heat",
    "thermal_offset": "move of the tool in {direction} by heat",
    "spindle_location": "where the spindle lies in its head",
}
"""Kind of an effect → its name, in ISO 230-1 where it has one; others stand as they are typed."""


def titles() -> frozenset[str]:
    """Everything that an undetermined effect is called."""
    return frozenset(_TITLES.values())


def _words(effect: Effect) -> str:
    title = _TITLES.get(effect.kind)
    where = effect.where()
    if title is None:
        return effect.spec
    first, second = [*(where.get("axes") or ()), "", ""][:2]
    known = {key: str(value) for key, value in where.items()}
    known |= {"first": str(first), "second": str(second)}
    known["letter"] = ABOUT.get(known.get("about", ""), "")
    needed = {name for _, name, _, _ in Formatter().parse(title) if name}
    if not needed <= known.keys():
        return effect.spec
    return said(title, **{name: known[name] for name in sorted(needed)})
