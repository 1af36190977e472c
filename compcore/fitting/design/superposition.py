"""Campaigns of a machine whose compensation was active (ISO/TR 16907, 10.5).

Such a machine shows only what its tables leave. Its displacements are put back to what the bare
machine would have shown, so that one fit gives the whole error, old and new, and the new tables
replace the old. Angles are different: a compensation of displacements moves no guideway, so what
a level or an autocollimator reads is the bare machine already.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import require_type
from abbe.compcore.fitting.design.observation import Observation
from abbe.compcore.model.model import Model


def uncompensated(campaign: Campaign, active: Model) -> Campaign:
    """The campaign as the machine without compensation would have shown it.

    Parameters
    ----------
    campaign
        Measured while `active` was compensated.
    active
        The model (or map) from which the controller's tables were made.
    """
    require_type(campaign, Campaign, "campaign")
    require_type(active, Model, "active")
    conditions = campaign.conditions
    error = active.predict(conditions).translation
    bases = {name: np.asarray(place) for name, place in campaign.bases.items()}
    seen = Observation(active.machine, campaign, conditions, bases)
    back = np.einsum("ni,ni->n", seen.toward, error)
    moved = (campaign.kind == Kind.DISPLACEMENT) | (campaign.kind == Kind.DISTANCE)
    return replace(campaign, value=campaign.value + np.where(moved, back, 0.0))
