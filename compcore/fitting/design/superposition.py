"""Campaigns of a machine whose compensation was active (ISO/TR 16907, 10.5).

Such a machine shows only what its tables leave. Its displacements are put back to what the bare
machine would have shown, so that one fit gives the whole error, old and new, and the new tables
replace the old. Angles are different: a compensation of displacements moves no guideway, so what
a level or an autocollimator reads is the bare machine already. But a rotary axis that is itself
compensated turns less wrong: its own angle is put back as displacements are.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.effects.targets import along
from abbe.compcore.errors import require_type
from abbe.compcore.fitting.design.observation import Observation
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]


def uncompensated(campaign: Campaign, active: Model, turning: Collection[str] = ()) -> Campaign:
    """The campaign as the machine without compensation would have shown it.

    Parameters
    ----------
    campaign
        Measured while `active` was compensated.
    active
        The model (or map) from which the controller's tables were made.
    turning
        Rotary axes whose own positioning error (E_CC of C) is compensated, too.
    """
    require_type(campaign, Campaign, "campaign")
    require_type(active, Model, "active")
    return replace(campaign, value=campaign.value + _taken_away(campaign, active, turning))


def compensated(campaign: Campaign, model: Model) -> Campaign:
    """The campaign as the machine would have shown it with a model's compensation active.

    Parameters
    ----------
    campaign
        Measured without compensation.
    model
        What would have been compensated in full; a controller's tables hold no more than that.
    """
    require_type(campaign, Campaign, "campaign")
    require_type(model, Model, "model")
    return replace(campaign, value=campaign.value - _taken_away(campaign, model))


def predicted_rows(campaign: Campaign, model: Model) -> F64:
    """What a model predicts that each row shows of the machine's error, (n,), mm or rad."""
    seen = observation_of(campaign, model)
    error = model.predict(campaign.conditions)
    moved = np.einsum("ni,ni->n", seen.toward, error.translation)
    return np.asarray(moved + np.einsum("ni,ni->n", seen.about, error.rotation))


def observation_of(campaign: Campaign, model: Model) -> Observation:
    """The directions in which a campaign's rows see the machine of a model."""
    bases = {name: np.asarray(place) for name, place in campaign.bases.items()}
    return Observation(model.machine, campaign, campaign.conditions, bases)


def _taken_away(campaign: Campaign, model: Model, turning: Collection[str] = ()) -> F64:
    """What a compensation takes out of each row, (n,), mm or rad: of angles, turned axes' own."""
    moved = (campaign.kind == Kind.DISPLACEMENT) | (campaign.kind == Kind.DISTANCE)
    turned = campaign.kind == Kind.ROTATION
    taken = np.where(moved, predicted_rows(campaign, model), 0.0)
    if not turning or not turned.any():
        return taken
    seen = observation_of(campaign, model)
    motions = model.error_motions(campaign.conditions)
    for axis in turning:
        own = along(axis)
        if own in motions:
            taken = taken + np.where(turned, seen.sensitivity(own) * motions[own], 0.0)
    return taken
