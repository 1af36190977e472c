"""Machines of a type as folders: one a machine, with a model and campaigns in it."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.daemon.fleet.uploading.machine_files import fitted_at, is_campaign


@dataclass(frozen=True, slots=True)
class MachineFolder:
    """A machine's files.

    Attributes
    ----------
    name
        Of the machine.
    model
        The one that runs, or the newest.
    campaigns
        Oldest first.
    """

    name: str
    model: Path
    campaigns: Sequence[Path]


def of_folder(folder: Path) -> MachineFolder:
    """The newest model and all campaigns of a folder, as ``abbe fleet files`` writes one.

    Raises
    ------
    InputError
        For a folder without a model.
    """
    if not folder.is_dir():
        raise InputError("no such folder", file=folder, expected="one for each machine")
    models: list[tuple[datetime, Path]] = []
    for path in sorted(folder.glob("*.toml")):
        try:
            fitted = fitted_at(path.read_bytes())
        except (ValueError, OSError, tomllib.TOMLDecodeError):
            continue
        models.append((_utc(fitted or datetime.min), path))
    if not models:
        raise InputError("holds no model", file=folder, expected="a model and its campaigns")
    campaigns = [p for p in sorted(folder.glob("*.csv")) if _looks_like_a_campaign(p)]
    return MachineFolder(folder.resolve().name, max(models)[1], campaigns)


@contextmanager
def of_store(url: str, site: str, kind: str) -> Iterator[list[MachineFolder]]:
    """The machines of a type in the store, in folders that are gone afterwards.

    Raises
    ------
    InputError
        Where the machines are of several types.
    """
    from abbe.daemon.fleet.asked.reading import FleetStore
    from abbe.daemon.fleet.asked.taken_out import take_out
    from abbe.daemon.fleet.store.connecting import opened_store

    with TemporaryDirectory(prefix="abbe-fleet-") as made:
        found = []
        with opened_store(url) as connection:
            store = FleetStore(connection)
            machines = store.machines(site, kind)
            types = sorted({m.type for m in machines})
            if len(types) > 1:
                raise InputError(
                    "machines of several types",
                    field="--type",
                    expected="one of " + ", ".join(types),
                )
            for machine in machines:
                taken = take_out(store, machine, Path(made) / str(machine.number))
                if taken.model is not None:
                    found.append(MachineFolder(machine.name, taken.model, taken.campaigns))
        yield found


def measured_at(campaign: Campaign, file: Path) -> datetime:
    """When a campaign was measured: as it says at its top, else when its file was changed last."""
    for metadata in campaign.metadata:
        said = metadata.get("date")
        if isinstance(said, datetime):
            return _utc(said)
        if isinstance(said, date):
            return datetime(said.year, said.month, said.day, tzinfo=UTC)
        if isinstance(said, str):
            try:
                return _utc(datetime.fromisoformat(said))
            except ValueError:
                continue
    return datetime.fromtimestamp(file.stat().st_mtime, UTC)


def _utc(moment: datetime) -> datetime:
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)


def _looks_like_a_campaign(path: Path) -> bool:
    with path.open("rb") as file:
        return is_campaign(file.read(4096)) and path.name != "checks.csv"
