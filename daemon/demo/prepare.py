"""What comes before the live part of the demo: measure the machine, fit its model."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from compcore.campaign_file import read_campaign
from compcore.errors import InputError
from compcore.fit import FitResult, fit
from compcore.fit_record import recorded
from compcore.model_file import load_model, save_model
from daemon.demo.simulator import measure_bridge

START = Path(__file__).with_name("bridge.toml")
"""The machine and the effects to look for, without parameter values."""

Step = Callable[[str], AbstractContextManager[Callable[[str], None]]]
"""Begins a step of a known name; what it gives is told the step's outcome in a few words."""


@dataclass(frozen=True)
class Workshop:
    """The demo's folder and the files in it."""

    folder: Path

    @property
    def start(self) -> Path:
        """The model before the fit."""
        return self.folder / "model-start.toml"

    @property
    def campaign(self) -> Path:
        """The measurements."""
        return self.folder / "campaign.csv"

    @property
    def model(self) -> Path:
        """The fitted model."""
        return self.folder / "model.toml"

    @property
    def config(self) -> Path:
        """The configuration of the live part."""
        return self.folder / "config.toml"


def prepare(seed: int, shop: Workshop, step: Step) -> FitResult:
    """Measure the machine with that seed and fit the demo's model to the measurements.

    Nothing is known of the machine but what its instruments show: the campaign file.

    Raises
    ------
    InputError
        When the folder cannot be written.
    AbbeError
        When the measurement fails.
    """
    try:
        shop.folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(START, shop.start)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", file=shop.folder) from None
    with step("Measure the machine: laser, straightness optics, levels") as done:
        measure_bridge(seed, str(shop.campaign))
        model = load_model(shop.start)
        campaign = read_campaign(shop.campaign, model.machine)
        done(f"{campaign.n} readings in {shop.campaign}")
    with step("Fit a model to the measurements") as done:
        result = fit(model, campaign)
        save_model(
            recorded(
                result,
                model,
                date=datetime.now(UTC).isoformat(timespec="seconds"),
                version=version("abbe"),
                noise_floor=None,
            ),
            shop.model,
        )
        count = sum(len(term.values) for term in result.model.terms)
        done(
            f"{len(model.terms)} effects, {count} parameters in {shop.model}; χ² per degree of "
            f"freedom {result.chi2_per_dof:.2f} (1: what is left is noise)"
        )
    return result
