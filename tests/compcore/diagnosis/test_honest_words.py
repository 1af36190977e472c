"""What a diagnosis says: nothing is fitted to a turned sign, a formula explains nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.explain import explanation
from abbe.compcore.diagnosis.verdict import diagnose
from abbe.compcore.diagnosis.words import MEND_FIRST
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from abbe.daemon.report.model.diagnosis import verdict_title
from benchmarks.hidden.judging.trial import as_campaign

F64 = NDArray[np.float64]

SLIDE = parse_model(
    TomlSource("""format = "abbe-model/1"
[machine]
name = "slide"
structure = "w b X t"
[machine.axes.X]
travel = [0.0, 600.0]
""")
)

AT = np.tile(np.concatenate([np.linspace(0.0, 600.0, 25), np.linspace(600.0, 0.0, 25)]), 3)
SIDE = np.tile(np.repeat([1, -1], 25), 3)


def line(errs: F64, seed: int, sd: float = 0.3, turns: F64 | None = None) -> Campaign:
    """A line along X three times there and back, µm, and a level on the carriage, µrad."""
    rng = np.random.default_rng(seed)
    head = '# format = "abbe-campaign/1"\ntime,setup,kind,X,X_dir,tool_z,ux,uy,uz,value,sd\n'
    read = errs + rng.normal(0.0, 0.3, len(AT))
    rows = [
        f"{20 * i},laser,displacement,{x:.1f},{d},-100,1,0,0,{v:.3f},{sd}"
        for i, (x, d, v) in enumerate(zip(AT, SIDE, read, strict=True))
    ]
    if turns is not None:
        read = turns + rng.normal(0.0, 0.3, len(AT))
        rows += [
            f"{20 * i + 9000},level,rotation,{x:.1f},{d},-100,0,1,0,{v:.3f},{sd}"
            for i, (x, d, v) in enumerate(zip(AT, SIDE, read, strict=True))
        ]
    return as_campaign(head + "\n".join(rows) + "\n", SLIDE)


def fitted(campaign: Campaign, *effects: tuple[str, dict[str, object]]) -> Model:
    model = SLIDE
    for kind, where in effects:
        model, _ = with_effect(model, kind, where)
    day = "2026-03-02T08:00:00+00:00"
    return recorded(fit(model, campaign), model, date=day, version="0", noise_floor=None)


def test_a_model_is_not_fitted_to_a_turned_sign() -> None:
    model = fitted(line(0.02 * AT, 1), ("scale", {"axis": "X"}))
    words = list(diagnose(model, line(-0.02 * AT, 2)).words())
    assert any("SUSPICIOUS" in w and "sign is wrong" in w for w in words)
    assert any(MEND_FIRST in w for w in words)
    assert not any("the new values" in w for w in words)
    words = list(diagnose(model, line(0.022 * AT, 2)).words())
    assert any("the new values" in w for w in words)  # a scale that has changed by 2 ppm


def test_uncertainties_that_are_too_large_are_said_first() -> None:
    model = fitted(line(0.02 * AT, 1), ("scale", {"axis": "X"}))
    words = list(diagnose(model, line(0.02 * AT, 2, sd=3.0)).words())
    assert words[0].startswith("SUSPICIOUS: χ²/dof is 0.009")
    assert not next(diagnose(model, line(0.02 * AT, 2)).words()).startswith("SUSPICIOUS")


def test_millimetres_for_micrometres_are_said_first_of_a_bare_machine() -> None:
    """20 ppm of a slide in mm: 0.02 µm at most, which no slide and no laser shows."""
    read = line(0.02 * AT, 1)
    wrong = replace(read, value=read.value / 1e3, sd=read.sd / 1e3)
    words = list(diagnose(SLIDE, wrong).words())
    assert words[0].startswith("SUSPICIOUS: the displacements vary by")
    assert "written in mm" in words[0]
    assert not next(diagnose(SLIDE, read).words()).startswith("SUSPICIOUS")


def test_what_a_formula_describes_is_not_called_complete_alone() -> None:
    errs = 8.0 * (AT / 300.0 - 1.0) ** 2
    bow = fitted(line(errs, 1), ("formula", {"channel": "dX", "terms": ["((X-300)/300)**2"]}))
    found = diagnose(bow, line(errs, 2))
    assert found.verdict == "complete"
    text = "\n".join(found.words())
    assert "complete: nothing more is missing; part of the error (X) is described" in text
    assert "nothing that is missing" not in text
    assert verdict_title(found).startswith("Nothing more is missing")
    plain = diagnose(SLIDE, line(0.0 * AT, 3))
    assert "nothing that is missing" in "\n".join(plain.words())
    assert verdict_title(plain) == "Nothing is missing"


def test_of_several_causes_none_explains_best_and_each_stands_where_it_acts() -> None:
    """A scale moves no level, though beside a pitch its signature has something there."""
    pitch = 20.0 * np.sin(AT / 80.0)
    found = diagnose(SLIDE, line(0.03 * AT - 0.1 * pitch, 4, turns=pitch))
    kinds = {e.effect.kind: explanation(e, found) for e in found.established}
    assert {"scale", "angular"} <= set(kinds)
    assert all("explains the residuals best" not in text for text in kinds.values())
    assert "most of it in laser;" in kinds["scale"]
    assert "level" in kinds["angular"].split("Typical causes")[0]
