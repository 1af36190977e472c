"""Campaigns that are to test a model: held out is only what was not fitted (ISO/TR 16907, 11.3)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.overlap import Overlap, overlap
from abbe.compcore.comparison.words import OTHER_SETUPS
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, read_campaigns
from abbe.compcore.machine.machine import Machine
from abbe.compcore.sentences import said
from abbe.daemon.answers.measured_under import bare

_MOST_LISTED = 6


@dataclass(frozen=True, eq=False)
class HeldOutCampaigns:
    """Campaigns that were not fitted, joined, and what each shares with those that were."""

    campaign: Campaign
    shared: dict[str, Overlap]

    @property
    def rows(self) -> int:
        """Rows that were fitted as well."""
        return sum(o.rows for o in self.shared.values())

    @property
    def setups(self) -> tuple[str, ...]:
        """Set-ups that were fitted as well, or whose points were."""
        return tuple(dict.fromkeys(s for o in self.shared.values() for s in o.setups))

    def notes(self) -> Iterator[str]:
        """What is not new about them, for people."""
        for path, found in self.shared.items():
            # where it lies says nothing to whoever dropped it on a page
            file = PurePath(path).name
            if found.rows:
                yield said(
                    "NOT HELD OUT: {rows} of {of} rows of {file} are among the rows that are "
                    "fitted; the figures below flatter the model",
                    rows=found.rows,
                    of=found.of,
                    file=file,
                )
            elif found.setups:
                names = ", ".join(found.setups[:_MOST_LISTED])
                more = len(found.setups) - _MOST_LISTED
                names += f" and {more} more" if more > 0 else ""
                yield said(
                    "{file} repeats points that were fitted (its set-ups {names}): {rule}",
                    file=file,
                    names=names,
                    rule=OTHER_SETUPS,
                )


def read_held_out(
    paths: Sequence[Path], machine: Machine, fitted: Campaign
) -> HeldOutCampaigns | None:
    """The campaigns of ``--holdout``, beside those that are fitted; None without any.

    Raises
    ------
    InputError
        For bad files, and for a file that is fitted: the same one, or one with the same rows.
    """
    if not paths:
        return None
    shared = {}
    for path in paths:
        single = read_campaign(path, machine)
        found = overlap(fitted, single)
        if set(single.files.values()) & set(fitted.files.values()) or found.same:
            raise InputError(
                "this campaign is fitted and cannot be held out",
                file=path,
                field="--holdout",
                found=f"{found.rows} of its {found.of} rows are among those of --campaign",
                expected=OTHER_SETUPS,
            )
        shared[str(path)] = found
    return HeldOutCampaigns(bare(read_campaigns(list(paths), machine)), shared)


def shares(held_out: HeldOutCampaigns | None) -> dict[str, Any] | None:
    """What held-out campaigns share with the fitted ones, for JSON."""
    return None if held_out is None else {"rows": held_out.rows, "setups": [*held_out.setups]}
