"""Spatial grids, the field, the volume, and what remains."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.model.model import Model
from abbe.compcore.tables.change import predicted_change
from abbe.compcore.tables.field import ErrorField, table_state
from abbe.compcore.tables.grid import spatial_grid
from abbe.compcore.tables.projection.curves.marginal import marginal
from abbe.compcore.tables.remainder import TrialPoints
from abbe.compcore.tables.volume import Volume
from tests.support.compcore.table_models import (
    five_axes,
    machine,
    random_rows,
    rigid,
    state,
    thermal,
    with_backlash,
)


def test_a_grid_is_the_model_at_its_points():
    model = rigid()
    nodes = {"X": np.array([-100.0, 77.0, 500.0]), "Y": np.array([0.0, 800.0]),
             "Z": np.array([-300.0, -20.0, 50.0])}  # fmt: skip
    tables = spatial_grid(model, state(), nodes)
    assert [t.output.component for t in tables] == list("XYZABC")
    for index in itertools.product(range(3), range(2), range(3)):
        where = {a: np.array([nodes[a][i]]) for a, i in zip("XYZ", index, strict=True)}
        found = model.predict(state().conditions(where, {}))
        got = [t.forward[index] for t in tables]
        assert got[:3] == pytest.approx(found.translation[0], abs=1e-15)
        assert got[3:] == pytest.approx(found.rotation[0], abs=1e-15)


def test_grids_of_linear_and_rotary_axes_add_up_where_they_are_separable():
    """At the linear axes' position of the rotary grid the two together are the whole error."""
    model = five_axes()
    linear = {a: np.linspace(*model.machine.axis(a).travel, 5) for a in "XYZ"}
    rotary = {a: np.linspace(-1.2, 1.2, 7) for a in ("C", "B")}
    tables = [*spatial_grid(model, state(), linear), *spatial_grid(model, state(), rotary)]
    n = 7 * 7
    mesh = np.meshgrid(rotary["C"], rotary["B"], indexing="ij")
    where = {"X": np.zeros(n), "Y": np.zeros(n), "Z": np.zeros(n),
             "C": mesh[0].reshape(-1), "B": mesh[1].reshape(-1)}  # fmt: skip
    linear_only = spatial_grid(model, state(), {a: np.zeros(1) for a in "XYZ"})
    field = ErrorField(model, state())
    total = field.removed([t for t in tables if t.inputs == ("C", "B")], where)
    total += np.array([t.forward[0, 0, 0] for t in linear_only[:3]])
    assert total == pytest.approx(field(where), abs=1e-12)
    assert all(t.at(np.zeros(1), np.zeros(1))[0] == 0.0 for t in tables[6:])


def test_a_grid_for_one_direction_has_the_backlash_in_it():
    model = with_backlash(rigid())
    nodes = {a: np.array([0.0, 10.0]) for a in "XYZ"}
    up = spatial_grid(model, state(), nodes, directions={"X": 1.0})
    both = spatial_grid(model, state(), nodes)
    assert up[0].forward - both[0].forward == pytest.approx(-0.0065)


def test_linear_and_rotary_axes_do_not_share_a_grid():
    model = five_axes()
    with pytest.raises(InputError, match="linear axes or over rotary"):
        spatial_grid(model, state(), {"X": np.zeros(1), "C": np.zeros(1)})


def test_conditions_have_to_be_stated():
    model = thermal(rigid())
    with pytest.raises(InputError, match="T_x"):
        table_state(model, {})
    with pytest.raises(InputError, match="no such signal"):
        table_state(model, {"T_x": 20.0, "T_y": 20.0, "T_z": 20.0})
    assert table_state(model, {"T_x": 21.0, "T_y": 20.0}).signals["T_x"] == 21.0


def test_a_lag_is_in_equilibrium_unless_it_is_given():
    model = thermal(rigid())
    still = ErrorField(model, state(T_y=25.0))
    where = {a: np.zeros(1) for a in "XYZ"}
    cold = ErrorField(model, state())(where)[0, 2]
    assert still(where)[0, 2] - cold == pytest.approx(5.0 * 2e-3)
    late = ErrorField(model, state(T_y=25.0))
    object.__setattr__(late.state, "lags", {("T_y", 600.0): 21.0})
    assert late(where)[0, 2] - cold == pytest.approx(1.0 * 2e-3)


