"""The machines of a fleet with their models and campaigns: from a folder, or a manifest."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.recognised import CAMPAIGN, MODEL, recognised
from abbe.compcore.files.text.bounded_text import read_bounded

_COLUMNS = ("machine", "model", "campaign")
_LARGEST = 50_000_000


@dataclass(frozen=True, slots=True)
class FleetCampaign:
    """One campaign of one machine.

    Attributes
    ----------
    machine
        The machine's name in the fleet.
    model, campaign
        Their files.
    """

    machine: str
    model: Path
    campaign: Path


def fleet_campaigns(place: Path) -> list[FleetCampaign]:
    """The campaigns of a fleet.

    Parameters
    ----------
    place
        A manifest, CSV with the columns ``machine,model,campaign`` (files beside it), a row a
        campaign; or a folder of folders: a machine each, with one model and its campaigns.

    Raises
    ------
    InputError
        Naming the folder or the row.
    """
    found = _of_folder(place) if place.is_dir() else _of_manifest(place)
    if not found:
        raise InputError(
            "no machine with a model and a campaign", file=place,
            expected="folders of a model (.toml) and campaigns (.csv), or machine,model,campaign",
        )  # fmt: skip
    return found


def _of_folder(place: Path) -> list[FleetCampaign]:
    found = []
    for folder in sorted(p for p in place.iterdir() if p.is_dir()):
        models = [p for p in sorted(folder.glob("*.toml")) if recognised(p) is MODEL]
        campaigns = [p for p in sorted(folder.rglob("*.csv")) if recognised(p) is CAMPAIGN]
        if not models and not campaigns:
            continue
        if len(models) != 1:
            raise InputError(
                "a machine's folder holds one model", file=folder,
                found=", ".join(p.name for p in models) or "none",
                expected="one, or a manifest that says which",
            )  # fmt: skip
        found += [FleetCampaign(folder.name, models[0], p) for p in campaigns]
    return found


def _of_manifest(place: Path) -> list[FleetCampaign]:
    text = read_bounded(place, _LARGEST, expected="a folder, or machine,model,campaign")
    rows = [(i, line) for i, line in enumerate(text.splitlines(), start=1)
            if line.strip() and not line.startswith("#")]  # fmt: skip
    parsed = [(i, next(csv.reader([line]))) for i, line in rows]
    if not parsed or [c.strip() for c in parsed[0][1]] != list(_COLUMNS):
        raise InputError(
            "not a manifest of a fleet", file=place, line=parsed[0][0] if parsed else 1,
            found=",".join(parsed[0][1]) if parsed else "nothing", expected=",".join(_COLUMNS),
        )  # fmt: skip
    found = []
    for line, cells in parsed[1:]:
        if len(cells) != len(_COLUMNS) or not all(c.strip() for c in cells):
            raise InputError(
                "not a cell for each column", file=place, line=line, found=",".join(cells),
                expected=",".join(_COLUMNS),
            )  # fmt: skip
        machine, *names = (c.strip() for c in cells)
        model, campaign = (place.parent / name for name in names)
        for field, file in (("model", model), ("campaign", campaign)):
            if not file.is_file():
                raise InputError(
                    "no such file", file=place, line=line, field=field, found=str(file)
                )
        found.append(FleetCampaign(machine, model, campaign))
    return found
