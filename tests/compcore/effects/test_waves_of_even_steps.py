"""A plain positioning error that is read in even steps is fitted by no screw's short wave."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.campaign.sampling import alias, looks_alike
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.effects import Cyclic
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model

AXES = {a: Axis(a, (0.0, 700.0)) for a in "XYZ"}
MACHINE = Machine("bridge", Structure.parse("w b Y X Z t"), AXES, {})


@pytest.mark.parametrize("step", [1.0, 7.0, 50.0, 200.0])
def test_no_period_is_tried_that_even_steps_show_as_a_longer_one(step: float):
    """Read every 50 mm, a wave of 6.2 mm is one of 775 mm: a plain positioning error."""
    (seen,) = Cyclic(axis="X").search(MACHINE, Coverage(steps={"X": step}))
    assert all(p > 2.0 * step or alias(step, p) <= 60.0 for p in seen.starts)
    assert (10.0 in seen.starts) == (step < 10.0), "read every 7 mm, 10 mm look like 23 mm"
    assert seen.bounds[1] == pytest.approx(700.0)


def test_uneven_steps_and_other_axes_narrow_nothing():
    (free,) = Cyclic(axis="X").nonlinear(MACHINE)
    for coverage in (Coverage(), Coverage(steps={"Y": 50.0})):
        assert Cyclic(axis="X").search(MACHINE, coverage) == (free,)
    assert Cyclic(axis="X", period=10.0).search(MACHINE, Coverage(steps={"X": 50.0})) == ()
    assert np.isfinite(free.bounds).all()


def test_of_leads_that_even_steps_show_alike_the_commonest_is_named_and_the_others_said(
    tmp_path: Path,
) -> None:
    """Read every 600/22 mm, leads of 5, 6 and 50 mm and a wave of 60 mm are one and the same."""
    rng = np.random.default_rng(8)
    at = np.tile(np.linspace(0.0, 600.0, 23), 5)
    value = 1.5 * np.sin(2.0 * np.pi * at / 5.0 + 0.7) + rng.normal(0.0, 0.3, len(at))
    rows = [f"x,displacement,{q:.4f},350,350,1,0,0,{v:.3f}" for q, v in zip(at, value, strict=True)]
    top = ['# format = "abbe-campaign/1"', "setup,kind,X,Y,Z,ux,uy,uz,value"]
    (tmp_path / "x.csv").write_text("\n".join([*top, *rows]) + "\n")
    found = diagnose(Model(MACHINE, ()), read_campaign(tmp_path / "x.csv", MACHINE))
    (cause,) = found.established
    assert cause.effect.spec == "cyclic axis=X"
    (period,) = [e.value for e in cause.estimates if e.name == "period"]
    assert period == pytest.approx(5.0, abs=0.01)
    said = " ".join(found.words())
    assert "X is read every 27.27 mm" in said
    assert "shows a period of 5 mm as it shows those of 6 and 50 mm" in said


@pytest.mark.parametrize("step", [3.0, 7.0, 27.0, 50.0])
def test_waves_that_look_alike_do(step: float) -> None:
    at = step * np.arange(30)
    for wave in looks_alike(step, 10.0, 2.0):
        both = np.column_stack([np.cos(2 * np.pi * at / wave), np.sin(2 * np.pi * at / wave)])
        left = np.cos(2 * np.pi * at / 10.0 + 0.3)
        left -= both @ np.linalg.lstsq(both, left, rcond=None)[0]
        assert np.abs(left).max() < 1e-6
