"""What lags behind a signal, were the signal to stay: beyond all that was measured or not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.machine.conditions import Conditions

_MOST = 10.0
"""Times all that was measured."""


def beyond_what_was_seen(result: FitResult, effect: Effect) -> bool:
    """Whether an effect behind a lag says ten times all that was measured, were its signal to stay.

    Behind a lag far longer than a signal's own cycle hardly anything of it comes: a coefficient
    that is large enough turns what comes into a shift of phase, two of them into any. They follow
    the cycle, and the signal has only to stay where it was measured for them to run away (an oil
    cooler of 1.5 K: 0.6 mm on a machine that errs by 15 µm).
    """
    model = result.model
    values = next((t.values for t in model.terms if t.effect == effect), {})
    if "tau" not in values:
        return False
    campaign = result.problem.campaign
    conditions = campaign.conditions
    seen = (campaign.kind == Kind.DISPLACEMENT) & (result.problem.weight > 0.0)
    if not seen.any() or conditions.u is None:
        return False
    read = effect.signals_needed()
    ends = []
    for end in (np.nanmin, np.nanmax):
        steady = {
            s: np.full(campaign.n, end(v)) for s, v in conditions.signals.items() if s in read
        }
        ends.append(_staying(conditions, dict(conditions.signals) | steady))
    low, high = (model.contributions(c).get(effect.spec) for c in ends)
    if low is None or high is None:
        return False
    along = np.einsum("nk,nk->n", high - low, np.nan_to_num(np.asarray(conditions.u)))[seen]
    whole = result.seen(campaign.value)[seen]
    return bool(np.sqrt(np.mean(along**2)) > _MOST * np.sqrt(np.mean(whole**2)))


def _staying(conditions: Conditions, signals: dict[str, np.ndarray]) -> Conditions:
    return replace(conditions, signals=signals, given_lags={}, _lags={}, _known=None, _made={})
