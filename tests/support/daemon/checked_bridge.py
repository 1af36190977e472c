"""The simulated bridge with its fitted model, and a year of its checks, as files."""

from __future__ import annotations

from pathlib import Path

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.fitting.fit import fit
from abbe.daemon.demo.prepare import START
from abbe.drivers.simulated.bridge.checks import WhatHappens, year_of_checks
from abbe.drivers.simulated.bridge.measure import campaign

FITTED = "2026-01-04T12:00:00+00:00"
"""The day before the first check."""


def fitted_bridge(folder: Path) -> Path:
    """``model.toml``: what the machine was when it was measured."""
    (folder / "campaign.csv").write_text(campaign(1), "utf-8")
    start = load_model(START)
    result = fit(start, read_campaign(folder / "campaign.csv", start.machine))
    model = recorded(result, start, date=FITTED, version="0", noise_floor=None)
    save_model(model, folder / "model.toml")
    return folder / "model.toml"


def year(folder: Path, what: WhatHappens, checks: int = 250, number: int = 0) -> Path:
    """``WHAT.csv``: a year of checks, in which it happens at the 120th."""
    path = folder / f"{what}.csv"
    path.write_text(year_of_checks(1, what, checks=checks, year=number), "utf-8")
    return path
