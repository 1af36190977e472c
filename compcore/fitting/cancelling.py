"""Effects that cancel each other: each of them much larger than all that was measured."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.fitting.solution import Solution
from abbe.compcore.sentences import said
from abbe.compcore.units import in_digits

_BEYOND = 3.0
"""Times all that was measured: the others cancel nine tenths of the square of such an effect."""


def cancelling(result: Solution) -> tuple[float, list[tuple[str, float]]]:
    """RMS of the measured displacements, mm, and the effects that cancel, largest first.

    What set-ups leave unknown (zeros, slopes, frames) is taken off both. One effect alone that is
    so large is none: nothing could cancel it.
    """
    problem = result.problem
    campaign, conditions = problem.campaign, problem.campaign.conditions
    seen = (campaign.kind == Kind.DISPLACEMENT) & (problem.weight > 0.0)
    if not seen.any() or conditions.u is None:
        return 0.0, []
    eliminator = problem.eliminator(result.theta)

    def size(value: np.ndarray) -> float:
        weighted = np.where(seen, value, 0.0) * problem.weight
        left = np.where(seen, value, 0.0) - eliminator.share(weighted)
        return float(np.sqrt(np.mean(left[seen] ** 2)))

    u = np.nan_to_num(np.asarray(conditions.u))
    whole = size(campaign.value)
    parts = {
        spec: size(np.einsum("nk,nk->n", part, u))
        for spec, part in result.model.contributions(conditions).items()
    }
    large = sorted(((s, v) for s, v in parts.items() if v > _BEYOND * whole), key=lambda f: -f[1])
    return whole, large if len(large) > 1 else []


def cancel_lines(result: Solution) -> Iterator[str]:
    """That effects cancel, which, and what to do about it; nothing where none do."""
    whole, large = cancelling(result)
    if large:
        yield said(
            "CANCEL: {effects} work against each other: all that was measured is {whole} µm rms. "
            "Only what is left of them together was seen, and only where it was measured; none of "
            "them by itself is true of this machine. Make no table of a single axis of them; abbe "
            "fit --cautious keeps them small, and measuring where their axes move apart tells "
            "which is which",
            effects="; ".join(f"{_short(spec)} ({in_digits(v * 1e3)} µm rms)" for spec, v in large),
            whole=in_digits(whole * 1e3),
        )  # fmt: skip


def _short(spec: str) -> str:
    """A formula of many terms by its channel, all others as they are typed."""
    kind, _, rest = spec.partition(" ")
    return f"{kind} {rest.partition(' ')[0]}" if kind == "formula" else spec
