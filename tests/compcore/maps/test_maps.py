from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.compcore.effects import Squareness
from abbe.compcore.errors import InputError
from abbe.compcore.files.map_file import format_map, load_map, parse_map
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.convention import Convention, parse_rotation_point, parse_signs, selectors
from abbe.compcore.maps.squareness import (
    move_squareness,
    square_pairs,
    squareness_in,
    with_squareness,
)
from abbe.compcore.maps.table import COLUMNS, AxisTable, CompensationMap
from abbe.compcore.maps.to_model import import_map, map_machine
from tests.support.compcore.article_map import as_map, correction, random_tables

BRIDGE = Structure.parse("w b Y X Z t")
XYZ = ("X", "Y", "Z")
EXAMPLE = Path(__file__).parents[2] / "data" / "bridge-map.txt"


def poses(rng, n=25, beyond=50.0):
    """Positions, a little beyond the tables' ends too, and tool offsets."""
    q = {
        "X": rng.uniform(-beyond, 700 + beyond, n),
        "Y": rng.uniform(-beyond, 900 + beyond, n),
        "Z": rng.uniform(-360 - beyond, beyond, n),
    }
    return q, rng.uniform(-150, 150, (n, 3))


def expected(tables, chain, q, tool, **variant):
    return np.array(
        [correction(tables, chain, {a: q[a][i] for a in XYZ}, tool[i], **variant)
         for i in range(len(tool))]
    )  # fmt: skip


def test_the_published_map_through_a_model_gives_the_published_figures():
    model = import_map(load_map(EXAMPLE), BRIDGE)
    point = Conditions.at({"X": 200.0, "Y": 600.0, "Z": -150.0})
    found = point.position("X")[0], point.position("Y")[0], point.position("Z")[0]
    compensated = np.array(found) + model.predict(point).translation[0]
    np.testing.assert_array_equal(np.round(compensated, 4), (200.0469, 600.1875, -149.9208))
    off = model.predict(point).orientation[0] - np.eye(3)
    np.testing.assert_allclose(
        [off[1, 0], off[0, 2], off[2, 1]], [132e-6, 116e-6, 100e-6], atol=5e-8
    )


def test_the_published_map_is_read_and_written_byte_for_byte(tmp_path):
    original = EXAMPLE.read_text(encoding="utf-8")
    compensation = load_map(EXAMPLE)
    assert format_map(compensation) == original
    assert list(compensation.tables) == ["X", "Y", "Z"]
    z = compensation.tables["Z"]
    assert z.positions == (0.0, -50.0, -100.0, -150.0, -200.0)
    assert z.range == (-200.0, 0.0)
    assert z.rising().positions[0] == -200.0
    assert z.values[3] == pytest.approx((0.039, 0.033, 0.036, 39e-6, 42e-6, 45e-6))
    (tmp_path / "map.txt").write_text(format_map(compensation), encoding="utf-8")
    assert load_map(tmp_path / "map.txt").tables == compensation.tables


decimals = st.integers(-(10**7), 10**7).map(lambda n: n / 1e6)


@given(
    st.dictionaries(
        st.sampled_from(["X", "Y", "Z", "W", "U2"]),
        st.tuples(
            st.lists(decimals, min_size=2, max_size=6, unique=True),
            st.booleans(),
            st.lists(st.tuples(*[decimals] * 6), min_size=6, max_size=6),
        ),
        min_size=1,
    )
)
def test_files_round_trip(content):
    tables = {}
    for axis, (positions, falling, rows) in content.items():
        at = tuple(sorted(positions, reverse=falling))
        rows = [(*r[:3], *(v * 1e-3 for v in r[3:])) for r in rows[: len(at)]]
        tables[axis] = AxisTable(axis, at, tuple(rows))
    again = parse_map(format_map(CompensationMap(tables)))
    assert [(t.axis, t.positions, t.values) for t in again.tables.values()] == [
        (t.axis, t.positions, t.values) for t in tables.values()
    ]


