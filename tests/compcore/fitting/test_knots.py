"""Knots that are found: against a truth with known knots, and against SciPy's splines."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.compensator.compensator import Compensator
from abbe.compcore.effects import make_effect
from abbe.compcore.effects.shapes import Shape
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, write_campaign
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import add_effect
from benchmarks.sources.campaigns import Rows

LENGTH = 600.0
KNOTS = (160.0, 300.0, 420.0)
NOISE = 0.4e-3
COEFFICIENTS = np.array([0.0, 2.0, -6.0, 9.0, -8.0, 6.0, 1.0]) * 1e-3
MACHINE = Machine(
    "", Structure.parse("w b X Y Z t"), {a: Axis(a, (0.0, LENGTH)) for a in "XYZ"}
)  # fmt: skip


def truth(x):
    """A cubic spline by SciPy, with three knots, mm."""
    knots = np.concatenate([[0.0] * 4, KNOTS, [LENGTH] * 4])
    return BSpline(knots, COEFFICIENTS, 3)(x)


def measured(seed: int, curve=truth, noise: float = NOISE, sd: float = NOISE, n: int = 61):
    """A laser along X, up and down twice."""
    rng = np.random.default_rng(seed)
    x = np.tile(np.linspace(0.0, LENGTH, n), 4)
    rows = Rows(("X", "Y", "Z"))
    rows.add("line", Kind.DISPLACEMENT, {"X": x}, curve(x) + rng.normal(0.0, noise, len(x)), sd,
             u=(1.0, 0.0, 0.0), free=())  # fmt: skip
    return rows.campaign("laser")


def model(shape: str = "spline:auto") -> Model:
    return Model(MACHINE).with_effects(make_effect("positioning", {"axis": "X", "shape": shape}))


@pytest.mark.parametrize("knots", [(), (200.0,), (20.0, 31.0, 450.0, 599.0)])
def test_the_basis_is_that_of_scipy(knots):
    x = np.concatenate([np.linspace(0.0, LENGTH, 301), knots])
    mine = Shape.parse("spline:auto", knots).basis(x, MACHINE.axis("X"))
    whole = np.concatenate([[0.0] * 4, knots, [LENGTH] * 4])
    theirs = BSpline.design_matrix(x, whole, 3).toarray()
    np.testing.assert_allclose(mine, theirs, atol=1e-12)


def test_knots_at_equal_distances_are_a_plain_spline():
    x = np.linspace(-20.0, 620.0, 200)  # held beyond the ends
    axis = MACHINE.axis("X")
    auto = Shape.parse("spline:auto", (150.0, 300.0, 450.0))
    np.testing.assert_allclose(auto.basis(x, axis), Shape.parse("spline:7").basis(x, axis))
    assert auto.names == Shape.parse("spline:7").names


@pytest.mark.parametrize(
    ("knots", "words"),
    [((300.0, 200.0), "not the inner knots"), ((0.0,), "outside of the travel"),
     ((100.0, 700.0), "outside of the travel")],
)  # fmt: skip
def test_knots_that_cannot_be_are_refused(knots, words):
    keys = {"axis": "X", "shape": "spline:auto", "positions": knots}
    with pytest.raises(InputError, match=words):
        Model(MACHINE).with_effects(make_effect("positioning", keys))


@pytest.mark.parametrize("seed", range(3))
def test_knots_are_found_where_they_are(seed):
    result = fit(model(), measured(seed))
    (found,) = result.knots
    assert found.probability[len(found.knots)] == max(found.probability.values())
    assert sum(found.probability.values()) == pytest.approx(1.0)
    # each true knot has one near, as near as the stated spread says
    for knot in KNOTS:
        off = np.abs(np.array(found.knots) - knot)
        assert off.min() < max(3.0 * found.spread[int(off.argmin())], 30.0)
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.3)
    x = np.linspace(0.0, LENGTH, 200)
    predicted = result.model.predict(Conditions({"X": x, "Y": 0.0, "Z": 0.0})).translation[:, 0]
    assert np.abs(predicted - truth(x)).max() < 5.0 * NOISE / np.sqrt(4)


def test_a_cubic_needs_none():
    counts = [
        len(fit(model(), measured(seed, lambda x: 1e-8 * (x - 300.0) ** 2)).knots[0].knots)
        for seed in range(6)
    ]
    assert np.median(counts) == 0.0
    assert max(counts) <= 2


def test_better_than_knots_at_equal_distances():
    """A dip around 280 mm: as many coefficients, evenly, leave twice as much."""

    def dip(x):
        knots = np.concatenate([[0.0] * 4, [120.0, 200.0, 280.0, 360.0, 440.0], [LENGTH] * 4])
        return BSpline(knots, np.array([0, 0, 0, 0, -8, 0, 0, 0, 0]) * 1e-3, 3)(x)

    campaign = measured(1, dip, noise=0.1e-3, sd=0.1e-3, n=121)
    auto = fit(model(), campaign)
    count = len(auto.model.terms[0].values)
    uniform = fit(model(f"spline:{count}"), campaign)
    x = np.linspace(0.0, LENGTH, 400)
    left = {
        name: np.abs(
            r.model.predict(Conditions({"X": x, "Y": 0.0, "Z": 0.0})).translation[:, 0] - dip(x)
        ).max()
        for name, r in (("auto", auto), ("uniform", uniform))
    }
    assert left["auto"] < 0.5 * left["uniform"]


@pytest.mark.parametrize("stated", [0.1, 1.0, 10.0])
def test_uncertainties_that_are_stated_wrongly_make_no_knots(stated):
    right = fit(model(), measured(2)).knots[0].knots
    assert fit(model(), measured(2, sd=stated * NOISE)).knots[0].knots == right


def test_the_model_keeps_its_knots_and_the_next_fit_finds_its_own(tmp_path):
    write_campaign(measured(0), tmp_path / "line.csv")
    result = fit(model(), read_campaign(tmp_path / "line.csv", MACHINE))
    record = recorded(result, model(), date="2026-01-01", version="0", noise_floor=None)
    save_model(record, tmp_path / "m.toml")
    loaded = load_model(tmp_path / "m.toml")
    effect = loaded.effects[0]
    assert effect.shape == "spline:auto"
    assert effect.positions == result.knots[0].knots
    assert loaded.fit["knots"][0]["places"] == list(effect.positions)
    x = np.linspace(-10.0, 610.0, 50)
    where = Conditions({"X": x, "Y": 0.0, "Z": 0.0})
    same = loaded.predict(where).translation
    np.testing.assert_allclose(same, result.model.predict(where).translation, atol=1e-12)
    live = Compensator(loaded)  # the same through folded tables
    live.update(0.0, {})
    found = live.errors(np.column_stack([x, np.zeros((50, 2))]))
    np.testing.assert_allclose(found, same, atol=2e-5)
    again = fit(loaded, measured(0, lambda x: 1e-8 * (x - 300.0) ** 2))
    assert again.knots[0].knots != result.knots[0].knots


def test_added_to_a_model_it_takes_the_place_of_the_plain_spline():
    start = fit(model("spline:5"), measured(0)).model
    more = add_effect(start, "positioning axis=X shape=spline:auto")
    assert [e.spec for e in more.effects] == ["positioning axis=X shape=spline:auto"]
    assert len(fit(more, measured(0)).knots) == 1


def test_the_words_say_how_sure():
    text = fit(model(), measured(0)).report()
    (line,) = [line for line in text.splitlines() if line.startswith("knots of")]
    assert " ± " in line
    assert "how many, by evidence" in line
    assert "other choices move the curve by ±" in line
