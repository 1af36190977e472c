"""Campaigns that say which compensation acted while they were measured: put back to bare.

`abbe measure` writes into a campaign's head which model's compensation was active. Nobody has to
remember it when the campaign is fitted a year later.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.head import BEGUN
from abbe.compcore.files.campaign_file import require_signals
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.design.superposition import uncompensated
from abbe.compcore.model.model import Model

TURNS = "active_turns"
"""Key of the head: the rotary axes whose own angle the compensation corrected."""


def bare(campaign: Campaign, active: Model | None = None) -> Campaign:
    """A campaign as the machine without the compensation that its files name would have shown it.

    Parameters
    ----------
    active
        The model that was compensated, in place of those that the files name.

    Raises
    ------
    InputError
        When the model that a file names is not there, or was changed since.
    """
    files = list(campaign.files)
    run = campaign.conditions.run
    for i, (path, metadata) in enumerate(zip(files, campaign.metadata, strict=False)):
        model = active
        if model is None:
            named = _active(metadata)
            if named is None:
                continue
            model = load_model(_found(Path(path), *named))
        require_signals(campaign, model)
        put_back = uncompensated(campaign, model, _turned(metadata)).value
        first = 0 if run is None else int(run.min())
        mine = np.ones(campaign.n, dtype=np.bool_) if run is None else run == first + i
        campaign = replace(campaign, value=np.where(mine, put_back, campaign.value))
    return campaign


def _turned(metadata: Mapping[str, object]) -> Sequence[str]:
    found = metadata.get(BEGUN)
    said = found.get(TURNS) if isinstance(found, Mapping) else None
    return said.split(", ") if isinstance(said, str) and said else ()


def _active(metadata: Mapping[str, object]) -> tuple[str, str] | None:
    found = metadata.get(BEGUN)
    if not isinstance(found, Mapping):
        return None
    name, digest = found.get("active"), found.get("active_sha256")
    if not isinstance(name, str) or not isinstance(digest, str):
        return None
    return name, digest


def _found(campaign: Path, name: str, digest: str) -> Path:
    path = campaign.parent / name
    if not path.is_file():
        raise InputError(
            "was measured while a compensation was active, and its model is not there",
            file=campaign,
            field=f"{BEGUN}.active",
            found=str(path),
            expected="that model; --active names it where it lies now",
        )
    now = hashlib.sha256(path.read_bytes()).hexdigest()
    if now != digest:
        raise InputError(
            "was measured while a compensation was active, and its model was changed since",
            file=campaign,
            field=f"{BEGUN}.active",
            found=f"{path}, SHA-256 {now[:12]}",
            expected=f"{digest[:12]}; --active names the right one",
        )
    return path
