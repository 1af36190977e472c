"""The campaigns that a model is laid beside at present, and those that are held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaigns, require_signals
from abbe.compcore.model.model import Model
from abbe.daemon.answers.measured_under import bare
from abbe.daemon.answers.model.held_out import read_held_out
from abbe.daemon.workbench.versions.seen_file import SeenFile


@dataclass(frozen=True, eq=False)
class LaidCampaigns:
    """Files, read; at first there may be none.

    Attributes
    ----------
    fitted
        Files that the model is laid beside and fitted to.
    held
        Files that are held out.
    campaign
        The rows of `fitted`, joined; None: there are none.
    notes
        What is not new about `held`.
    seen
        The files of `fitted` and `held`, as they were read.
    """

    fitted: tuple[Path, ...] = ()
    held: tuple[Path, ...] = ()
    campaign: Campaign | None = None
    notes: tuple[str, ...] = ()
    seen: tuple[SeenFile, ...] = ()

    @property
    def rows(self) -> Campaign:
        """The rows of `fitted`.

        Raises
        ------
        InputError
            Where there are none yet.
        """
        if self.campaign is None:
            raise InputError(
                "there is no campaign yet", expected="one that is chosen or dropped under Compare"
            )
        return self.campaign


def lay(model: Model, fitted: Sequence[Path], held: Sequence[Path] = ()) -> LaidCampaigns:
    """Read campaigns for a model.

    Raises
    ------
    InputError
        For bad files, and when one lacks a signal that an effect of the model needs.
    """
    if not fitted:
        return LaidCampaigns()
    seen = tuple(SeenFile(path) for path in (*fitted, *held))
    campaign = read_campaigns(fitted, model.machine)
    require_signals(campaign, model)
    campaign = bare(campaign)
    found = read_held_out(held, model.machine, campaign)
    if found is not None:
        require_signals(found.campaign, model)
    notes = () if found is None else tuple(found.notes())
    return LaidCampaigns(tuple(fitted), tuple(held), campaign, notes, seen)
