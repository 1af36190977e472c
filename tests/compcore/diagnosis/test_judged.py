"""Campaigns by a simulator that shares nothing with Abbe: unseen lines, and true names."""

from __future__ import annotations

from pathlib import Path

import pytest

from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model

JUDGED = Path(__file__).parents[2] / "data" / "judged"
IMITATE = {"overhang_sag", "cross_angular", "setup_scale", "workpiece_expansion", "cosine"}


def reached(name: str, start: str) -> tuple[Model, float]:
    """The model reached, and what it leaves of another day's lines, µm."""
    given = load_model(JUDGED / name / start)
    campaign = read_campaign(JUDGED / name / "fit.csv", given.machine)
    if given.effects:
        given = fit(given, campaign).model
    model = to_the_verdict(given, campaign).last.result.model
    other = read_campaign(JUDGED / name / "check.csv", given.machine)
    return model, 1e3 * compare(model, other).lengths.rms


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("name", "least"), [("null_bridge", 0.444), ("scale_one_end", 0.404)])
def test_the_bare_machine_gets_its_motions_and_nothing_that_imitates_them(
    name: str, least: float
) -> None:
    """Before, a sag of a ram, a turn along another axis and a set-up's scale: 0.89 and 1.14 µm."""
    model, left = reached(name, "bare.toml")
    kinds = {e.kind for e in model.effects}
    assert {"positioning", "straightness", "angular"} <= kinds
    assert not kinds & IMITATE
    assert left < 1.3 * least


def test_a_true_cause_is_not_exchanged_for_polynomials_over_the_volume() -> None:
    """After it χ² was noise, yet three formulas came and it went: 0.60 → 0.76 µm."""
    model, left = reached("bridge_pitch_by_Z", "usual.toml")
    specs = {e.spec for e in model.effects}
    assert "cross_angular axis=Y about=Z by=Z" in specs
    assert "formula" not in {e.kind for e in model.effects}
    assert left < 1.1 * 0.433
