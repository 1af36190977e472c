"""What others make of the same days: a linear regression in a spreadsheet, and black boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.fitting.fit import FitResult
from benchmarks.alternatives import black_box
from benchmarks.hidden.judging.inputs import inputs

F64 = NDArray[np.float64]

SPREADSHEET = (
    "*Spreadsheet*: each measured direction by ordinary least squares (LINEST) on all recorded "
    "signals, with a constant for each day; where there are several places, also on each signal "
    "times X, Y and Z"
)


def day_of(campaign: Campaign) -> NDArray[np.int64]:
    """A number for each row's set-up of its day, (n,)."""
    setup = campaign.conditions.setup
    names = np.zeros(campaign.n, dtype="<U1") if setup is None else setup
    return np.unique(names, return_inverse=True)[1].reshape(-1)


def centred(values: F64, groups: NDArray[np.int64]) -> F64:
    """Values, (n,) or (n, k), less the mean of the row's own set-up."""
    out = np.array(values, dtype=np.float64)
    for group in np.unique(groups):
        rows = groups == group
        out[rows] -= out[rows].mean(axis=0)
    return out


def rms(values: F64, campaign: Campaign) -> float:
    """Root mean square of values of a campaign, mm, with each set-up's own zero."""
    return float(np.sqrt(np.mean(centred(values, day_of(campaign)) ** 2)))


def spreadsheet(seen: Campaign, unseen: Campaign) -> F64:
    """What a linear regression foretells of later days, mm, (n,)."""
    here, there = _columns(seen, seen), _columns(unseen, seen)
    out = np.zeros(unseen.n)
    of_seen, of_unseen = seen.measured_components(), unseen.measured_components()
    for letter in np.unique(of_seen):
        rows, later = of_seen == letter, of_unseen == letter
        groups = day_of(seen)[rows]
        columns, values = centred(here[rows], groups), centred(seen.value[rows], groups)
        found = np.linalg.lstsq(columns, values, rcond=1e-12)[0]
        out[later] = there[later] @ found
    return out


def _columns(campaign: Campaign, like: Campaign) -> F64:
    c = campaign.conditions
    signals = [c.signal(s) - like.conditions.signal(s).mean() for s in like.conditions.signals]
    places = [q for a, q in c.positions.items() if np.ptp(like.conditions.position(a)) > 0.0]
    if not places:
        return np.stack(signals, axis=1)
    # a place's own constant, and what each signal does in it
    scaled = [(q - q.mean()) / 100.0 for q in places]
    products = [s * q for s in signals for q in scaled]
    return np.stack([*signals, *products, *scaled], axis=1)


def boxes(result: FitResult, unseen: Campaign) -> dict[str, F64]:
    """What the black boxes foretell of later days from the bare machine's residuals, mm, (n,)."""
    here, there = inputs(result, unseen)
    return {
        "process": black_box.gaussian_process(result, here, there).unseen,
        "boosting": black_box.boosting(result, here, there).unseen,
    }
