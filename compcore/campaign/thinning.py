"""Thinning: which rows of a large campaign are enough to tell causes apart.

A cause that is worth naming explains at least one part in a hundred of the noise's variance, and
some thousand rows show that beyond doubt. More rows sharpen its parameters, not its name. So causes
are told apart on rows that keep the design: of every set-up, in the order of time, one row of each
stretch, drawn at random within it, so that no rhythm of the plan is left out or doubled.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign

Index = NDArray[np.int64]

ENOUGH_ROWS = 8_000
"""Of a larger campaign causes are told apart on about so many rows."""

_WORTH = 1.25
"""Campaigns with no more than so many times the rows that are enough are left whole."""

_FEWEST = 12
"""Rows of a set-up that are kept, where it has them: fewer would hardly outlast its nuisances."""


def thinned(campaign: Campaign, most: int = ENOUGH_ROWS) -> Index | None:
    """Rows on which causes are told apart, ascending, shape (about `most`,); None where all are.

    Of every set-up in proportion to its own, but at least a few of each; where there are too many
    set-ups for that, whole set-ups are left out, evenly through the campaign.
    """
    if campaign.n <= _WORTH * most:
        return None
    rng = np.random.default_rng(0)
    number = _numbers(campaign)
    c = campaign.conditions
    run = np.zeros(campaign.n, dtype=np.int64) if c.run is None else c.run
    order = np.lexsort((np.arange(campaign.n), c.time, run, number))
    counts = np.bincount(number)
    ends = np.cumsum(counts)
    chosen = np.arange(len(counts))
    if len(counts) * _FEWEST > most:
        chosen = np.unique(np.linspace(0, len(counts) - 1, max(1, most // _FEWEST)).astype(int))
    share = min(1.0, most / float(counts[chosen].sum()))
    kept = []
    for i in chosen:
        rows = order[ends[i] - counts[i] : ends[i]]
        count = min(len(rows), max(_FEWEST, round(share * len(rows))))
        edges = np.linspace(0, len(rows), count + 1).astype(np.int64)
        at = rng.integers(edges[:-1], edges[1:])
        at[0] = 0  # a set-up's first row is what drifts are counted from
        kept.append(rows[at])
    return np.sort(np.concatenate(kept))


def _numbers(campaign: Campaign) -> Index:
    """Each row's set-up, numbered in the order in which they begin, shape (n,)."""
    setup = campaign.conditions.setup
    if setup is None:
        return np.zeros(campaign.n, dtype=np.int64)
    _, first, inverse = np.unique(setup, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.asarray(rank[inverse.reshape(-1)])
