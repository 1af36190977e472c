"""The best tables: against brute-force least squares, and within every limit of a controller."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.compcore.errors import InputError
from abbe.compcore.model.inverse import invert_model
from abbe.compcore.tables.capability import RIGID, Capability, Holds, Increment, Spacing
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.curves.curve import Curve, fit_tables
from abbe.compcore.tables.projection.project import project
from abbe.compcore.tables.remainder import TrialPoints
from abbe.compcore.tables.table import Sign, Table, move
from abbe.compcore.tables.volume import Volume
from tests.support.compcore.table_models import (
    TRAVELS,
    five_axes,
    not_rigid,
    random_rows,
    rigid,
    state,
    thermal,
    with_backlash,
)

POS = Holds("axis", ("L-POS",), points=300, directional=True)
STR = Holds("cross", ("L-STR",), points=300, directional=True)
ANG = Holds("product", ("L-ANG",), points=300, directional=True)
BOTH = Capability((POS, STR), lookup="indicated")


def hat_columns(where: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Piecewise linear interpolation, written apart from the code under test."""
    return np.stack([np.interp(where, nodes, row) for row in np.eye(len(nodes))], axis=1)


def brute_force(field: ErrorField, volume: Volume, inputs: dict[str, str]):
    """Dense least squares of the field at random points on hats of some axes, for each output.

    The hats' nodes include those of the machine's own tables, 14 on each axis.
    """
    rng = np.random.default_rng(11)
    axes = field.model.machine.structure.axes
    where = {a: rng.uniform(*volume.ranges[a], 2500) for a in axes}
    error = field(where)
    nodes = {}
    for a in axes:
        low, high = volume.ranges[a]
        inner = np.linspace(*TRAVELS[a], 14)
        inner = inner[(inner > low + 1.0) & (inner < high - 1.0)]
        nodes[a] = np.sort([low, *inner, high, *(0.5 * (inner[1:] + inner[:-1]))])
    found = {}
    for k, output in enumerate("XYZ"):
        columns = [hat_columns(where[a], nodes[a]) for a in inputs[output]]
        design = np.concatenate(columns, axis=1)
        found[output] = np.linalg.lstsq(design, error[:, k], rcond=1e-9)[0]

    def removed(there: dict[str, np.ndarray]) -> np.ndarray:
        parts = []
        for output in "XYZ":
            columns = [hat_columns(there[a], nodes[a]) for a in inputs[output]]
            parts.append(np.concatenate(columns, axis=1) @ found[output])
        return np.stack(parts, axis=1)

    return removed


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt(((errors - errors.mean(axis=0)) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("shape", ["spline:6", "table"])
@pytest.mark.parametrize("code", ["w b Y X Z t", "w X' b Y Z t", "w X' Y' b Z t"])
def test_nothing_leaves_less_than_the_projection(code, shape):
    """L-POS and L-STR against least squares over random points of the volume."""
    field = ErrorField(rigid(code, shape=shape), state())
    volume = Volume.of(field.model.machine, {"X": (0.0, 400.0)})
    found = project(field, volume, BOTH, tolerance=1e-5).tables
    rival = brute_force(field, volume, dict.fromkeys("XYZ", "XYZ"))
    rng = np.random.default_rng(5)
    there = {a: rng.uniform(*r, 5000) for a, r in volume.ranges.items()}
    error = field(there)
    mine = rms(error - field.removed(found, there))
    theirs = rms(error - rival(there))
    assert mine < 0.6 * rms(error)
    assert mine <= theirs * 1.002
    assert mine >= theirs * 0.97


def test_positioning_alone_takes_the_mean_over_the_other_axes():
    field = ErrorField(rigid(seed=4), state())
    volume = Volume.of(field.model.machine)
    capability = replace(BOTH, holds=(POS,))
    found = project(field, volume, capability, tolerance=1e-5).tables
    rival = brute_force(field, volume, {"X": "X", "Y": "Y", "Z": "Z"})
    there = random_rows(field.model, 5000)
    error = field(there)
    mine, theirs = rms(error - field.removed(found, there)), rms(error - rival(there))
    assert mine == pytest.approx(theirs, rel=0.01)


def test_the_error_on_one_line_would_be_a_worse_table():
    """What a laser along one edge would put into the controller leaves more of the volume."""
    field = ErrorField(rigid(seed=2), state())
    volume = Volume.of(field.model.machine)
    trial = TrialPoints.over(field, volume)
    best = trial.remainder(project(field, volume, BOTH).tables)
    edge = []
    for axis in "XYZ":
        nodes = np.linspace(*TRAVELS[axis], 41)
        where = {a: np.full(41, TRAVELS[a][0]) for a in "XYZ"} | {axis: nodes}
        along = field(where)
        for k, output in enumerate("XYZ"):
            edge.append(Table(move(output), (axis,), (nodes,), along[:, k] - along[0, k]))
    assert trial.remainder(edge).rms > 1.3 * best.rms


def test_products_hold_the_levers_of_a_rigid_machine():
    field = ErrorField(rigid(seed=6), state())
    volume = Volume.of(field.model.machine)
    trial = TrialPoints.over(field, volume)
    without = trial.remainder(project(field, volume, BOTH).tables)
    found = project(field, volume, replace(BOTH, holds=(POS, STR, ANG)))
    assert any(t.lever for t in found.tables)
    with_products = trial.remainder(found.tables)
    assert without.rms > 2e-3
    # what is left is a twist of three axes and curvature: two levers of one angle meet
    assert with_products.rms < 0.15 * without.rms


@pytest.mark.parametrize("code", ["w b Y X Z t", "w X' b Y Z t", "w Z' b X Y t"])
def test_error_motions_hold_all_of_a_rigid_machine(code):
    field = ErrorField(with_backlash(rigid(code)), state())
    volume = Volume.of(field.model.machine)
    tables = project(field, volume, RIGID, tolerance=1e-5).tables
    left = TrialPoints.over(field, volume).remainder(tables)
    assert left.largest < 1.5e-4
    assert np.abs(left.shift).max() < 1e-5


def test_error_motions_at_another_tool_still_hold_a_rigid_machine():
    """The angles are the machine's own, not whatever fits one tool."""
    model = rigid(seed=9)
    volume = Volume.of(model.machine)
    made = project(ErrorField(model, state((0.0, 0.0, 0.0))), volume, RIGID, tolerance=1e-5)
    other = ErrorField(model, state((80.0, -50.0, -250.0)))
    assert TrialPoints.over(other, volume).remainder(made.tables).largest < 3e-4


def test_what_is_not_rigid_is_spread_so_that_least_remains():
    """An angle that depends on another axis: less is left than of its mean, or of nothing of it."""
    model = not_rigid(rigid(seed=3))
    field = ErrorField(model, state())
    volume = Volume.of(model.machine)
    trial = TrialPoints.over(field, volume)
    spread = trial.remainder(project(field, volume, RIGID).tables)
    rigid_only = ErrorField(rigid(seed=3), state())
    ignored = trial.remainder(project(rigid_only, volume, RIGID).tables)
    assert ignored.rms > 2e-3
    assert spread.rms < 0.6 * ignored.rms


def test_rotary_axes_have_tables_of_their_own():
    field = ErrorField(five_axes(), state())
    volume = Volume.of(field.model.machine)
    rotary = Capability(
        (
            Holds("axis", ("L-POS", "R-POS"), points=400, directional=True),
            Holds("cross", ("L-STR", "R-RAX"), points=400, directional=True),
        ),
        lookup="indicated",
    )
    tables = project(field, volume, rotary).tables
    names = {t.name for t in tables}
    assert {"E_CC", "E_BB", "E_XC", "E_ZB", "E_YX"} <= names
    trial = TrialPoints.over(field, volume)
    only_linear = [t for t in tables if t.inputs[0] in "XYZ"]
    assert trial.remainder(tables).rms < 0.8 * trial.remainder(only_linear).rms
    volumetric = project(field, volume, RIGID).tables
    assert trial.remainder(volumetric).rms < 0.02 * trial.remainder().rms


def test_backlash_is_in_the_difference_of_the_directions():
    field = ErrorField(with_backlash(rigid(), 0.010), state())
    volume = Volume.of(field.model.machine)
    tables = {t.name: t for t in project(field, volume, BOTH).tables}
    for axis, size in (("Y", 0.010), ("X", 0.013), ("Z", 0.016)):
        table = tables[f"E_{axis}{axis}"]
        # arriving upwards the carriage stops short of where it stops coming down
        assert table.forward - table.downward == pytest.approx(-size, abs=2e-5)
    assert not tables["E_YX"].directional
    one = project(field, volume, replace(BOTH, holds=(replace(POS, directional=False), STR)))
    mean = {t.name: t for t in one.tables}["E_XX"]
    assert not mean.directional
    assert mean.forward == pytest.approx(
        0.5 * (tables["E_XX"].at(mean.nodes[0]) + tables["E_XX"].at(mean.nodes[0], upward=False)),
        abs=2e-4,
    )


def test_a_command_is_looked_up_where_the_machine_is_to_be():
    """The field of commands is what takes the command to where the machine then truly stands."""
    model = rigid(seed=8)
    steep = replace(
        model,
        terms=tuple(
            replace(t, values={n: replace(v, value=60.0 * v.value) for n, v in t.values.items()})
            for t in model.terms
        ),
    )
    wanted = random_rows(model, 300)
    field = ErrorField(steep, state(), "command")
    solved = invert_model(steep, field.conditions(wanted))[0]
    by_inverse = np.stack([wanted[a] - solved.position(a) for a in "XYZ"], axis=1)
    assert field(wanted) == pytest.approx(by_inverse, abs=1e-6)
    assert np.abs(field(wanted) - ErrorField(steep, state())(wanted)).max() > 5e-3
    motions = field.motions(wanted)
    there = ErrorField(steep, state()).motions({a: solved.position(a) for a in "XYZ"})
    assert all(motions[c] == pytest.approx(there[c], abs=1e-7) for c in motions)


def test_tables_hold_at_stated_temperatures():
    model = thermal(rigid())
    volume = Volume.of(model.machine)
    warm = ErrorField(model, state(T_x=26.0, T_y=22.0))
    cold = project(ErrorField(model, state()), volume, BOTH).tables
    tables = project(warm, volume, BOTH).tables
    trial = TrialPoints.over(warm, volume)
    assert trial.remainder(cold).rms > trial.remainder(tables).rms + 5e-3
    # the growth of the spindle is a shift of the whole: told apart, and in the table
    assert trial.remainder(cold).shift[2] == pytest.approx(2e-3 * 2.0, abs=1e-4)
    assert abs(trial.remainder(tables).shift[2]) < 1e-4
    slope = {t.name: t for t in tables}["E_XX"].on(np.array([0.0, 400.0])).forward
    base = {t.name: t for t in cold}["E_XX"].on(np.array([0.0, 400.0])).forward
    assert np.diff(slope - base) == pytest.approx(1.1e-5 * 6.0 * 400.0, rel=0.01)


limits = st.fixed_dictionaries(
    {
        "points": st.integers(3, 60),
        "rule": st.sampled_from(["free", "equidistant", "power of two"]),
        "least": st.sampled_from([0.0, 5.0, 40.0]),
        "resolution": st.sampled_from([1e-5, 1e-4, 1e-3]),
        "range": st.sampled_from([None, 0.005, 0.02]),
        "increment": st.sampled_from([None, 3, 7]),
        "zero_at": st.sampled_from([None, "zero", "start"]),
        "directional": st.booleans(),
    }
)


FIELD = ErrorField(with_backlash(rigid(seed=12)), state())
VOLUME = Volume.of(FIELD.model.machine)
OWN = [t for t in project(FIELD, VOLUME, BOTH, tolerance=1e-6).tables if t.name[2] == t.name[3]]
"""E_XX, E_YY, E_ZZ in two directions, finely known."""


@settings(max_examples=60)
@given(limits)
def test_no_limit_of_a_controller_is_ever_exceeded(drawn):
    spacing = Spacing(drawn["rule"], drawn["least"], 0.001, powers=(10, 19))
    points = max(drawn["points"], 8 if drawn["rule"] == "power of two" else 4)
    limit = drawn["range"]
    holds = Holds(
        "axis",
        ("L-POS",),
        points=points,
        spacing=spacing,
        directional=drawn["directional"],
        resolution=drawn["resolution"],
        value_range=None if limit is None else (-limit, limit),
        increment=None if drawn["increment"] is None else Increment(drawn["increment"], (1, 2, 5)),
        zero_at=drawn["zero_at"],
    )
    curves = [
        Curve(holds, t.output, t.inputs[0], t.nodes[0], np.stack([t.forward, t.downward]))
        for t in OWN[:1]
    ]
    tables, _ = fit_tables(curves, Capability((holds,)), 1e-4)
    for table in tables:
        nodes = table.nodes[0]
        axis = table.inputs[0]
        assert 2 <= len(nodes) <= points
        assert nodes[0] <= TRAVELS[axis][0] + 1e-6
        assert nodes[-1] >= TRAVELS[axis][1] - 1e-6
        if drawn["least"] and drawn["rule"] != "power of two":
            assert np.diff(nodes).min() >= drawn["least"] - 1e-6 or len(nodes) == 2
        assert np.abs(nodes / 0.001 - np.round(nodes / 0.001)).max() < 1e-5
        assert not table.directional or drawn["directional"]
        if limit is not None:
            assert table.largest() <= limit + 1e-12
        for values in (table.forward, table.downward):
            counts = values / drawn["resolution"]
            assert np.abs(counts - np.round(counts)).max() < 1e-6
            if drawn["increment"] is not None:
                steps = np.abs(np.diff(np.round(counts)))
                assert any((steps <= drawn["increment"] * m).all() for m in (1, 2, 5))
        if drawn["zero_at"] == "start":
            assert table.forward[0] == 0.0
        if drawn["zero_at"] == "zero" and drawn["increment"] is None and limit is None:
            assert abs(table.at(np.zeros(1))[0]) <= 1.01 * drawn["resolution"]


def test_limits_that_are_felt_are_reported():
    holds = replace(POS, value_range=(-0.004, 0.004))
    notes = project(FIELD, VOLUME, Capability((holds,), lookup="indicated")).notes
    assert any("cuts off" in note for note in notes)
    few = project(FIELD, VOLUME, Capability((replace(POS, points=4),), lookup="indicated")).notes
    assert any("4 points leave" in note for note in few)


def test_where_one_axis_has_one_table_the_one_that_does_most_is_chosen():
    capability = replace(BOTH, per_output=1)
    found = project(FIELD, VOLUME, capability)
    outputs = [t.output for t in found.tables]
    assert len(outputs) == len(set(outputs)) == 3
    trial = TrialPoints.over(FIELD, VOLUME)
    chosen = trial.remainder(found.tables).rms
    assert any("has no table for" in note for note in found.notes)
    everything = {t.name: t for t in project(FIELD, VOLUME, BOTH).tables}
    for output in "XYZ":
        kept = next(t for t in found.tables if t.output == move(output))
        for axis in "XYZ":
            rival = everything[f"E_{output}{axis}"]
            others = [t for t in found.tables if t is not kept]
            assert trial.remainder([*others, rival]).rms >= chosen * 0.995


def test_as_many_tables_as_there_are():
    found = project(FIELD, VOLUME, replace(BOTH, most_tables=4))
    assert len(found.tables) == 4
    assert any("has no table for" in note for note in found.notes)


def test_more_points_than_there_are_is_an_error():
    with pytest.raises(InputError, match="points"):
        project(FIELD, VOLUME, BOTH, points=301)
    assert {len(t.nodes[0]) for t in project(FIELD, VOLUME, BOTH, points=12).tables} == {12}


def test_superposed_on_a_table_in_the_controller():
    """The machine was measured with a table active: the sum is what the bare machine needs."""
    bare = rigid(seed=20)
    volume = Volume.of(bare.machine)
    nodes = np.linspace(*TRAVELS["X"], 7)
    first = Table(move("X"), ("X",), (nodes,), 0.01 * np.sin(nodes / 90.0)).as_sign(
        Sign.COMPENSATION
    )

    class Compensated(ErrorField):
        """The bare machine's error less what the active table takes off."""

        def __call__(self, positions, directions=None):
            return super().__call__(positions, directions) - self.removed(
                [first], positions, directions
            )

    measured = Compensated(bare, state())
    total = project(measured, volume, BOTH, present=[first], tolerance=1e-5).tables
    direct = project(ErrorField(bare, state()), volume, BOTH, tolerance=1e-5).tables
    for one, other in zip(total, direct, strict=True):
        assert one.difference(other) < 1.5e-4, one.name
    stray = Table(move("X"), ("X", "Y"), (nodes, nodes), np.zeros((7, 7)))
    with pytest.raises(InputError, match="no counterpart"):
        project(measured, volume, BOTH, present=[stray])


def test_planes_are_the_mean_over_the_third_axis():
    holds = Holds(
        "plane", ("L-POS",), points=60, spacing=Spacing("equidistant", unit=0.001),
        inputs=("Y", "X"), outputs=("X", "Y", "Z"),
    )  # fmt: skip
    field = ErrorField(rigid(seed=5), state())
    volume = Volume.of(field.model.machine)
    tables = project(field, volume, Capability((holds,), lookup="indicated")).tables
    assert [t.inputs for t in tables] == [("Y", "X")] * 3
    rng = np.random.default_rng(1)
    n = 4000
    for y, x in ((100.0, 50.0), (640.0, 410.0)):
        where = {
            "X": np.full(n, x), "Y": np.full(n, y), "Z": rng.uniform(*TRAVELS["Z"], n)
        }  # fmt: skip
        mean = field(where).mean(axis=0)
        for k, table in enumerate(tables):
            assert table.at(np.array([y]), np.array([x]))[0] == pytest.approx(mean[k], abs=4e-4)
