"""A gantry with two drives, and a cross-rail R: against exact chains written out here."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.compensator.compensator import Compensator
from abbe.compcore.effects import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from benchmarks.sources.campaigns import Rows

MASTER, SLAVE = -60.0, 1240.0
KEYS = {"axis": "Y", "signal": "ahead", "across": "X", "master": MASTER, "slave": SLAVE}
ZERO = 0.012


def machine(code: str = "w b Y X Z t") -> Machine:
    structure = Structure.parse(code)
    return Machine("", structure, {a: Axis(a, (-100.0, 1300.0)) for a in structure.axes},
                   {"ahead": Signal("ahead", unit="mm")})  # fmt: skip


def model(zero: float = ZERO, code: str = "w b Y X Z t", keys=KEYS) -> Model:
    effect = make_effect("two_drives", keys)
    return Model(machine(code), (Term(effect, {"zero": Value(zero)}),))


def exactly(ahead, y, x, z, tool):
    """Where the tool's tip is: a rigid bridge that hangs on two scales.

    The master's point (MASTER, y) is on its scale; the slave's, SLAVE − MASTER away, has gone
    `ahead` further. Everything on the bridge turns with it about the master's point.
    """
    turned = np.arcsin((ahead - ZERO) / (SLAVE - MASTER))
    c, s = np.cos(turned), np.sin(turned)
    on_bridge = np.array([x + tool[0] - MASTER, tool[1], z + tool[2]])
    moved = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ on_bridge
    return moved + np.array([MASTER, y, 0.0])


def test_the_error_is_that_of_a_bridge_on_two_scales():
    rng = np.random.default_rng(1)
    for _ in range(20):
        x, y, z = rng.uniform(0.0, 1200.0, 3)
        tool, ahead = rng.uniform(-200.0, 200.0, 3), rng.uniform(-0.1, 0.1)
        true = exactly(ahead, y, x, z, tool) - np.array([x, y, z]) - tool
        at = Conditions({"X": np.array([x]), "Y": np.array([y]), "Z": np.array([z])},
                        tool=tool[None], signals={"ahead": np.array([ahead])})  # fmt: skip
        found = model().predict(at).translation[0]
        # second order: half the angle squared (1e-4)² · 1.5 m
        np.testing.assert_allclose(found, true, atol=1e-5)
        assert np.abs(true[1]) < 0.2


@pytest.mark.parametrize(
    ("code", "keys", "at_slave"),
    [
        ("w b Y X Z t", KEYS, (0.0, 1.0, 0.0)),
        ("w b X Y Z t", {**KEYS, "axis": "X", "across": "Y"}, (1.0, 0.0, 0.0)),
        ("w Y' b X Z t", KEYS, (0.0, 1.0, 0.0)),
        ("w b Z X Y t", {**KEYS, "axis": "Z", "across": "Y"}, (0.0, 0.0, 1.0)),
        ("w X' b R Y Z t", {**KEYS, "axis": "R", "across": "Y"}, (0.0, 0.0, 1.0)),
    ],
)
def test_at_the_slaves_scale_the_tool_is_ahead_and_at_the_masters_it_is_not(code, keys, at_slave):
    """By hand: the point over a scale moves as the encoder there says, whatever the structure."""
    of = model(0.0, code, keys)
    across = keys["across"]
    for place, expected in ((MASTER, np.zeros(3)), (SLAVE, np.array(at_slave) * 0.03)):
        positions = {a: np.zeros(1) for a in of.machine.axes} | {across: np.array([place])}
        at = Conditions(positions, signals={"ahead": np.array([0.03])})
        np.testing.assert_allclose(of.predict(at).translation[0], expected, atol=1e-12)


def test_a_fit_finds_where_the_bridge_is_square(tmp_path):
    """Lines along Y at both sides while the slave wanders; the truth is the exact bridge."""
    rng = np.random.default_rng(3)
    rows = Rows(("X", "Y", "Z"))
    for name, x in (("left", 0.0), ("right", 1200.0)):
        y = np.linspace(0.0, 1200.0, 41)
        ahead = 0.05 * np.sin(y / 180.0 + x)
        value = np.array([exactly(a, q, x, 0.0, np.zeros(3))[1] - q
                          for a, q in zip(ahead, y, strict=True)])  # fmt: skip
        rows.add(name, Kind.DISPLACEMENT, {"X": x, "Y": y, "Z": 0.0},
                 value + rng.normal(0.0, 5e-4, len(y)), 5e-4, u=(0.0, 1.0, 0.0), free=(),
                 signals={"ahead": ahead})  # fmt: skip
    start = Model(machine()).with_effects(make_effect("two_drives", KEYS))
    result = fit(start, rows.campaign("lines"))
    zero = result.model.terms[0].values["zero"]
    assert zero.sd is not None
    assert abs(zero.value - ZERO) < 4.0 * zero.sd
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.4)
    save_model(result.model, tmp_path / "m.toml")
    assert load_model(tmp_path / "m.toml").terms == result.model.terms


def test_live_the_correction_follows_the_slave():
    of = model()
    live = Compensator(of)
    assert live.signals == ("ahead",)
    for ahead in (0.0, 0.03, -0.07):
        live.update(0.0, {"ahead": ahead})
        found = live.step(tuple({"Y": 700.0, "X": 900.0, "Z": 0.0}[a] for a in live.axes))
        true = exactly(ahead, 700.0, 900.0, 0.0, np.zeros(3)) - np.array([900.0, 700.0, 0.0])
        np.testing.assert_allclose(found, true, atol=2e-5)


@pytest.mark.parametrize(
    ("change", "words"),
    [({"across": "Y"}, "not apart along itself"), ({"slave": MASTER}, "two drives at one place"),
     ({"signal": "T"}, "no such signal"), ({"axis": "C"}, "no such axis")],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        Model(machine()).with_effects(make_effect("two_drives", {**KEYS, **change}))


def test_a_cross_rail_stands_in_the_structure_code():
    """ISO/TR 16907, 6.2, note: R is the cross-rail, along Z, which carries the others."""
    portal = machine("w X' b R Y Z t")
    assert portal.structure.linear == ("X", "R", "Y", "Z")
    assert str(portal.structure) == "w X' b R Y Z t"
    assert portal.axis("R").direction == (0.0, 0.0, 1.0)
    # the rail sags and tilts by 20 µrad about X when it is up: with Y and the ram Z behind it
    effects = (
        Term(make_effect("angular", {"axis": "R", "about": "X", "shape": "polynomial:0"}),
             {"c0": Value(20e-6)}),
    )  # fmt: skip
    at = Conditions({"X": np.array([300.0]), "R": np.array([500.0]), "Y": np.array([800.0]),
                     "Z": np.array([-200.0])}, tool=np.array([[0.0, 0.0, -100.0]]))  # fmt: skip
    found = Model(portal, effects).predict(at)
    a = 20e-6  # by hand: Rx(a) on (0, 800, -300) from the rail's frame
    turned = np.array([0.0, 800 * np.cos(a) + 300 * np.sin(a), 800 * np.sin(a) - 300 * np.cos(a)])
    np.testing.assert_allclose(found.translation[0], turned - [0.0, 800.0, -300.0], atol=1e-6)
