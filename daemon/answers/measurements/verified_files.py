"""The files of a verification: model or configuration, and what the model was fitted to."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.join import join_campaigns
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.recognised import CONFIG, recognised
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model


@dataclass(frozen=True, eq=False)
class NamedModel:
    """A model as the command line names it.

    Attributes
    ----------
    model, path
        The model and its file.
    config
        The configuration that names it; None where the model itself was given.
    """

    model: Model
    path: Path
    config: Path | None


def named_model(path: Path) -> NamedModel:
    """The model of a file: a model, or a configuration that names one.

    Raises
    ------
    InputError
        For a bad file.
    """
    if recognised(path) is not CONFIG:
        return NamedModel(load_model(path), path, None)
    from abbe.daemon.config import load_config

    config = load_config(path)
    return NamedModel(config.model, config.model_path, path)


@dataclass(frozen=True)
class VerifiedFiles:
    """The files that a verification is asked about.

    Attributes
    ----------
    campaigns, before, fitted
        What is judged, what was measured before, what the model was fitted to.
    active, check, tables
        The model that was compensated, the check plan, the tables' folder; None: not given.
    """

    campaigns: tuple[Path, ...]
    before: tuple[Path, ...] = ()
    active: Path | None = None
    check: Path | None = None
    tables: Path | None = None
    fitted: tuple[Path, ...] = ()

    def all(self) -> list[Path | None]:
        """Every one, also those that are not given."""
        more = (self.active, self.check, self.tables)
        return [*self.campaigns, *self.before, *self.fitted, *more]


@dataclass(frozen=True, eq=False)
class FittedCampaigns:
    """The campaigns of a model's fit.

    Attributes
    ----------
    campaign
        Those that are at hand, joined; None without any.
    absent
        Those that are not, by the names in the model's record.
    """

    campaign: Campaign | None
    absent: tuple[str, ...]


def fitted_campaigns(named: NamedModel, given: Sequence[Path] = ()) -> FittedCampaigns:
    """The campaigns that a model was fitted to: as given, else where its record says they are.

    A file of the record counts where it still has the SHA-256 that was fitted; it is looked for
    where it was, and beside the model.

    Raises
    ------
    InputError
        For a given file that is bad.
    """
    machine = named.model.machine
    parts = [read_campaign(path, machine) for path in given]
    known = {sha256 for part in parts for sha256 in part.files.values()}
    absent = []
    for file, sha256 in _recorded(named.model):
        if sha256 in known:
            continue
        known.add(sha256)
        found = _found(Path(file), named.path.parent, sha256, machine)
        if found is None:
            absent.append(file)
        else:
            parts.append(found)
    return FittedCampaigns(join_campaigns(parts) if parts else None, tuple(absent))


def _recorded(model: Model) -> Iterator[tuple[str, str]]:
    for record in model.fit.get("campaigns", ()):
        if isinstance(record, Mapping) and record.get("file") and record.get("sha256"):
            yield str(record["file"]), str(record["sha256"])


def _found(file: Path, beside: Path, sha256: str, machine: Machine) -> Campaign | None:
    for path in (file, beside / file, beside / file.name):
        try:
            if hashlib.sha256(path.read_bytes()).hexdigest() == sha256:
                return read_campaign(path, machine)
        except (OSError, InputError):
            continue
    return None
