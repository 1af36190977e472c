"""A verification with the files that it rests on: read, judged, and what takes weight from it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.artefacts.permissible import PermissibleError
from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaigns, require_signals
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from abbe.compcore.files.table_set import TableSet, sha256
from abbe.compcore.model.model import Model
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.sentences import said
from abbe.compcore.verification.tolerance import Tolerance
from abbe.compcore.verification.verify import Verification, VerificationRequest, verify
from abbe.compcore.verification.words import verification_warnings
from abbe.daemon.answers import measured_under
from abbe.daemon.answers.measurements.verified_files import (
    FittedCampaigns,
    NamedModel,
    VerifiedFiles,
)
from abbe.daemon.arguments.measurements.sure import StatedMeans


@dataclass(frozen=True, eq=False)
class VerificationAnswer:
    """A verification with its files.

    Attributes
    ----------
    named
        Model and configuration.
    campaign, before
        What was judged, and what was measured before; None where nothing was.
    check, tables
        The check plan, and the tables that were active; None: not given.
    absent
        Campaigns of the fit that are not at hand.
    notes
        What else takes weight from it, by whoever had it judged.
    """

    verification: Verification
    named: NamedModel
    campaign: Campaign
    before: Campaign | None
    check: Path | None
    tables: TableSet | None
    absent: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def model(self) -> Model:
        """The model."""
        return self.named.model

    def warnings(self) -> Iterator[str]:
        """What takes weight from it."""
        yield from self.notes
        yield from verification_warnings(self.verification)
        if not self.model.fit.get("campaigns"):
            yield said("the model's file does not say to which campaigns it was fitted")
        if self.absent:
            yield said(
                "not at hand: {files}, to which the model was fitted; whether lines judged here "
                "were measured there is known by SHA-256 only (--fitted)",
                files=", ".join(self.absent),
            )

        if self.tables is not None:
            made_from = self.tables.record.get("model", {})
            if made_from.get("sha256") == sha256(self.named.path.read_bytes()):
                return
            yield said("the tables were made from another model than this one")

    @property
    def after_words(self) -> str:
        """Where the state after comes from."""
        if self.verification.measured:
            return said("measured with the compensation active")
        return said("computed: measured less what the model foretells")

    @property
    def before_words(self) -> str:
        """Where the state before comes from."""
        if self.verification.before_measured:
            return said("measured without compensation")
        return said("put back: measured and what was compensated")


def verified(
    named: NamedModel,
    known: FittedCampaigns,
    files: VerifiedFiles,
    tolerances: Sequence[Tolerance],
    permissible: PermissibleError | None,
    means: StatedMeans,
    coverage: float,
) -> VerificationAnswer:
    """Read what was measured and judge it.

    Raises
    ------
    InputError
        For bad files, and as `verify`.
    """
    model = named.model
    campaign = _campaign(files.campaigns, model)
    before = _campaign(files.before, model) if files.before else None
    tables = None if files.tables is None else TableSet.load(files.tables)
    bare = None
    if files.active is not None:
        bare = measured_under.bare(campaign, load_model(files.active))
    elif before is None:
        # abbe measure writes what was active into the head
        put_back = measured_under.bare(campaign)
        bare = None if put_back is campaign else put_back
    planned: Sequence[PlannedSetup] = ()
    if files.check is not None:
        planned = read_plan(files.check, model.machine).setups
    request = VerificationRequest(
        before,
        bare,
        known.campaign,
        tolerances,
        permissible,
        means.sure(campaign, [s.instrument.key for s in planned]),
        coverage,
        [s.name for s in planned],
        {s.name: s.count * s.runs * (1 + s.both_ways) * s.u.shape[1] for s in planned},
    )
    try:
        found = verify(model, campaign, request)
    except InputError as error:
        raise error if error.file or error.field else error.at(file=files.campaigns[0]) from None
    return VerificationAnswer(found, named, campaign, before, files.check, tables, known.absent)


def _campaign(paths: Sequence[Path], model: Model) -> Campaign:
    campaign = read_campaigns(paths, model.machine)
    require_signals(campaign, model)
    return campaign
