"""Set-ups that disagree with all others: said where no cause explains what is left."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from abbe.compcore.campaign.named_alike import named_alike
from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.errors import AbbeError
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.sentences import Sentence, said
from abbe.compcore.units import in_digits

_MOST_ASKED = 8
_LEAST, _MOST = 0.03, 0.5
"""Part of the rows that a group may have: less says nothing, more are not the odd ones."""
_FALLS = 0.6
"""Part of χ² per degree of freedom that is left, at the most, without set-ups that disagree."""
_WORSE = 2.0
"""Times the median of the set-ups' mean square from which on one holds more than its share."""


def disagreeing(diagnosis: Findings) -> Iterator[Sentence]:
    """The group of set-ups without which the model as it is fits far better, if there is one.

    Asked are set-ups whose names begin alike; without any, those that hold most of what is left.
    """
    if diagnosis.verdict != "unexplained":
        return
    whole = diagnosis.whole
    campaign = whole.problem.campaign
    setups = campaign.conditions.setup
    if setups is None:
        return
    square = (whole.residual * whole.problem.weight) ** 2
    names = list(campaign.setups)
    mean = {n: float(square[setups == n].mean()) for n in names if (setups == n).any()}
    worst = [n for n, size in mean.items() if size > _WORSE * float(np.median(list(mean.values())))]
    for groups in (named_alike(names)[:_MOST_ASKED], [tuple(worst)]):
        if best := _best(whole, groups):
            left, group = best
            break
    else:
        return
    yield said(
        "these set-ups disagree with all others: {names}. Without them χ² per degree of "
        "freedom is {without} instead of {all}. Look there first: what they were measured "
        "with, its temperature and coefficient of expansion, its form, how it was held",
        names=", ".join(group),
        without=in_digits(left, 3),
        all=in_digits(whole.chi2_per_dof, 3),
    )


def _best(
    whole: FitResult, groups: Iterable[tuple[str, ...]]
) -> tuple[float, tuple[str, ...]] | None:
    """χ² per degree of freedom without a group, and the group without which it is least.

    In the uncertainties of all rows: where nobody stated any, each fit takes its own from what it
    leaves, and its own χ² is the degrees of freedom.
    """
    campaign = whole.problem.campaign
    setups = campaign.conditions.setup
    if setups is None:
        return None
    best: tuple[float, tuple[str, ...]] | None = None
    for group in groups:
        kept = ~np.isin(setups, group)
        if not _LEAST < 1.0 - float(kept.mean()) < _MOST:
            continue
        try:
            without = fit(whole.model, campaign.rows(kept), near=True)
        except AbbeError:
            continue
        least = _FALLS * whole.chi2_per_dof if best is None else best[0]
        chi2 = float(np.sum((without.residual * whole.problem.weight[kept]) ** 2))
        if without.dof > 0 and chi2 < least * without.dof:
            best = (chi2 / without.dof, group)
    return best
