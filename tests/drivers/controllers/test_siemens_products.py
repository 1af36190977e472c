"""Levers in CEC tables: right on the control however it reads the manual, beside a closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.effects import Angular, RotaryTilt
from abbe.compcore.errors import InputError
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.project import project
from abbe.compcore.tables.remainder import TrialPoints
from abbe.compcore.tables.volume import Volume
from abbe.drivers.controllers import make_controller
from tests.support.compcore.table_models import TRAVELS, machine, rigid, state, with_backlash
from tests.support.drivers.controllers.sinumerik import READINGS, moved_by

MIRRORED = {"products": "mirrored"}
TOOL = -120.0


def pitching() -> Model:
    """X pitches about Y, from 0 to 60 µrad over its travel; Z hangs on X."""
    owner = machine("w b Y X Z t")
    effect = Angular(axis="X", about="Y", shape="polynomial:1")
    names = [p.name for p in effect.linear(owner)]
    base = Model(owner, (Term(effect, {n: Value(1.0) for n in names}),))
    ends = {a: np.zeros(2) for a in "YZ"} | {"X": np.array(TRAVELS["X"])}
    unit = ErrorField(base, state((0.0, 0.0, 1.0)))(ends)[:, 0]
    size = 6e-5 / np.abs(np.diff(unit))[0]
    return Model(owner, (Term(effect, {n: Value(size) for n in names}),))


def places(seed: int = 3, count: int = 4000) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {a: rng.uniform(*TRAVELS[a], count) for a in "XYZ"}


def files_of(model: Model, options: dict[str, str], volume: Volume | None = None):
    controller = make_controller("siemens-840d", model.machine, options)
    field = ErrorField(model, state((0.0, 0.0, TOOL)), "command")
    volume = Volume.of(model.machine) if volume is None else volume
    found = project(field, volume, controller.capability)
    tables = controller.adapted(found.tables)
    return controller.write(tables), tables, found.notes, field


@pytest.mark.parametrize("reading", READINGS)
def test_a_pitch_and_its_lever_leave_nothing(reading):
    """Closed form: X is off by the angle, even in x, times the height of the tool's tip."""
    model = pitching()
    files, _, _, field = files_of(model, MIRRORED)
    where = places()
    low, high = TRAVELS["X"]
    angle = field({"X": np.array([high]), "Y": np.zeros(1), "Z": np.zeros(1)})[0, 0] / TOOL
    assert abs(angle) > 1e-5
    start = field({"X": np.array([low]), "Y": np.zeros(1), "Z": np.zeros(1)})[0, 0] / TOOL
    closed = (start + (angle - start) * (where["X"] - low) / (high - low)) * (where["Z"] + TOOL)
    assert np.ptp(closed) > 0.020
    left = moved_by(files, where, reading)
    left[:, 0] += closed
    left -= left.mean(axis=0)
    # three roundings of 1 nm, and 20 µm of error looked up 20 µm beside
    assert np.abs(left).max() < 5e-6


def test_without_products_the_lever_stays():
    model = pitching()
    files, _, _, field = files_of(model, {})
    where = places()
    left = field(where) + moved_by(files, where, "the product stands alone")
    assert np.ptp(left[:, 0]) > 0.008


def test_a_product_written_once_depends_on_the_reading():
    """What the second half is for: without it the readings differ by tenths of a millimetre."""
    files, tables, _, _ = files_of(pitching(), MIRRORED)
    (product,) = [t for t in tables if t.lever]
    blocks = files["nc_cec.ini"].split("$AN_CEC_IS_MODULO")
    first = {"nc_cec.ini": "$AN_CEC_IS_MODULO".join(blocks[:-3])}
    assert product.name == "E_XX·Z"
    found = [moved_by(first, places(), reading)[:, 0] for reading in READINGS]
    assert np.abs(found[0] - found[1]).max() > 0.05
    whole = [moved_by(files, places(), reading)[:, 0] for reading in READINGS]
    assert np.abs(whole[0] - whole[1]).max() < 1e-12