def test_layouts_that_are_as_good(tmp_path):
    text = EXAMPLE.read_text(encoding="utf-8")
    variants = [
        text.replace("\n", "\r\n"),
        text.replace("\t", "   "),
        text.replace("Position", "position").replace("X Axis", "x axis"),
        text.replace("\n\n", "\n"),
        "\n\n" + text.rstrip("\n"),
    ]
    for i, variant in enumerate(variants):
        path = tmp_path / f"{i}.txt"
        path.write_bytes(("﻿" + variant).encode())
        assert {a: t.values for a, t in load_map(path).tables.items()} == {
            a: t.values for a, t in load_map(EXAMPLE).tables.items()
        }


HEAD = "X Axis\n\nPosition\tLx\tLy\tLz\tRx\tRy\tRz\n"
ROWS = "0 0 0 0 0 0 0\n100 1 2 3 4 5 6\n"


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", 1, "no axis in this file.*expected a heading such as 'X Axis'"),
        (ROWS, 1, "no axis yet: found '0 0 0 0 0 0 0'"),
        (HEAD + "0 0 0 0 0 0 0\n", 1, "table of axis X is too short: found '1 rows'.*at least two"),
        (HEAD, 1, "found '0 rows'"),
        ("X Axis\n" + ROWS, 2, "not the header: found '0 0 0 0 0 0 0', expected Position Lx Ly"),
        (HEAD.replace("Ly\tLz", "Lz\tLy") + ROWS, 3, "not the header"),
        (HEAD + ROWS + "200 1 2 3 4 5\n", 6, "wrong number of columns: found \"6 in '200 1"),
        (HEAD + ROWS + "200 1 2 3 4 5 6 7\n", 6, 'wrong number of columns: found "8 in'),
        (HEAD + ROWS + "200 1 2 x 4 5 6\n", 6, "'Lz': not a number: found 'x', expected a .* mm$"),
        (HEAD + ROWS + "200 1 2 3 4 5 nan\n", 6, "'Rz': not a number: found 'nan'.* mm/m$"),
        (HEAD + ROWS + "1,5 1 2 3 4 5 6\n", 6, "'Position': not a number: found '1,5'"),
        (HEAD + ROWS + "100 1 2 3 4 5 6\n", 6, "the same position twice: found '100'"),
        (HEAD + ROWS + "50 1 2 3 4 5 6\n", 6, "positions rise and then turn round.*above 100 mm"),
        (HEAD + "0 0 0 0 0 0 0\n-5 0 0 0 0 0 0\n1 0 0 0 0 0 0\n", 6, "fall and .*below -5 mm"),
        (HEAD + ROWS + HEAD + ROWS, 6, "second table for axis X.*the first is on 1"),
        (HEAD.replace("X", "Q") + ROWS, 1, "not the name of a linear axis: found 'Q'"),
        (HEAD.replace("X", "C") + ROWS, 1, "not the name of a linear axis: found 'C'"),
    ],
)
def test_errors_name_the_line(text, line, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_map(text, "map.txt")
    assert caught.value.file == "map.txt"
    assert caught.value.line == line


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_map(tmp_path / "none.txt")
    (tmp_path / "latin.txt").write_bytes(b"X Axis \xb5")
    with pytest.raises(InputError, match="not UTF-8"):
        load_map(tmp_path / "latin.txt")


def test_map_and_structure_must_name_the_same_axes():
    compensation = load_map(EXAMPLE)
    with pytest.raises(InputError, match="no table for axis W.*found 'X, Y, Z'"):
        import_map(compensation, Structure.parse("w b Y X Z W t"))
    with pytest.raises(InputError, match=r"map\.txt, line 19.*axis Z of the map is not in the str"):
        import_map(compensation, Structure.parse("w b Y X t"))
    with pytest.raises(InputError, match="linear axes only"):
        import_map(compensation, Structure.parse("w b Y X Z C t"))


CHAINS = {
    "w b Y X Z t": "YXZ",
    "w b X Y Z t": "XYZ",
    "w b X Z Y t": "XZY",
    "w b Z Y X t": "ZYX",
    "w Y' b X Z t": "YXZ",
    "w Z' X' b Y t": "ZXY",
}


@pytest.mark.parametrize("code", CHAINS)
def test_import_reproduces_the_published_algorithm(code):
    rng = np.random.default_rng(3)
    tables = random_tables(rng)
    q, tool = poses(rng)
    model = import_map(as_map(tables), Structure.parse(code))
    got = model.predict(Conditions(q, tool=tool)).translation
    own = model.machine.structure.workpiece_side
    np.testing.assert_allclose(
        got, expected(tables, CHAINS[code], q, tool, own_travel=own), atol=1e-12
    )


signs = st.frozensets(st.tuples(st.sampled_from(XYZ), st.sampled_from("XYZABC")))
points = st.dictionaries(st.sampled_from(XYZ), st.floats(-500, 500))


@settings(max_examples=40)
@given(st.sampled_from(sorted(CHAINS)), signs, points,
       st.sampled_from(["structure", "never", "always"]), st.integers(0, 99))  # fmt: skip
def test_any_convention_is_imported_exactly(code, reversed_, point, own, seed):
    rng = np.random.default_rng(seed)
    tables = random_tables(rng, 0.5, 5e-3)
    q, tool = poses(rng, 6)
    structure = Structure.parse(code)
    model = import_map(as_map(tables), structure, Convention(reversed_, point, own))
    travel = {"structure": structure.workpiece_side, "never": (), "always": XYZ}[own]
    variant = {
        "sign": lambda axis, k: -1.0 if (axis, "XYZABC"[k]) in reversed_ else 1.0,
        "rotation_point": point,
        "own_travel": travel,
    }
    got = model.predict(Conditions(q, tool=tool)).translation
    np.testing.assert_allclose(got, expected(tables, CHAINS[code], q, tool, **variant), atol=1e-11)


def test_an_imported_model_is_saved_exactly(tmp_path):
    convention = Convention(parse_signs(["R=-1"], XYZ), {"Z": -200.0}, "always")
    model = import_map(load_map(EXAMPLE), BRIDGE, convention, squareness={("Y", "X"): 2e-5})
    save_model(model, tmp_path / "m.toml")
    assert load_model(tmp_path / "m.toml") == model
    assert model.composition == "exact"


# --- squareness ----------------------------------------------------------------------------------


def difference(one, other, at):
    return one.predict(at).translation - other.predict(at).translation


@pytest.mark.parametrize("pair", [("Y", "X"), ("Y", "Z"), ("X", "Z")])
def test_angle_and_gradient_move_the_ram_alike_but_not_the_probe(pair):
    compensation = as_map(random_tables(np.random.default_rng(1)))
    machine = map_machine(compensation, BRIDGE)
    angle = 80e-6
    as_angle, as_gradient = (
        import_map(with_squareness(compensation, machine, pair, angle, form), BRIDGE)
        for form in ("angle", "gradient")
    )
    assert as_angle != as_gradient, "the two maps differ"
    q, tool = poses(np.random.default_rng(2), beyond=0.0)
    bare = difference(as_angle, as_gradient, Conditions(q))
    assert np.abs(bare).max() < 2e-5, "alike to first order where no tool is offset"
    third = {"YX": "Z", "YZ": "X", "XZ": "Y"}["".join(pair)]
    turned = np.cross(angle * np.eye(3)["XYZ".index(third)], tool)
    assert np.abs(turned).max() > 5e-3
    np.testing.assert_allclose(
        difference(as_angle, as_gradient, Conditions(q, tool=tool)), turned, atol=4e-5
    )
    orientation = (
        as_angle.predict(Conditions(q)).rotation - as_gradient.predict(Conditions(q)).rotation
    )
    np.testing.assert_allclose(orientation, [angle * np.eye(3)["XYZ".index(third)]] * 25, atol=1e-7)


@pytest.mark.parametrize("code", ["w b Y X Z t", "w Z' b X Y t", "w Z' X' b Y t"])
@pytest.mark.parametrize("form", ["angle", "gradient"])
def test_squareness_in_a_map_is_the_effect_squareness(code, form):
    """On either side of the bed, without a tool, and up to second order."""
    structure = Structure.parse(code)
    compensation = as_map(random_tables(np.random.default_rng(1), 0.0, 0.0))
    machine = map_machine(compensation, structure)
    q, _ = poses(np.random.default_rng(5), beyond=0.0)
    for pair in square_pairs(machine):
        model = import_map(with_squareness(compensation, machine, pair, 1e-4, form), structure)
        effect = import_map(compensation, structure, squareness={pair: 1e-4})
        assert any(isinstance(t.effect, Squareness) for t in effect.terms)
        seen = difference(model, effect, Conditions(q))
        if structure.workpiece_side and form == "gradient":
            # a rigid turn of everything apart, which no measurement inside the machine shows
            seen = rigid_part_removed(seen, q)
        assert np.abs(seen).max() < 2e-5


def rigid_part_removed(displacement, q):
    p = np.stack([q[a] for a in XYZ], axis=1)
    columns = [np.tile(e, len(p)) for e in np.eye(3)]
    columns += [np.cross(e, p).reshape(-1) for e in np.eye(3)]
    matrix, seen = np.stack(columns, axis=1), displacement.reshape(-1)
    return seen - matrix @ np.linalg.lstsq(matrix, seen, rcond=None)[0]


@given(st.floats(-1e-3, 1e-3), st.sampled_from([("Y", "X"), ("Y", "Z"), ("X", "Z")]))
def test_a_stated_squareness_moved_there_and_back_leaves_the_map(angle, pair):
    compensation = as_map(random_tables(np.random.default_rng(1)))
    machine = map_machine(compensation, BRIDGE)
    for to, back in (("angle", "gradient"), ("gradient", "angle")):
        moved = move_squareness(compensation, machine, pair, to, angle)
        again = move_squareness(moved, machine, pair, back, angle)
        for axis, table in compensation.tables.items():
            np.testing.assert_allclose(again.tables[axis].array(), table.array(), atol=1e-15)


def test_beyond_the_ends_a_gradient_is_held_and_an_angle_goes_on():
    flat = as_map(random_tables(np.random.default_rng(1), 0.0, 0.0))
    machine = map_machine(flat, BRIDGE)
    at = Conditions.at({"X": [700.0, 800.0], "Y": 0.0, "Z": 0.0})
    for form, along_y in (("angle", [0.07, 0.08]), ("gradient", [0.07, 0.07])):
        model = import_map(with_squareness(flat, machine, ("Y", "X"), 1e-4, form), BRIDGE)
        np.testing.assert_allclose(model.predict(at).translation[:, 1], along_y, atol=1e-9)


def test_what_a_column_holds_is_found_and_moved():
    flat = as_map(random_tables(np.random.default_rng(1), 0.0, 0.0))
    machine = map_machine(flat, BRIDGE)
    for pair in square_pairs(machine):
        for form, other in (("angle", "gradient"), ("gradient", "angle")):
            skewed = with_squareness(flat, machine, pair, 5e-5, form)
            assert squareness_in(skewed, pair, form) == pytest.approx(5e-5)
            moved = move_squareness(skewed, machine, pair, other)
            assert squareness_in(moved, pair, form) == pytest.approx(0.0, abs=1e-18)
            assert squareness_in(moved, pair, other) == pytest.approx(5e-5)


def test_by_hand_x_y_squareness_is_all_of_y_s_rz():
    """0.1 mm/m: as an angle all of Y's Rz, as a gradient 0.07 mm of X's Ly at X = 700 mm."""
    flat = as_map(random_tables(np.random.default_rng(1), 0.0, 0.0))
    machine = map_machine(flat, BRIDGE)
    angle = with_squareness(flat, machine, ("Y", "X"), 1e-4, "angle")
    np.testing.assert_allclose(angle.tables["Y"].array()[:, COLUMNS.index("Rz")], 1e-4)
    gradient = with_squareness(flat, machine, ("Y", "X"), 1e-4, "gradient")
    assert gradient.tables["X"].array()[-1, COLUMNS.index("Ly")] == pytest.approx(0.07)
    assert not gradient.tables["Y"].array().any()


def test_a_controller_s_form_is_taken_on_import():
    tables = as_map(random_tables(np.random.default_rng(1)))
    at = Conditions(poses(np.random.default_rng(2), beyond=0.0)[0])
    plain = import_map(tables, BRIDGE)
    for form in ("angle", "gradient"):
        moved = import_map(tables, BRIDGE, Convention(squareness=form))
        assert np.abs(difference(moved, plain, at)).max() < 1e-4, "no tool: alike"
        assert moved != plain


def test_beside_the_map_as_a_gradient():
    flat = as_map(random_tables(np.random.default_rng(1), 0.0, 0.0))
    pair = {("Y", "X"): 1e-4}
    model = import_map(flat, BRIDGE, Convention(stated="gradient"), squareness=pair)
    assert not any(isinstance(t.effect, Squareness) for t in model.terms)
    at = Conditions.at({"X": 700.0, "Y": 0.0, "Z": 0.0}, tool=(0.0, 100.0, 0.0))
    np.testing.assert_allclose(model.predict(at).translation, [[0.0, 0.07, 0.0]], atol=1e-9)


# --- spelling ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("texts", "columns"),
    [
        ([], ""),
        (["R=-1"], "XA XB XC YA YB YC ZA ZB ZC"),
        (["L=-1", "X.L=1"], "YX YY YZ ZX ZY ZZ"),
        (["Ry=-1"], "XB YB ZB"),
        (["Z=-1"], "ZA ZB ZC ZX ZY ZZ"),
        (["Z.Rx=-1", "Y.Lz=-1"], "YZ ZA"),
        (["Rx=-1", "Rx=+1"], ""),
    ],
)
def test_signs_on_a_command_line(texts, columns):
    assert sorted("".join(s) for s in parse_signs(texts, XYZ)) == columns.split()


