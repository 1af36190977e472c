"""Columns of a campaign that look as if they were in another unit: inches, radians, millimetres.

Seen against the machine alone, so also where no model says what to expect: an axis that is
measured over one part in 25.4 of its travel, or in 57.3 of its turn, and all axes alike.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.machine import Machine
from abbe.compcore.sentences import Sentence, joined, said

INCH = 25.4
RADIAN = 57.29577951308232
_WHOLE = (0.7, 1.02)
"""Part of the travel that a campaign over all of it covers."""
_TARGETS = 4
"""Different places of an axis from which on it was measured over its travel."""


def of_positions(campaign: Campaign, machine: Machine) -> Iterator[Sentence]:
    """Positions that would cover the machine's travels if they were inches, or radians."""
    for rotary, factor, unit, instead in (
        (False, INCH, "inches", "mm"),
        (True, RADIAN, "radians", "degrees"),
    ):
        shares = dict(_shares(campaign, machine, rotary=rotary))
        if shares and all(_WHOLE[0] <= share * factor <= _WHOLE[1] for share in shares.values()):
            yield said(
                "the positions of {axes} look like {unit}: factor {factor}. They cover one part in "
                "{factor} of the travel, {ranges}; the columns are in {instead}",
                axes=joined(shares, ", "), unit=unit, factor=f"{factor:.1f}", instead=instead,
                ranges=_ranges(campaign, machine, shares),
            )  # fmt: skip


def _shares(campaign: Campaign, machine: Machine, *, rotary: bool) -> Iterator[tuple[str, float]]:
    """The axes that were measured at several places, and over which part of their travel."""
    for name, position in campaign.conditions.positions.items():
        axis = machine.axes.get(name)
        if axis is None or axis.rotary is not rotary:
            continue
        low, high = axis.travel
        span = float(np.ptp(position)) if len(position) else 0.0
        if high > low and len(np.unique(np.round(position, 9))) >= _TARGETS:
            yield name, span / (high - low)


def _ranges(campaign: Campaign, machine: Machine, shares: dict[str, float]) -> str:
    parts = []
    for name in shares:
        axis, position = machine.axes[name], campaign.conditions.positions[name]
        factor, unit = (np.rad2deg(1.0), "°") if axis.rotary else (1.0, " mm")
        low, high = float(position.min()) * factor, float(position.max()) * factor
        least, most = (end * factor for end in axis.travel)
        parts.append(f"{name} {low:.4g} … {high:.4g} of {least:.4g} … {most:.4g}{unit}")
    return ", ".join(parts)
