"""``abbe import-map`` and ``abbe identify-convention``."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.map_file import format_map, load_map
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.switched_points import read_switched
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.to_model import map_machine
from tests.support.compcore.article_map import as_map, correction, random_tables
from tests.support.daemon.command_line import abbe

ROOT = Path(__file__).parents[4]
MAP = ROOT / "tests" / "data" / "bridge-map.txt"
BRIDGE = ("--structure", "w b Y X Z t")
NOON = {"X": 200.0, "Y": 600.0, "Z": -150.0}


@pytest.fixture(scope="module")
def tables():
    return random_tables(np.random.default_rng(21))


@pytest.fixture
def map_file(tables, tmp_path):
    path = tmp_path / "map.txt"
    path.write_text(format_map(as_map(tables)), encoding="utf-8")
    return path


def points_file(path, tables, chain="YXZ", *, n=40, tools=True, factor=1.0, both=False, **variant):
    """Points as a person writes them down: µm to one decimal, or both readings in mm to four."""
    rng = np.random.default_rng(6)
    rows = []
    for _ in range(n):
        q = {"X": rng.uniform(0, 700), "Y": rng.uniform(0, 900), "Z": rng.uniform(-360, 0)}
        q = {a: round(v, 2) for a, v in q.items()}
        tool = np.round(rng.uniform(-100, 100, 3), 1) if tools else np.zeros(3)
        found = correction(tables, chain, q, tool, **variant) * factor
        off = list(q.values())
        if both:
            on = [f"{p + d:.4f}" for p, d in zip(off, found, strict=True)]
            rows.append([*(f"{v:.4f}" for v in off), *on, *map(str, tool)])
        else:
            rows.append([*map(str, off), *(f"{d * 1e3:.1f}" for d in found), *map(str, tool)])
    names = "X_off,Y_off,Z_off,X_on,Y_on,Z_on" if both else "X,Y,Z,dX,dY,dZ"
    head = '# format = "abbe-points/1"\n# unit = "um"\n'
    body = "\n".join(",".join(row) for row in rows)
    path.write_text(f"{head}{names},tool_x,tool_y,tool_z\n{body}\n", encoding="utf-8")
    return path


# --- import-map ----------------------------------------------------------------------------------


def test_import_map(tmp_path):
    out = tmp_path / "m.toml"
    done = abbe("import-map", MAP, *BRIDGE, "-o", out)
    assert done.status == 0, done.err
    assert "w b Y X Z t, 18 effects (X 5 rows, Y 5 rows, Z 5 rows), Abbe's own" in done.out
    model = load_model(out)
    assert model.machine.name == "bridge-map"
    assert model.machine.axes["Z"].travel == (-200.0, 0.0)
    assert model.fit["map"] == "bridge-map.txt"
    assert re.fullmatch("[0-9a-f]{64}", model.fit["sha256"])
    error = model.predict(Conditions.at(NOON)).translation[0]
    np.testing.assert_array_equal(np.round(error, 4), (0.0469, 0.1875, 0.0792))


def test_import_map_with_a_vendor_s_conventions(tables, map_file, tmp_path):
    out = tmp_path / "m.toml"
    options = ("--sign", "R=-1", "--sign", "X.Ly=-1", "--rotation-point", "Z=far,X=100",
               "--own-travel", "always", "--name", "Old Faithful")  # fmt: skip
    done = abbe("import-map", map_file, *BRIDGE, "-o", out, *options)
    assert done.status == 0, done.err
    model = load_model(out)
    assert model.machine.name == "Old Faithful"
    tool = np.array([10.0, 20.0, -90.0])
    got = model.predict(Conditions.at(NOON, tool=tool)).translation[0]
    expected = correction(
        tables,
        "YXZ",
        NOON,
        tool,
        sign=lambda axis, k: -1.0 if k > 2 or (axis, k) == ("X", 1) else 1.0,
        rotation_point={"X": 100.0, "Z": -360.0},
        own_travel="XYZ",
    )
    np.testing.assert_allclose(got, expected, atol=1e-12)
    assert "--sign R=-1 --sign X.Ly=-1 --rotation-point X=100,Z=-360" in model.fit["convention"]


def test_squareness_beside_the_map(map_file, tmp_path):
    plain, out = tmp_path / "p.toml", tmp_path / "m.toml"
    assert abbe("import-map", map_file, *BRIDGE, "-o", plain).status == 0
    at = Conditions.at(NOON, tool=(0.0, 100.0, 0.0))
    before = load_model(plain).predict(at).translation[0]
    for text, form, moved in [
        ("YX=0.1mm/m", (), (-0.01, 0.02, 0.0)),
        ("XY=-100urad", ("--squareness-as", "angle"), (-0.01, 0.02, 0.0)),
        ("YX=20.626480625arcsec", ("--squareness-as", "gradient"), (0.0, 0.02, 0.0)),
    ]:
        options = ("--squareness", text, *form)
        assert abbe("import-map", map_file, *BRIDGE, "-o", out, *options).status == 0
        after = load_model(out).predict(at).translation[0]
        np.testing.assert_allclose(after - before, moved, atol=1e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--structure", "w b Y X t"), "axis Z of the map is not in the structure"),
        (("--structure", "w b Y X Q t"), "structure code: cannot read 'Q'"),
        ((*BRIDGE, "--sign", "Q=-1"), "'sign': not a sign: found 'Q=-1'"),
        ((*BRIDGE, "--sign", "R=2"), "'sign': not a sign: found 'R=2'"),
        ((*BRIDGE, "--rotation-point", "W=1"), "'rotation point': not a rotation point"),
        ((*BRIDGE, "--own-travel", "sometimes"), "'own-travel': unknown word: found 'sometimes'"),
        ((*BRIDGE, "--squareness-as", "slope"), "'squareness-as': unknown word: found 'slope'"),
        ((*BRIDGE, "--squareness-as", "gradient"), "'squareness-as': no squareness is stated"),
        ((*BRIDGE, "--map-squareness", "no"), "'map-squareness': unknown word: found 'no'"),
        ((*BRIDGE, "--squareness", "XQ=1urad"), "'squareness': not a pair of axes: found 'XQ'"),
        ((*BRIDGE, "--squareness", "XY=1"), "'squareness': squareness without a unit"),
        ((*BRIDGE, "--squareness", "XY=1mm"), "'unit': wrong unit: found 'mm'"),
        ((*BRIDGE, "--squareness", "XY=1urad", "--squareness", "YX=1urad"), "same pair twice"),
    ],
)
def test_mistakes_of_import_map(tmp_path, options, message):
    out = tmp_path / "m.toml"
    done = abbe("import-map", MAP, *options, "-o", out)
    assert (done.status, done.out) == (1, "")
    assert done.err.count("\n") == 1
    assert message in done.err
    assert not out.exists()


def test_a_broken_map_names_its_line(tmp_path):
    path = tmp_path / "map.txt"
    path.write_text(MAP.read_text(encoding="utf-8").replace("0.0250", "O.0250", 1))
    done = abbe("import-map", path, *BRIDGE, "-o", tmp_path / "m.toml")
    assert done.status == 1
    assert "map.txt, line 5, field 'Ry': not a number: found 'O.0250'" in done.err


# --- identify-convention -------------------------------------------------------------------------


def test_a_convention_is_found_and_its_import_reproduces_the_points(tables, map_file, tmp_path):
    """The whole way: points → convention → the command that is proposed → the same corrections."""
    points = points_file(
        tmp_path / "points.csv",
        tables,
        sign=lambda _axis, k: -1.0 if k > 2 else 1.0,
        rotation_point={"Z": -360.0},
    )
    done = abbe("identify-convention", map_file, points, *BRIDGE)
    assert done.status == 0, done.err
    assert "Identified: R=-1; rotation point Z=-360." in done.out
    assert "If one thing were otherwise" in done.out
    proposed = re.search(r"abbe (import-map .*) -o model\.toml", done.out)[1]
    words = [w.strip('"') for w in re.findall(r'"[^"]*"|\S+', proposed)]
    assert abbe(*words, "-o", tmp_path / "m.toml").status == 0
    model = load_model(tmp_path / "m.toml")
    rows = np.loadtxt(points, delimiter=",", skiprows=3)
    at = Conditions({a: rows[:, k] for k, a in enumerate("XYZ")}, tool=rows[:, 6:])
    np.testing.assert_allclose(model.predict(at).translation * 1e3, rows[:, 3:6], atol=0.0501)


def test_json_ranks_what_fails_and_how_clearly(tables, map_file, tmp_path):
    points = points_file(tmp_path / "points.csv", tables, both=True)
    done = abbe("identify-convention", map_file, points, *BRIDGE, "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert found["verdict"] == "identified"
    assert (found["n"], found["unit"]) == (40, "um")
    assert found["best"]["convention"] == "Abbe's own conventions"
    assert found["best"]["rms"] < 0.06
    assert found["best"]["max"] < 0.11
    assert found["rounding_sd"] == pytest.approx(0.1 / np.sqrt(6.0))
    assert found["if_measured_otherwise"] is None, "both readings were taken"
    assert not found["opposite_sign"]
    assert found["gain"] == pytest.approx(1.0, abs=0.01)
    assert found["rotation_point"]["undetermined"] == ["Y"]
    rms = [entry["rms"] for entry in found["changes"]]
    assert len(rms) > 10
    assert rms == sorted(rms, reverse=True)
    reversed_rotations = next(c for c in found["changes"] if c["options"] == "--sign R=-1")
    assert reversed_rotations["rms"] > 3.0
    assert len(reversed_rotations["reversed"]) == 9
    ranked = [entry["rms"] for entry in found["ranking"]]
    assert ranked[0] == min(ranked)
    assert len({json.dumps(e, sort_keys=True) for e in found["ranking"]}) == len(ranked)


def test_an_artefact_is_recognised_and_said(tables, map_file, tmp_path):
    points = points_file(tmp_path / "points.csv", tables, factor=-1.0)
    done = abbe("identify-convention", map_file, points, *BRIDGE)
    assert "Identified: opposite sign: an artefact was measured." in done.out
    assert "instead of switching the correction on and off" in done.out
    assert "they mean: L=-1; R=-1." in done.out
    found = json.loads(abbe("identify-convention", map_file, points, *BRIDGE, "--json").out)
    assert found["opposite_sign"]
    assert found["best"]["artefact"]
    assert found["gain"] == pytest.approx(-1.0, abs=0.01)


def test_exchanged_columns_of_on_and_off(tables, map_file, tmp_path):
    points = points_file(tmp_path / "points.csv", tables, both=True, factor=-1.0)
    done = abbe("identify-convention", map_file, points, *BRIDGE)
    assert "Identified: L=-1; R=-1." in done.out
    assert "Or the columns of on and off are exchanged." in done.out


def test_the_chain_order_is_found_without_a_structure(tables, map_file, tmp_path):
    points = points_file(tmp_path / "points.csv", tables, "XZY")
    done = abbe("identify-convention", map_file, points)
    assert "Identified: chain X Z Y." in done.out
    assert '--structure "w b X Z Y t"' in done.out
    again = abbe("identify-convention", map_file, points, *BRIDGE)
    assert "None reproduces the points." in again.out
    assert "--any-order" in again.out


def test_what_the_points_cannot_tell_is_said_with_a_pose_that_would(tables, map_file, tmp_path):
    points = points_file(tmp_path / "points.csv", tables, tools=False)
    done = abbe("identify-convention", map_file, points, *BRIDGE)
    assert "What these points cannot tell:" in done.out
    assert re.search(r"squareness as angle: .* tool=.* µm apart\) would", done.out)
    assert re.search(r"the signs of .*Z\.Rx, Z\.Ry, Z\.Rz: they do next to nothing", done.out)
    found = json.loads(abbe("identify-convention", map_file, points, *BRIDGE, "--json").out)
    tie = next(t for t in found["ties"] if t["squareness"] == "angle")
    assert any(tie["told_by"]["tool"])
    assert tie["told_by"]["difference"] > 0.1
    assert {"Z.Rx", "Z.Ry", "Z.Rz"} <= set(found["open_columns"])


def test_a_model_that_was_imported(tables, map_file, tmp_path):
    points = points_file(tmp_path / "points.csv", tables, rotation_point={"Z": -360.0})
    options = (*BRIDGE, "--rotation-point", "Z=far")
    abbe("import-map", map_file, *options, "-o", tmp_path / "right.toml")
    done = abbe("identify-convention", tmp_path / "right.toml", points)
    assert "Identified: Abbe's own conventions." in done.out
    abbe("import-map", map_file, *BRIDGE, "-o", tmp_path / "plain.toml")
    done = abbe("identify-convention", tmp_path / "plain.toml", points)
    assert "Identified: rotation point Z=-360." in done.out


def test_a_looser_tolerance(tables, map_file, tmp_path):
    points = points_file(tmp_path / "points.csv", tables, "XZY")
    strict = json.loads(abbe("identify-convention", map_file, points, *BRIDGE, "--json").out)
    loose = ("--tolerance", "50")
    relaxed = abbe("identify-convention", map_file, points, *BRIDGE, *loose, "--json")
    assert strict["verdict"] == "none"
    assert json.loads(relaxed.out)["tolerance"] == pytest.approx(50.0)
    assert json.loads(relaxed.out)["verdict"] != "none"


def test_mistakes_of_identify_convention(tables, map_file, tmp_path):
    points = points_file(tmp_path / "points.csv", tables)
    abbe("import-map", map_file, *BRIDGE, "-o", tmp_path / "m.toml")
    done = abbe("identify-convention", tmp_path / "m.toml", points, *BRIDGE)
    assert done.status == 1
    assert "a model says its structure and squareness itself" in done.err
    points.write_text(points.read_text(encoding="utf-8").replace("dZ", "dQ"), encoding="utf-8")
    done = abbe("identify-convention", map_file, points, *BRIDGE)
    assert (done.status, done.out) == (1, "")
    assert "points.csv, line 3, field 'dQ': unknown column" in done.err


def test_the_page_about_maps_tells_every_option_and_its_examples_work(tmp_path):
    page = (ROOT / "docs" / "maps.md").read_text(encoding="utf-8")
    for command in ("import-map", "identify-convention"):
        shown = abbe(command, "--help").out
        options = set(re.findall(r"--[a-z][a-z-]+", shown)) - {"--help", "--out", "--name"}
        assert len(options) >= 4
        for option in options - {"--tolerance"}:
            assert option in page, option
    blocks = [b for b in re.findall(r"```\n(.*?)```", page, re.S) if "tool_x" in b]
    assert len(blocks) == 2
    machine = map_machine(load_map(MAP), Structure.parse(BRIDGE[1]))
    for block in blocks:
        (tmp_path / "points.csv").write_text(block, encoding="utf-8")
        points = read_switched(tmp_path / "points.csv", machine)
        np.testing.assert_allclose(points.difference, [[0.0469, 0.1875, 0.0792]], atol=1e-9)


def test_the_maps_that_ship_are_the_published_one():
    examples = ROOT / "examples" / "map" / "compensation-map.txt"
    assert examples.read_bytes() == MAP.read_bytes()
    assert Structure.parse(BRIDGE[1]).axes == ("Y", "X", "Z")
    assert set(load_map(examples).tables) == {"X", "Y", "Z"}
