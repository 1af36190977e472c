"""Days on which a model's campaigns were measured, and on which another one was."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.model.model import Model


def day(stated: object) -> str | None:
    """The day of a date as a head or a record states it, ISO 8601; None of anything else."""
    try:
        return date.fromisoformat(str(stated)[:10]).isoformat()
    except ValueError:
        return None


def fitted_days(model: Model) -> list[str | None]:
    """The days of the campaigns to which a model was fitted; None of those that say none."""
    records = model.fit.get("campaigns", ())
    return [day(r.get("conditions", {}).get("date")) for r in records if isinstance(r, Mapping)]


def measured_days(campaign: Campaign) -> list[str | None]:
    """The days of a campaign's files; None of those that say none."""
    return [day(head.get("date")) for head in campaign.metadata]


def of_another_day(model: Model, campaign: Campaign) -> bool | None:
    """Whether a campaign is of none of the days to which a model was fitted; None: not known."""
    fitted, measured = fitted_days(model), measured_days(campaign)
    if not fitted or not measured or None in fitted or None in measured:
        return None
    return not set(fitted) & set(measured)


def of_their_day(model: Model) -> list[str]:
    """What holds on the day only to which it was fitted, for people."""
    return [
        f"{spec} holds on the day only to which it was fitted, and is not applied"
        for spec in model.of_their_day
    ]
