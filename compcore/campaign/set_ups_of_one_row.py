"""Campaigns of which each row is a set-up of its own: zeros take up all that was measured."""

from __future__ import annotations

import numpy as np

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError


def require_rows_together(campaign: Campaign) -> None:
    """Refuse a campaign of whose every row the unknown zero of its own set-up leaves nothing.

    Raises
    ------
    InputError
        Where nothing would be left that a model could be compared with or fitted to.
    """
    setup = campaign.conditions.setup
    if setup is None or (campaign.kind >= Kind.DISTANCE).any():
        return
    names = np.unique(setup)
    if len(names) < max(2, campaign.n) or not all(
        "zero" in campaign.setups[str(name)].free for name in names if str(name) in campaign.setups
    ):
        return
    raise InputError(
        "each row is a set-up of its own, and its unknown zero takes up what was measured: "
        "nothing is left over",
        file=next(iter(campaign.files), None),
        field="setup",
        found=f"{len(names)} set-ups in {campaign.n} rows",
        expected="one name for all rows of one placing of the instrument",
    )
