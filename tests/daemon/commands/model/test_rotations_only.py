"""Campaigns that have only rotations (stars, levels, an autocollimator), from fit to history."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.model.revise import with_effect
from abbe.daemon.answers.model.first_fit import fitted_version
from tests.support.daemon.command_line import abbe

DATA = Path(__file__).parents[3] / "data" / "real" / "r01-telescope"
MODEL = DATA / "model.toml"
NIGHT, OTHER = DATA / "20230924.csv", DATA / "20210821.csv"


def test_an_effect_is_added_in_microradians(tmp_path: Path) -> None:
    out = tmp_path / "next.toml"
    spec = ("rotary_location", "axis=C")
    done = abbe("add", MODEL, *spec, "--campaign", NIGHT, "--holdout", OTHER, "-o", out)
    assert done.status == 0, done.err
    assert "nan" not in done.out
    before, after = re.findall(r"fitted campaigns: ([0-9.]+) → ([0-9.]+) µrad rms", done.out)[0]
    assert float(after) < float(before)
    assert re.search(r"held-out campaigns: [0-9.]+ → [0-9.]+ µrad rms", done.out)
    assert "WARNING" not in done.out
    assert len(load_model(out).effects) == 1
    found = json.loads(
        abbe("add", MODEL, *spec, "--campaign", NIGHT, "--holdout", OTHER, "-o", out, "--json").out
    )
    assert found["unit"] == "urad"
    assert math.isclose(found["rms_after"], float(after), abs_tol=0.001)
    assert found["holdout_after"] < found["holdout_before"]


def test_a_cause_that_predicts_no_other_night_is_warned_of(tmp_path: Path) -> None:
    """Of lengths the warning was there; of rotations the error compared was no number."""
    out = tmp_path / "next.toml"
    spec = ("formula", "channel=E_BB", "terms=sin(t/97)")
    done = abbe("add", MODEL, *spec, "--campaign", NIGHT, "--holdout", OTHER, "-o", out)
    assert done.status == 0, done.err
    assert "WARNING: the held-out error did not fall" in done.out


def test_a_fit_with_a_held_out_night_is_read_again(tmp_path: Path) -> None:
    """What the workbench's first fit writes."""
    model = load_model(MODEL)
    out = tmp_path / "fitted.toml"
    more, _ = with_effect(model, "rotary_location", {"axis": "C"})
    fitted_version(more, read_campaign(NIGHT, model.machine), [OTHER], out)
    assert load_model(out).fit["holdout"]
