"""A model's next version without another effect: all that it has, fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.renewing import renewed_where_known
from abbe.compcore.errors import FitError
from abbe.compcore.files.campaign_file import require_signals
from abbe.compcore.files.model_file import save_model
from abbe.compcore.files.model_toml.campaign_record import campaign_records, noise_by_file
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from abbe.daemon.answers.inputs import now
from abbe.daemon.answers.model.held_out import read_held_out
from abbe.daemon.installed import abbe_version


def fitted_version(
    model: Model,
    campaign: Campaign,
    holdout: Sequence[Path],
    out: Path,
    *,
    robust: bool = False,
    renew: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Model, str]:
    """Fit all effects, lay the result beside unseen campaigns, write it; and a summary of the fit.

    With `robust` rows that do not belong to the others are set aside; with `renew` what the model
    knew before counts, where it can.

    Raises
    ------
    FitError
        Where there is nothing to fit.
    InputError
        For bad campaigns; nothing is written then.
    """
    if not model.effects or all(effect.given for effect in model.effects):
        raise FitError("there is nothing to fit: no effect of this model has a value to be found")
    held = read_held_out(holdout, model.machine, campaign)
    if held is not None:
        require_signals(held.campaign, model)
    progress("fitting the next version")
    result = fit(model, campaign, robust=robust)
    if renew:
        result = renewed_where_known(model, result, result)
    if model.fit.get("cautious") and result.renewal is None:
        result = cautiously(result)
    lengths = result.noise.lengths
    kept = recorded(
        result,
        model,
        date=now(),
        version=abbe_version(),
        noise_floor=None if lengths is None else lengths.value,
        noise_floor_rotation=result.noise.value("rotation"),
    )
    if held is not None:
        progress("campaigns that are not fitted")
        beside = compare(result.model, held.campaign)
        repeats = noise_by_file(held.campaign, model.machine)
        seen: dict[str, Any] = {
            "holdout": campaign_records(held.campaign, beside.residual, repeats),
        }
        if beside.lengths.n:
            seen["holdout_rms"] = beside.lengths.rms * 1e3
        kept = replace(kept, fit={**kept.fit, **seen})
    save_model(kept, out)
    return kept, result.summary()
