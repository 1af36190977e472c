"""Error motions of rotary axes beyond the arc that they were made of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.stepwise.to_the_verdict import to_the_verdict
from abbe.compcore.effects.catalogue.rotary.motions import RotaryPositioning, RotaryTilt
from abbe.compcore.effects.catalogue.rotary.over_an_arc import RotaryMotion
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import add_effect

MACHINE = Machine("hour axis", Structure.parse("w b C t"), {"C": Axis("C", (-np.pi, np.pi))}, {})


def amount(effect: RotaryMotion, degrees: float, values: Sequence[float]) -> float:
    """The motion at one angle with given coefficients."""
    conditions = Conditions.at({"C": np.deg2rad(degrees)})
    (motion,) = effect.motions(MACHINE, conditions, {})
    return float((motion.columns @ np.array(values))[0])


def night(folder: Path, name: str, low: float, high: float, wave: float = 10.0) -> Campaign:
    """Readings of an hour axis with a worm of 2° and a drift that bends, as a guider logs them."""
    rng = np.random.default_rng(5)
    at = np.linspace(low, high, 120)
    x = (at - 5.0) / 5.0
    value = wave * np.sin(np.pi * at) + 25.0 * (x - x**2 / 2.0) + rng.normal(0.0, 3.0, len(at))
    rows = [
        f"{240 * q:.1f},s,rotation,{q:.5f},0,0,1,{v:.2f}" for q, v in zip(at, value, strict=True)
    ]
    top = ['# format = "abbe-campaign/1"', "time,setup,kind,C,ux,uy,uz,value"]
    (folder / name).write_text("\n".join([*top, *rows]) + "\n")
    return read_campaign(folder / name, MACHINE)


def test_a_wave_holds_the_value_of_the_nearer_end_and_comes_again_after_a_turn():
    wave = RotaryPositioning(axis="C", harmonics=1, within=(10.0, 40.0))
    values = (30e-6, -20e-6)
    for degrees, as_at in ((25.0, 25.0), (41.0, 40.0), (180.0, 40.0), (-30.0, 10.0), (385.0, 25.0)):
        angle = np.deg2rad(as_at)
        truth = 30e-6 * np.cos(angle) - 20e-6 * np.sin(angle)
        assert amount(wave, degrees, values) == pytest.approx(truth, abs=1e-15), degrees
    assert wave.kinks(MACHINE)["C"] == pytest.approx(np.deg2rad([10.0, 40.0]))


def test_a_curve_holds_its_ends_inside_of_the_travel():
    values = np.linspace(-1e-4, 3e-4, 8) ** 2
    free = RotaryTilt(axis="C", direction="X", shape="spline:8")
    held = free.model_copy(update={"within": (-50.0, 20.0)})
    assert amount(held, -20.0, values) == amount(free, -20.0, values)
    assert amount(held, -90.0, values) == amount(free, -50.0, values)
    assert amount(held, 170.0, values) == amount(free, 20.0, values)


@pytest.mark.parametrize(
    ("shape", "read", "within"),
    [
        (None, (3.0, 18.0), (3.0, 18.0)),
        (None, (0.0, 100.0), ()),
        ("spline:8", (0.0, 100.0), (0.0, 100.0)),
        ("spline:8", (-179.0, 179.0), ()),
        ("constant", (0.0, 10.0), ()),
    ],
)
def test_less_than_a_quarter_of_a_turn_and_curves_are_held(
    shape: str | None, read: tuple[float, float], within: tuple[float, ...]
):
    low, high = np.deg2rad(read)
    effect = RotaryPositioning(axis="C", shape=shape).held_beyond(MACHINE.axes["C"], (low, high))
    assert effect.within == pytest.approx(within, abs=2e-3)
    proposed = RotaryPositioning.candidates(
        MACHINE, Coverage(frozenset("C"), ends={"C": (low, high)})
    )
    assert all(bool(e.within) == (read[1] - read[0] < 90.0) for e in proposed)


@pytest.mark.parametrize("within", [(3.0,), (5.0, 2.0), (1.0, 2.0, 3.0)])
def test_what_is_no_arc_is_refused(within: tuple[float, ...]):
    with pytest.raises(InputError, match="not the ends of an arc"):
        make_effect("rotary_positioning", {"axis": "C", "within": within})


def test_a_fit_to_rows_beyond_reaches_them(tmp_path: Path):
    """The parameters of a model that was held were made of less: they are fitted to all."""
    model = add_effect(Model(MACHINE, ()), "rotary_positioning", axis="C", within=(2.0, 8.0))
    (wider,) = fit(model, night(tmp_path, "a.csv", 0.0, 15.0)).model.effects
    assert wider.where()["within"] == pytest.approx([0.0, 15.0], abs=2e-3)
    (free,) = fit(model, night(tmp_path, "b.csv", -60.0, 60.0)).model.effects
    assert "within" not in free.where(), "two thirds of a turn's wave are seen"


def test_the_next_hour_of_a_guider_is_foretold_no_worse_than_by_nothing(tmp_path: Path):
    """A drift that bends looks, within 10°, like waves of a turn of a milliradian."""
    first, then = night(tmp_path, "a.csv", 0.0, 10.0), night(tmp_path, "b.csv", 10.0, 15.0)
    bare = Model(MACHINE, ())
    found = to_the_verdict(bare, first).last.result.model
    assert any(e.kind == "cyclic" for e in found.effects)
    left, nothing = (compare(m, then).rotations.rms for m in (found, bare))
    assert left < nothing