def test_predicted_change_is_found_where_it_is_largest():
    model = thermal(rigid())
    volume = Volume.of(model.machine)
    change = predicted_change(model, volume, state(), state(T_x=21.0))
    # 1.1e-5/K over 500 mm at the far end
    assert change.largest == pytest.approx(1.1e-5 * 500.0, rel=0.01)
    assert change.where["X"] == pytest.approx(500.0, abs=1.0)
    assert predicted_change(model, volume, state(), state()).largest == 0.0


def test_the_volume_must_lie_inside_the_travel():
    owner = machine()
    for bad in ({"X": (0.0, 600.0)}, {"X": (5.0, 5.0)}, {"Q": (0.0, 1.0)}):
        with pytest.raises(InputError):
            Volume.of(owner, bad)
    assert Volume.of(owner, {"X": (0.0, 10.0)}).ranges["X"] == (0.0, 10.0)
    assert Volume.of(owner).ranges["Z"] == owner.axis("Z").travel


@pytest.mark.parametrize("count", [7, 13, 31, 149, 600, 997, 2591])
def test_spread_points_cover_every_axis_evenly_and_evenly_together(count):
    volume = Volume(dict.fromkeys("ABCDEF", (0.0, 1.0)))
    axes = "ABC" if count == 7 else "ABCDEF"
    points = np.stack(list(volume.spread(tuple(axes), count).values()), axis=1)
    n = len(points)
    assert n >= count
    for column in points.T:
        assert np.sort(column) == pytest.approx((np.arange(n) + 0.5) / n)
    # symmetric about the middle: the mean of anything linear is exact
    assert points.mean(axis=0) == pytest.approx(0.5)
    covariance = np.cov(points.T) * 12.0
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() < (0.6 if count < 140 else 0.12)


def test_means_and_slopes_are_those_of_many_samples():
    """Of a field with rough functions of every axis: against a plain Monte Carlo mean."""
    model = rigid(shape="table", seed=30)
    field = ErrorField(model, state())
    volume = Volume.of(model.machine)
    positions = np.linspace(-100.0, 500.0, 385)
    found = marginal(
        lambda where, facing: field(where, facing), model.machine, volume, "X", positions,
        reverses=False,
    )  # fmt: skip
    rng = np.random.default_rng(3)
    n = 40_000
    others = {a: rng.uniform(*volume.ranges[a], n) for a in "YZ"}
    base = field({"X": np.zeros(n), **others})
    for index in (0, 100, 250, 384):
        error = field({"X": np.full(n, positions[index]), **others})
        spread = (error - base).std(axis=0) / np.sqrt(n)
        mine = found.mean[0, index] - found.mean[0, 64]
        assert np.abs(mine - (error - base).mean(axis=0)).max() < 6.0 * spread.max() + 1e-5
        for a in "YZ":
            centred = others[a] - others[a].mean()
            slope = centred @ (error - base) / (centred @ centred)
            got = found.slope[a][0, index] - found.slope[a][0, 64]
            noise = 6.0 * (error - base).std(axis=0).max() / (centred.std() * np.sqrt(n))
            assert np.abs(got - slope).max() < noise + 2e-8


def test_what_remains_is_counted_without_a_shift_and_the_shift_reported():
    model = rigid()
    field = ErrorField(model, state())
    trial = TrialPoints.over(field, Volume.of(model.machine))
    left = trial.remainder()
    there = random_rows(model, 20_000)
    error = field(there)
    length = np.linalg.norm(error - error.mean(axis=0), axis=1)
    assert left.rms == pytest.approx(np.sqrt((length**2).mean()), rel=0.02)
    assert left.largest <= length.max() * 1.02
    assert left.shift == pytest.approx(error.mean(axis=0), abs=2e-4)
    worst = field({a: np.array([p]) for a, p in left.worst.items()})[0] - left.shift
    assert np.linalg.norm(worst) == pytest.approx(left.largest)


def test_an_unfitted_model_leaves_nothing_to_compensate():
    empty = Model(machine())
    assert (
        TrialPoints.over(ErrorField(empty, state()), Volume.of(empty.machine)).remainder().rms
        == 0.0
    )