@pytest.mark.one_in(2)
@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("code", ["w b Y X Z t", "w X' b Y Z t"])
def test_a_rigid_machine_on_the_control(code, reading):
    """All 21 errors: what is left is as printed, and a fraction of what single axes leave."""
    model = rigid(code, seed=6)
    files, tables, _, field = files_of(model, MIRRORED)
    single, _, _, _ = files_of(model, {})
    where = places()
    error = field(where)
    left = error + moved_by(files, where, reading)
    before = error + moved_by(single, where, reading)
    rms, without = (np.sqrt(((e - e.mean(axis=0)) ** 2).sum(axis=1).mean()) for e in (left, before))
    remainder = TrialPoints.over(field, Volume.of(model.machine)).remainder(tables)
    assert rms == pytest.approx(remainder.rms, rel=0.05)
    assert rms < 0.15 * without
    # a factor that is forgotten must not move the axis by millimetres
    largest = max(
        abs(float(line.split("=")[1]))
        for line in files["nc_cec.ini"].splitlines()
        if line.startswith("$AN_CEC[")
    )
    assert largest < 0.3


def test_they_are_best_in_the_stated_volume():
    """A volume beside the middle: levers count from its middle, tables reach over the travel."""
    model = rigid(seed=6)
    volume = Volume.of(model.machine, {"X": (0.0, 220.5), "Z": (-250.0, -90.25)})
    rng = np.random.default_rng(8)
    where = {a: rng.uniform(*volume.ranges[a], 3000) for a in "XYZ"}
    few = MIRRORED | {"cec_tables": "14"}
    left = []
    for best_in in (volume, None):
        files, tables, _, field = files_of(model, few, best_in)
        error = field(where) + moved_by(files, where, "both factors act as well")
        left.append(float(np.square(error - error.mean(axis=0)).sum()))
        if best_in is not None:
            assert {t.lever for t in tables if t.lever} <= {("Z", -170.125), ("X", 110.25)}
            assert all(t.nodes[0][0] <= TRAVELS[t.inputs[0]][0] for t in tables)
    assert left[0] < 0.8 * left[1]


def test_a_control_with_few_tables_gets_those_that_do_most():
    model = rigid(seed=6)
    trial = None
    left = []
    for count in (5, 6, 8, 14, 30, 62):
        options = MIRRORED | {"cec_tables": str(count)}
        files, tables, notes, field = files_of(model, options)
        assert files["nc_cec.ini"].count("$AN_CEC_STEP") <= count
        trial = TrialPoints.over(field, Volume.of(model.machine)) if trial is None else trial
        left.append(trial.remainder(tables).rms)
        assert any("no table for" in n for n in notes) == (count < 30)
    assert left == sorted(left, reverse=True)
    assert left[0] > 2.0 * left[-1]


def test_reversal_still_takes_two_tables_beside_products():
    model = with_backlash(rigid(seed=6))
    files, tables, _, _ = files_of(model, MIRRORED | {"pitch": "cec"})
    own = next(t for t in tables if t.name == "E_XX")
    assert own.directional
    assert not any(t.directional for t in tables if t.lever)
    text = files["nc_cec.ini"]
    assert text.count("_DIRECTION[") == text.count("DIRECTION[") > 20
    assert "]=-1\n" in text
    controller = make_controller("siemens-840d", model.machine, MIRRORED | {"pitch": "cec"})
    controller.check(tables, files)


def test_a_rotary_axis_that_tilts_has_products_too():
    owner = machine("w C' b X Y Z t")
    effect = RotaryTilt(axis="C", direction="X")
    names = [p.name for p in effect.linear(owner)]
    model = Model(owner, (Term(effect, {n: Value(2e-5 * (k + 1)) for k, n in enumerate(names)}),))
    files, tables, _, _ = files_of(model, MIRRORED)
    assert any(t.lever and t.inputs == ("C",) for t in tables)
    make_controller("siemens-840d", owner, MIRRORED).check(tables, files)


def test_tables_of_another_volume_are_added_to():
    """Present ones whose levers count from elsewhere: the sum is the same anywhere."""
    model = rigid(seed=6)
    field = ErrorField(model, state((0.0, 0.0, TOOL)), "command")
    controller = make_controller("siemens-840d", model.machine, MIRRORED)
    capability = controller.capability
    part = Volume.of(model.machine, {"X": (0.0, 200.0), "Z": (-250.0, -90.0)})
    there = controller.adapted(project(field, part, capability).tables)
    whole = Volume.of(model.machine)
    fine = replace(capability, holds=tuple(replace(h, zero_at=None) for h in capability.holds))
    plain = project(field, whole, fine).tables
    added = project(field, whole, fine, present=there).tables
    assert {t.lever for t in added} == {t.lever for t in plain}
    where = places(count=800)
    total = field.removed(added, where)
    both = field.removed(plain, where) + field.removed(there, where)
    assert total == pytest.approx(both, abs=8e-4)
    with pytest.raises(InputError, match="no counterpart"):
        project(field, whole, capability.without("product"), present=there)
