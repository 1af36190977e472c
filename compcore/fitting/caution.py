"""How a campaign was kept from being extrapolated: how large errors are expected, what it shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.sentences import said

_HARDLY = 0.1
"""Part of what was expected of an effect that a campaign must tell to show it."""


@dataclass(frozen=True)
class Caution:
    """How a campaign was kept from being extrapolated.

    Attributes
    ----------
    expected
        Kind of effect → how far from 0 its parameters are expected, as a part of what is
        believable of them.
    shown
        Spec of each effect → part of what was expected of it that the campaign tells, 0 … 1.
    rank
        How many combinations the campaign determines by itself.
    spread
        By how much each row's set-up scatters more than is stated of it, (n,).
    """

    expected: dict[str, float]
    shown: dict[str, float]
    rank: int
    spread: NDArray[np.float64] = field(repr=False, compare=False)

    @property
    def hardly(self) -> tuple[str, ...]:
        """Effects that the campaign hardly shows: they are left near 0."""
        return tuple(spec for spec, part in self.shown.items() if part < _HARDLY)

    def words(self) -> Iterator[str]:
        """Lines for people: that values are cautious, and which effects hardly show."""
        yield said("cautious: what the campaign shows little of is held near 0")
        if self.hardly:
            yield said("hardly shown, and left near 0: {effects}", effects="; ".join(self.hardly))
        yield said("what is not determined is as unsure as this machine's errors are large")