@given(signs)
def test_selectors_name_just_these_columns(reversed_):
    again = parse_signs([f"{s}=-1" for s in selectors(reversed_, XYZ)], XYZ)
    assert again == reversed_


@pytest.mark.parametrize("text", ["R", "R=2", "=-1", "Q=-1", "X.Q=-1", "W.R=-1", "R =-1", "X.=-1"])
def test_signs_that_cannot_be_read(text):
    with pytest.raises(InputError, match="sign"):
        parse_signs([text], XYZ)


RANGES = {"X": (0.0, 700.0), "Y": (-450.0, 450.0), "Z": (-360.0, 0.0)}


@pytest.mark.parametrize(
    ("text", "point"),
    [
        ("zero", {"X": 0.0, "Y": 0.0, "Z": 0.0}),
        ("low", {"X": 0.0, "Y": -450.0, "Z": -360.0}),
        ("Z=far", {"Z": -360.0}),
        ("X=far,Z=-12.5", {"X": 700.0, "Z": -12.5}),
        ("Y=high, Z=low", {"Y": 450.0, "Z": -360.0}),
    ],
)
def test_rotation_points_on_a_command_line(text, point):
    assert parse_rotation_point(text, RANGES) == point


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("far", "both ends of Y are equally far from zero.*Y=low"),
        ("W=1", "not a rotation point: found 'W=1'"),
        ("X=1,X=2", "at most once"),
        ("X=end", "a position in mm, zero, low, high or far"),
        ("X=nan", "a position in mm"),
        ("5,6", "not a rotation point"),
    ],
)
def test_rotation_points_that_cannot_be_read(text, message):
    with pytest.raises(InputError, match=message):
        parse_rotation_point(text, RANGES)


def test_options_say_the_convention_again():
    convention = Convention(
        parse_signs(["R=-1"], XYZ), {"Z": -360.0}, "always", "angle", "gradient"
    )
    assert convention.options(XYZ) == (
        "--sign R=-1 --rotation-point Z=-360 --own-travel always "
        "--map-squareness angle --squareness-as gradient"
    )
    assert Convention().options(XYZ) == ""


def test_a_convention_of_another_machine_is_refused():
    with pytest.raises(InputError, match="no such linear axis: found 'W'"):
        import_map(load_map(EXAMPLE), BRIDGE, Convention(rotation_point={"W": 1.0}))
