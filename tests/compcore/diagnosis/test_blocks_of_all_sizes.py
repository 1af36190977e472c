"""Descriptions judged over blocks of which some are far larger, and some are not spoken of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.diagnosis.screening.left_out.crossvalidation import LeftOut
from abbe.compcore.diagnosis.uncatalogued.descriptions import surely

FALLS = [56.8, 47.8, 2.6, 734.5, 247.5, 36.7, 148.2, 0.0]
"""By how much χ² of each set-up fell with the right formula (play that goes with the feed)."""


def left(falls: list[float]) -> tuple[LeftOut, LeftOut]:
    """Two rows of each block, of which χ² falls by so much."""
    folds = [np.array([2 * k, 2 * k + 1]) for k in range(len(falls))]
    before = np.full(2 * len(falls), 30.0)
    after = np.repeat(np.sqrt(900.0 - 0.5 * np.array(falls)), 2)
    found = LeftOut(before, folds, (0,) * len(folds))
    return found, replace(found, residual=after)


@pytest.mark.parametrize(
    ("falls", "wanted"),
    [
        (FALLS, True),
        ([-f for f in FALLS], False),
        ([734.5, -247.5, 36.7, -148.2, 56.8, -47.8, 2.6], False),
    ],
)
def test_every_block_that_is_spoken_of_counts(falls: list[float], wanted: bool) -> None:
    before, after = left(falls)
    assert surely(before, after, np.ones(len(before.residual))) is wanted
