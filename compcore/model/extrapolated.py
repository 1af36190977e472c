"""What is said of a campaign whose signals were never so when the model was fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence

from abbe.compcore.model.measured_ranges import OutsideMeasured
from abbe.compcore.sentences import Sentence, joined, said
from abbe.compcore.units import in_digits

_MOST = 3
_NO_RANGE = 0.1
"""K or the like: what a signal ranged over that never changed."""


def extrapolated_words(
    beyond: Sequence[OutsideMeasured],
    share: float,
    sizes: Sequence[tuple[float, float, str]] = (),
) -> Sentence:
    """That signals were not measured so, what stands out most, and how much is left there.

    Parameters
    ----------
    beyond
        What was not measured.
    share
        Of the rows.
    sizes
        RMS of what is left on the other rows and there, and its unit; NaN where there are none.
    """
    worst = sorted(beyond, key=lambda one: -one.by / max(one.high - one.low, _NO_RANGE))
    named = [
        said("{name} = {value} ({measured} when the model was fitted)", **one.figures)
        for one in worst[:_MOST]
    ]
    where = joined(named)
    if len(worst) > _MOST:
        where = said("{first}, and {n} more", first=where, n=len(worst) - _MOST)
    left = [
        said(
            "there {out} {unit} rms are left, on the other rows {inside}",
            out=in_digits(outside), inside=in_digits(inside), unit=unit,
        )
        for inside, outside, unit in sizes
        if math.isfinite(inside) and math.isfinite(outside)
    ]  # fmt: skip
    rows = said("all rows") if share == 1.0 else said("{share} of the rows", share=_percent(share))
    if not left:
        return said(
            "EXTRAPOLATED on {rows}: {where}. Nobody has seen whether the machine goes on there as "
            "the model does.",
            rows=rows, where=where,
        )  # fmt: skip
    return said(
        "EXTRAPOLATED on {rows}: {where}. Nobody has seen whether the machine goes on there as "
        "the model does: {left}.",
        rows=rows, where=where, left=joined(left),
    )  # fmt: skip


def _percent(share: float) -> str:
    """A share of the rows; one row of many is not none.

    >>> _percent(0.634), _percent(0.001)
    ('63 %', '0.1 %')
    """
    return f"{in_digits(share * 100.0, 2)} %"
