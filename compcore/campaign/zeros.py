"""Set-ups of which a part counts from another zero, as was noticed afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from abbe.compcore.campaign.campaign import PART, Campaign, Setup


def with_zeros(campaign: Campaign, zeros_at: Mapping[str, Sequence[float]]) -> Campaign:
    """A campaign of which some set-ups are several, one for each zero.

    Parameters
    ----------
    zeros_at
        Set-up → times, s, increasing, from each of which on its rows count from another zero.

    Returns
    -------
    The campaign; the second zero of ``01_laser`` is called ``01_laser.1-2``, of ``01_laser.2`` it
    is ``01_laser.2-2``.
    """
    setup, time = campaign.conditions.setup, campaign.conditions.time
    if setup is None or not zeros_at:
        return campaign
    names, setups = setup.astype(object), dict(campaign.setups)
    for name, times in zeros_at.items():
        mine = setup == name
        for number, begins in enumerate(times, start=2):
            later = mine & (time >= begins)
            if later.any():
                other = f"{name}{'' if PART in name else f'{PART}1'}-{number}"
                names[later] = other
                setups[other] = Setup(other, campaign.setups[name].free)
    conditions = replace(campaign.conditions, setup=names.astype(np.str_))
    return replace(campaign, conditions=conditions, setups=setups)
