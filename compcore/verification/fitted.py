"""Which lines of a test a model was fitted to: a verification on fitted data is none."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.overlap import SAME_TARGET, overlap
from abbe.compcore.model.model import Model


class FittedPart(StrEnum):
    """What of a line the model was fitted to."""

    ROWS = "rows"
    """The very readings."""
    POINTS = "points"
    """The same line with the same targets, measured at another time."""


def fitted_lines(
    campaign: Campaign, model: Model, fitted: Campaign | None
) -> Mapping[str, FittedPart]:
    """Set-up → what of it the model was fitted to; set-ups that are new are left out.

    Parameters
    ----------
    campaign
        What is judged.
    model
        Its record names the campaigns of the fit by their SHA-256.
    fitted
        Those campaigns, as far as they are at hand: rows and targets are looked up in them.
    """
    setup = campaign.conditions.setup
    if setup is None:
        return {}
    known = {str(r.get("sha256")) for r in model.fit.get("campaigns", ())}
    found: dict[str, FittedPart] = {}
    for name in campaign.setups:
        row = int(np.flatnonzero(setup == name)[0])
        if campaign.files.get(campaign.file_of(row)) in known:
            found[name] = FittedPart.ROWS
    if fitted is None:
        return found
    shared = overlap(fitted, campaign, SAME_TARGET)
    found |= {n: FittedPart.POINTS for n in shared.setups if n not in found}
    if shared.rows:
        for name in campaign.setups:
            mine = overlap(fitted, campaign.rows(setup == name))
            # a few coarse readings agree by chance
            if 2 * mine.rows > mine.of:
                found[name] = FittedPart.ROWS
    return found
