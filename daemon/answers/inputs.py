"""The files that an analysing command starts from, read and checked against each other."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.files.campaign_file import read_campaigns, require_signals
from abbe.compcore.files.model_file import load_model
from abbe.compcore.model.model import Model
from abbe.daemon.answers.measured_under import bare


def load(
    model: Path, campaigns: Sequence[Path], active: Path | None = None
) -> tuple[Model, Campaign]:
    """A model and the campaigns to lay beside it, joined.

    `active` is the model whose compensation was active while measuring: displacements are put back
    to what the bare machine would have shown. Without it, what the campaigns themselves say.

    Raises
    ------
    InputError
        For bad files, and when a campaign lacks a signal that an effect of the model needs.
    """
    loaded = load_model(model)
    campaign = read_campaigns(campaigns, loaded.machine)
    require_signals(campaign, loaded)
    if active is None:
        return loaded, bare(campaign)
    return loaded, bare(campaign, load_model(active))


def now() -> str:
    """The date and time of a fit, UTC, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")
