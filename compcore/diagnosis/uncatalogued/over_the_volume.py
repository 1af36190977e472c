"""A smooth error over the volume: polynomials of all positions together, one for each direction.

What a shop fits to a machine whose axes are none of straight guideways, such as an arm of six
joints that is told X, Y and Z: products of positions that no error motion of a single axis makes.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Campaign
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.formula import MOST_TERMS, Formula
from abbe.compcore.machine.machine import Machine

_DIRECTIONS = ("X", "Y", "Z")

_DEGREES = (2, 3, 4)
"""A bow, what a cubic of the textbooks has, and one more."""

_PLACES = 3
"""Places for each coefficient: fewer say nothing of what lies between them."""

_SEEN = 0.2
"""Cosine of a measured direction from which it shows a component."""


def smooth_errors(machine: Machine, campaign: Campaign) -> Iterator[tuple[Effect, ...]]:
    """Descriptions of the functional point's error by polynomials of the linear axes' positions.

    Each is a formula for every direction that was measured: products of two and more positions
    alone, beside error motions of single axes; then all powers and products, in place of them.
    Nothing where fewer than two linear axes moved, where no lengths were measured or where there
    are too few places.

    Parameters
    ----------
    machine
        Its travels are what the positions are counted from the middle of, mm.
    campaign
        The rows.
    """
    moving = campaign.coverage().moving
    axes = [a for a in machine.structure.axes if a in moving and not machine.axis(a).rotary]
    lengths = np.isin(campaign.kind, LENGTHS)
    along = campaign.conditions.u
    if len(axes) < 2 or along is None or not lengths.any():
        return
    shown = dict(zip(_DIRECTIONS, ((np.abs(along) > _SEEN) & lengths[:, None]).T, strict=True))
    channels = [d for d, rows in shown.items() if rows.any()]
    if not channels:
        return
    # each direction has coefficients of its own
    places = min(_places(campaign, axes, shown[d]) for d in channels)
    for degree in _DEGREES:
        for least in (2, 1):  # axes in a product
            terms = list(_terms(machine, axes, degree, least))
            if len(terms) <= MOST_TERMS and _PLACES * len(terms) <= places:
                yield tuple(
                    Formula.model_validate({"channel": f"d{d}", "terms": tuple(terms)})
                    for d in channels
                )


def _places(campaign: Campaign, axes: list[str], rows: NDArray[np.bool_]) -> int:
    at = [campaign.conditions.position(a)[rows] for a in axes]
    return len(np.unique(np.round(np.column_stack(at), 2), axis=0))


def _terms(machine: Machine, axes: list[str], degree: int, least: int) -> Iterator[str]:
    """Products of up to `degree` positions in which at least so many axes are."""
    for power in range(1, degree + 1):
        for chosen in combinations_with_replacement(axes, power):
            kept = dict.fromkeys(chosen)
            if len(kept) >= least:
                yield "*".join(_from_the_middle(machine, a, chosen.count(a)) for a in kept)


def _from_the_middle(machine: Machine, axis: str, power: int) -> str:
    middle = float(np.mean(machine.axis(axis).travel))
    place = axis if middle == 0.0 else f"({axis}{-middle:+.6g})"
    return place if power == 1 else f"{place}**{power}"
