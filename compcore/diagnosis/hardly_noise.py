"""Where no cause is established, yet what is left is hardly noise: too few rows, or few repeats."""

from __future__ import annotations

import math
from collections.abc import Callable

from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.distributions import f_beyond
from abbe.compcore.sentences import Sentence, said
from abbe.compcore.units import in_digits

_FEW = 12
"""Degrees of freedom below which a campaign is a handful of rows."""

_HARDLY_CHANCE = 0.05
"""Chance, over all causes that were tried, below which a handful of rows is not called noise."""

_BEYOND = 1e-4
"""Chance below which more is left than repeats scatter, as of χ² where these weigh the rows."""


def too_few_rows(diagnosis: Findings, adding: Callable[[str], str]) -> Sentence | None:
    """Of a handful of rows that chance alone hardly makes: the likeliest cause, not established."""
    if diagnosis.verdict not in ("complete", "unexplained") or diagnosis.whole.dof >= _FEW:
        return None
    # of what every machine has; and a curve through all readings explains whatever they are
    hardly = [
        f
        for f in diagnosis.ranked
        if f.candidate.expected
        and f.screened.rank < diagnosis.whole.dof
        and f.evidence.log_p < math.log(_HARDLY_CHANCE)
    ]
    if not hardly:
        return None
    first = min(hardly, key=lambda f: (f.screened.rank, -f.evidence.value))
    return said(
        "too few rows to establish a cause ({n}), and hardly noise: the likeliest is {spec} (by "
        "chance 1 in {odds}). Measure more targets, there and back; or add it, if you know that it "
        "is there: {how}",
        n=diagnosis.whole.problem.n,
        spec=first.candidate.effect.spec,
        odds=in_digits(1.0 / max(first.evidence.p_value, 1e-9), 1),
        how=adding(first.candidate.effect.spec),
    )


def beyond_repeats(diagnosis: Findings, noise: NoiseFloor) -> bool:
    """Whether more is left than repeats scatter, where these are too few to weigh the rows by."""
    level = noise.levels.get("rotation") if diagnosis.of_rotations else noise.lengths
    if level is None or level.value is None or level.degrees_of_freedom <= 0.0:
        return False
    left = (diagnosis.rms / level.value) ** 2 * diagnosis.whole.problem.n / diagnosis.whole.dof
    return f_beyond(left, diagnosis.whole.dof, level.degrees_of_freedom) < _BEYOND
