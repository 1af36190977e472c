"""Importers: the numbers, directions and signs of foreign files, and every flaw in them named."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.comparison.compare import compare
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, write_campaign
from abbe.compcore.files.importers.ballbar import import_ballbar
from abbe.compcore.files.importers.lines.iso230_table import import_iso230_table
from abbe.compcore.files.importers.lines.rtl import import_rtl
from abbe.compcore.files.importers.map_rows import import_map_rows
from abbe.compcore.files.importers.placing import ForeignPlacing
from abbe.compcore.files.map_file import load_map
from abbe.compcore.iso230.positioning import evaluate_positioning, positioning_runs
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.to_model import import_map
from tests.support.compcore.campaign_texts import CMM, MILL

AT = ForeignPlacing(at={"Y": 450.0, "Z": -180.0}, tool=(0.0, 0.0, -120.0))
UP = [[0, 1, 2], [3, 4, 5], [6, 6, 6]]
DOWN = [[4, 4, 4], [5, 6, 7], [1, 3, 5]]
"""µm; evaluated by hand in test_iso230: A = 9, R = 8, E = 5, M = 2.5, B = 3."""

RTL = """\
HEADER::
File type: Linear
Owner: Renishaw plc
Version no: 1
TARGET DATA::
Filetype: rtl
Target-count:3
Targets :
 0.000000  100.000000
 200.000000
Flags: 3 0 0

USER-TEXT::
Machine: Werkstatt 7, Fräse
Serial No: 12
Date: 2024-05-17
By: Anna
Axis: X
RUNS::
Run-count:6
DEVIATIONS::
Run Target Data:
""" + "".join(
    f" {2 * run + 1 + back:4d} {i + 1:4d} {table[i][run]:10.3f}\n"
    for run in range(3)
    for back, table in ((0, UP), (1, DOWN))
    for i in range(3)[:: 1 - 2 * back]
)  # fmt: skip


def write(folder: Path, name: str, content: str | bytes) -> Path:
    """A file to import."""
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def check_worked_example(campaign: Campaign) -> None:
    """The three targets and three runs of test_iso230, evaluated."""
    (runs,) = positioning_runs(campaign, CMM)
    np.testing.assert_allclose(runs.targets, [0, 100, 200])
    np.testing.assert_allclose(runs.up, np.array(UP) * 1e-3)
    np.testing.assert_allclose(runs.down, np.array(DOWN) * 1e-3)
    found = evaluate_positioning(runs)
    np.testing.assert_allclose([found.A, found.R, found.M], [9e-3, 8e-3, 2.5e-3])


def notes(campaign: Campaign) -> str:
    """What the importer says it assumed."""
    return str(campaign.metadata[0]["notes"])


def test_rtl(tmp_path):
    campaign = import_rtl(write(tmp_path, "x.rtl", RTL), AT, machine=CMM)
    check_worked_example(campaign)
    assert campaign.conditions.position("Y").tolist() == [450.0] * 18
    assert campaign.conditions.tool[0].tolist() == [0, 0, -120]
    assert campaign.conditions.directions["X"].tolist() == ([1.0] * 3 + [-1.0] * 3) * 3
    assert campaign.line[0] == 23
    assert campaign.metadata[0]["machine"] == "Werkstatt 7, Fräse"
    assert "laser − target, as assumed" in notes(campaign)
    assert campaign.setups["x"].free == ("zero",)
    write_campaign(campaign, tmp_path / "x.csv")
    check_worked_example(read_campaign(tmp_path / "x.csv", CMM))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "gbk", "latin-1"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_rtl_encodings_and_line_ends(tmp_path, encoding, ends):
    text = RTL.replace("Fräse", "铣床") if encoding == "gbk" else RTL
    path = write(tmp_path, "x.rtl", text.replace("\n", ends).encode(encoding))
    campaign = import_rtl(path, AT)
    check_worked_example(campaign)
    if encoding == "gbk":
        assert campaign.metadata[0]["machine"] == "Werkstatt 7, 铣床"


def test_rtl_the_other_way_round(tmp_path):
    plain = import_rtl(write(tmp_path, "x.rtl", RTL), AT)
    reversed_ = import_rtl(tmp_path / "x.rtl", ForeignPlacing(sign=-1))
    np.testing.assert_array_equal(reversed_.value, -plain.value)
    assert "−(laser − target" in notes(reversed_)


def test_rtl_targets_that_fall(tmp_path):
    """A laser at the far end counts its targets downwards: odd runs then move down."""
    text = RTL.replace(" 0.000000  100.000000\n 200.000000", " 200 100 0")
    campaign = import_rtl(write(tmp_path, "x.rtl", text), AT)
    assert campaign.conditions.directions["X"][:6].tolist() == [-1, -1, -1, 1, 1, 1]
    assert "not odd runs up" not in notes(campaign)


def test_rtl_runs_all_in_one_direction(tmp_path):
    lines = RTL.splitlines()
    rows = [f"{run} {i + 1} {UP[i][run - 1]}" for run in (1, 2, 3) for i in range(3)]
    text = "\n".join([*lines[:19], "Run-count:3", *lines[20:22], *rows])
    campaign = import_rtl(write(tmp_path, "x.rtl", text), AT)
    assert set(campaign.conditions.directions["X"]) == {1.0}
    assert "not odd runs up" in notes(campaign)


def test_rtl_of_a_rotary_axis_is_in_mrad_and_degrees(tmp_path):
    text = RTL.replace("Axis: X", "Axis: B").replace("100.000000", "45").replace("200.000000", "90")
    campaign = import_rtl(write(tmp_path, "b.rtl", text))
    assert set(campaign.kind) == {Kind.ROTATION}
    np.testing.assert_allclose(campaign.conditions.position("B")[:3], np.deg2rad([0, 45, 90]))
    np.testing.assert_allclose(campaign.value[:3], [0, 3e-3, 6e-3])
    assert campaign.conditions.u is not None
    assert campaign.conditions.u[0].tolist() == [0, 1, 0]
    arcsec = import_rtl(tmp_path / "b.rtl", unit="arcsec")
    np.testing.assert_allclose(arcsec.value[2], np.deg2rad(6 / 3600))


def test_rtl_of_straightness_and_pitch(tmp_path):
    path = write(tmp_path, "x.rtl", RTL)
    straight = import_rtl(path, component="Z")
    assert straight.conditions.u is not None
    assert straight.conditions.u[0].tolist() == [0, 0, 1]
    assert straight.setups["x"].free == ("zero", "slope")
    pitch = import_rtl(path, component="B", unit="urad")
    assert set(pitch.kind) == {Kind.ROTATION}
    np.testing.assert_allclose(pitch.value[2], 6e-6)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("Target-count:3", "Target-count:4", None, "targets are missing"),
        ("Target-count:3", "Target-count:three", 7, "not a whole number"),
        (" 200.000000", " 200.0x", 10, "not a number"),
        ("Run-count:6", "Run-count:8", None, "runs are missing"),
        ("    1    2      3.000", "    1    9      3.000", 24, "no such target"),
        ("    1    2      3.000", "    1    1      3.000", 24, "target 1 twice"),
        ("    1    2      3.000", "    1    2      3,0", 24, "not a number"),
        ("    1    2      3.000", "    1    2      nan", 24, "not a number"),
        ("    1    2      3.000", "    1    2", 24, "not a deviation"),
        ("Axis: X", "Axis: left", None, "does not name its axis"),
        ("DEVIATIONS::", "ENVIRONMENT::", None, "no deviations"),
        ("TARGET DATA::", "OTHER::", 23, "no such target"),
    ],
)
def test_rtl_that_is_damaged(tmp_path, old, new, line, words):
    path = write(tmp_path, "x.rtl", RTL.replace(old, new))
    with pytest.raises(InputError, match=words) as caught:
        import_rtl(path, AT)
    assert (caught.value.file, caught.value.line) == (str(path), line)


def test_rtl_that_is_something_else(tmp_path):
    with pytest.raises(InputError, match="no targets"):
        import_rtl(write(tmp_path, "x.rtl", "hello\n"), AT)
    with pytest.raises(InputError, match="no such file"):
        import_rtl(tmp_path / "none.rtl", AT)


LONG = "position,run,direction,deviation\n" + "".join(
    f"{100 * i},{j + 1},{word},{table[i][j]}\n"
    for i in range(3)
    for word, table in (("up", UP), ("down", DOWN))
    for j in range(3)
)
BY_TARGET = "target,1+,1-,2+,2-,3+,3-\n" + "".join(
    f"{100 * i}," + ",".join(f"{UP[i][j]},{DOWN[i][j]}" for j in range(3)) + "\n" for i in range(3)
)
BY_RUN = "run,direction,0,100,200\n" + "".join(
    f"{j + 1},{sign},{','.join(str(table[i][j]) for i in range(3))}\n"
    for j in range(3)
    for sign, table in (("↑", UP), ("↓", DOWN))
)


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(LONG, id="long"),
        pytest.param(LONG.replace("up", "forward").replace("down", "reverse"), id="words"),
        pytest.param(LONG.replace(",run,", ",j,").replace("deviation", "x_ij"), id="symbols"),
        pytest.param("# machine = CMM\n\n" + LONG.replace(",", ";"), id="semicolons"),
        pytest.param(BY_TARGET, id="by target"),
        pytest.param(
            BY_TARGET.replace("1+,1-,2+,2-,3+,3-", "run 1 up,run 1 down,run 2 up,run 2 down,↑3,↓3"),
            id="by target in words",
        ),
        pytest.param(BY_RUN, id="by run"),
        pytest.param(BY_RUN.replace(",", "\t"), id="by run, tabs"),
        pytest.param(
            "direction,0,100,200\n" + "".join(x[2:] + "\n" for x in BY_RUN.splitlines()[1:]),
            id="by run, not numbered",
        ),
    ],
)
def test_iso230_tables(tmp_path, text):
    campaign = import_iso230_table(write(tmp_path, "x.csv", text), "X", AT, machine=CMM)
    check_worked_example(campaign)
    assert "actual − target" in notes(campaign)
    assert "standard test cycle assumed" in notes(campaign)
    x = campaign.conditions.position("X")
    assert x[:6].tolist() == [0, 100, 200, 200, 100, 0]  # the order of the test cycle


@pytest.mark.parametrize(
    ("text", "unit", "scale"),
    [
        (LONG.replace("deviation", "deviation_mm"), None, 1e3),
        (LONG.replace("deviation", "Deviation [nm]"), None, 1e-3),
        (LONG, "mm", 1e3),
        (LONG.replace(",", ";").replace("\n", ",0\n").replace("deviation,0", "deviation"), None, 1),
    ],
)
def test_units_and_decimal_commas(tmp_path, text, unit, scale):
    campaign = import_iso230_table(write(tmp_path, "x.csv", text), "X", AT, unit=unit)
    np.testing.assert_allclose(np.sort(campaign.value)[-1], 7e-3 * scale)


def test_a_table_with_gaps(tmp_path):
    text = BY_TARGET.replace("100,3,5,", "100,,5,")
    campaign = import_iso230_table(write(tmp_path, "x.csv", text), "X", AT)
    assert campaign.n == 17


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (LONG.replace("up", "sideways", 1), 2, "not a direction"),
        (LONG.replace("100,1,up,3", "100,1,up,3x"), 8, "not a number"),
        (LONG.replace("100,1,up,3", "100,1,up"), 8, "too few fields"),
        (LONG.replace("direction,", "side,"), 1, "a column is missing"),
        (LONG.replace("position", "where").replace("deviation", "what"), 1, "not a table"),
        (BY_TARGET.replace("2+", "2?"), 1, "not a table"),
        ("position,run,direction,deviation\n", None, "no rows"),
        ("", None, "no rows"),
    ],
)
def test_tables_that_are_damaged(tmp_path, text, line, words):
    path = write(tmp_path, "x.csv", text)
    with pytest.raises(InputError, match=words) as caught:
        import_iso230_table(path, "X", AT)
    assert caught.value.file == str(path)
    assert caught.value.line == line


def test_tables_in_another_encoding(tmp_path):
    path = write(tmp_path, "x.csv", ("# µ\n" + LONG).encode("latin-1"))
    plain = import_iso230_table(write(tmp_path, "y.csv", LONG), "X", AT)
    np.testing.assert_array_equal(import_iso230_table(path, "X", AT).value, plain.value)


def test_the_other_axes_must_be_stated(tmp_path):
    path = write(tmp_path, "x.csv", LONG)
    with pytest.raises(InputError, match="position of axis Z is not stated"):
        import_iso230_table(path, "X", ForeignPlacing(at={"Y": 1.0}), machine=CMM)
    with pytest.raises(InputError, match="no such axis"):
        import_iso230_table(path, "A", AT, machine=CMM, unit="urad")
    with pytest.raises(InputError, match="not the name of an axis"):
        import_iso230_table(path, "Q", AT)
    with pytest.raises(InputError, match="not a component"):
        import_iso230_table(path, "X", AT, component="EYX")


def test_what_the_placing_says(tmp_path):
    placing = ForeignPlacing({"Y": 1.0}, setup="day 2", sd=3e-4, signals={"T_x": 21.5})
    campaign = import_iso230_table(write(tmp_path, "x.csv", LONG), "X", placing)
    assert set(campaign.setups) == {"day 2"}
    assert campaign.sd.tolist() == [3e-4] * 18
    assert campaign.conditions.signal("T_x").tolist() == [21.5] * 18


ANGLES = np.arange(0, 360, 15)


def circle(radial) -> str:
    """A ball bar test, ccw then cw, of a machine whose error is known: (x, y, sense) → µm."""
    rows = "".join(
        f"{a},{radial(np.cos(np.deg2rad(a)), np.sin(np.deg2rad(a)), s)!r},{w}\n"
        for s, w in ((1, "ccw"), (-1, "cw"))
        for a in ANGLES
    )
    return "# plane = XY\n# centre = 350, 450\n# radius = 100\nangle,deviation,direction\n" + rows


def test_ballbar(tmp_path):
    """Squareness c of Y to X: the error at (x, y) is (−c·y, 0); along the radius −c·R·sin·cos."""
    c = 50e-6
    text = circle(lambda x, y, _s: float(-c * 100 * x * y * 1e3))
    campaign = import_ballbar(
        write(tmp_path, "c.csv", text), ForeignPlacing({"Z": -180.0}), machine=CMM
    )
    q = campaign.conditions
    np.testing.assert_allclose(np.hypot(q.position("X") - 350, q.position("Y") - 450), 100)
    assert q.u is not None
    np.testing.assert_allclose(q.u[3], [2**-0.5, 2**-0.5, 0])
    y = q.position("Y") - 450
    np.testing.assert_allclose(campaign.value, -c * y * q.u[:, 0], atol=1e-12)
    at_45 = np.flatnonzero(np.isclose(q.u[:, 0], 2**-0.5) & (q.u[:, 1] > 0))
    assert [(q.direction("X")[i], q.direction("Y")[i]) for i in at_45] == [(-1, 1), (1, -1)]
    assert q.direction("X")[0] == 0  # turning round
    (setup,) = campaign.setups.values()
    assert setup.free == ("zero", "frame")
    assert "outward along the radius = measured − nominal" in notes(campaign)


def test_ballbar_columns_for_both_senses(tmp_path):
    text = "theta [deg],ccw [mm],cw [mm]\n0,0.001,0.002\n90,0.003,\n"
    campaign = import_ballbar(
        write(tmp_path, "c.csv", text), plane="ZX", centre=(1.0, 2.0), radius=10.0
    )
    assert campaign.value.tolist() == [0.001, 0.002, 0.003]
    np.testing.assert_allclose(campaign.conditions.position("Z"), [11, 11, 1])
    np.testing.assert_allclose(campaign.conditions.u, [[0, 0, 1], [0, 0, 1], [1, 0, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("# plane = XY\n", "", "plane is not known"),
        ("plane = XY", "plane = XW", "no such plane"),
        ("# centre = 350, 450\n", "", "centre is not known"),
        ("centre = 350, 450", "centre = 350", "not a point"),
        ("# radius = 100\n", "", "radius is not known"),
        ("radius = 100", "radius = -1", "not a radius"),
        ("angle,deviation", "a,b", "not a circular test"),
        ("ccw", "left", "not a direction"),
    ],
)
def test_ballbar_tests_that_are_damaged(tmp_path, old, new, words):
    text = circle(lambda *_: 0.0).replace(old, new)
    with pytest.raises(InputError, match=words):
        import_ballbar(write(tmp_path, "c.csv", text))


def test_a_map_as_measured_rows(tmp_path):
    path = write(tmp_path, "map.txt", MAP)
    structure = Structure.parse("w b Y X Z t")
    campaign = import_map_rows(path, structure)
    assert campaign.n == 3 * 6 * 3
    assert all(s.free == () for s in campaign.setups.values())
    rows = campaign.conditions.setup == "map Y E_XY"
    np.testing.assert_allclose(campaign.value[rows], [0, 0.003, 0.006], atol=1e-12)
    rows = campaign.conditions.setup == "map Y E_CY"
    np.testing.assert_allclose(campaign.value[rows], [0, 9e-6, 18e-6], atol=1e-9)
    assert "actual − indicated" in notes(campaign)
    # laid beside the map's own model, through a file, nothing is left over
    model = import_map(load_map(path), structure)
    write_campaign(campaign, tmp_path / "rows.csv")
    left = compare(model, read_campaign(tmp_path / "rows.csv", model.machine))
    assert left.lengths.max < 1e-9
    assert left.rotations.max < 1e-12


def test_a_map_measured_with_a_tool_shows_its_angles(tmp_path):
    path = write(tmp_path, "map.txt", MAP)
    structure = Structure.parse("w b Y X Z t")
    campaign = import_map_rows(path, structure, ForeignPlacing(tool=(0.0, 0.0, -100.0)))
    rows = campaign.conditions.setup == "map Y E_XY"
    # Ry of Y, 8 µrad at 200 mm, on a lever of −100 mm: 3 − 0.8 µm
    np.testing.assert_allclose(campaign.value[rows][1], 0.003 - 8e-6 * 100, atol=1e-9)


MAP = """\
X Axis

Position	Lx	Ly	Lz	Rx	Ry	Rz
0	0	0	0	0	0	0
100	0.005	0.01	0.015	0.02	0.025	0.03
200	0.01	0.02	0.03	0.04	0.05	0.06

Y Axis

Position	Lx	Ly	Lz	Rx	Ry	Rz
0	0	0	0	0	0	0
200	0.003	0.04	0.006	0.007	0.008	0.009
400	0.006	0.08	0.012	0.014	0.016	0.018

Z Axis

Position	Lx	Ly	Lz	Rx	Ry	Rz
0	0	0	0	0	0	0
-50	0.013	0.011	0.012	0.013	0.014	0.015
-100	0.026	0.022	0.024	0.026	0.028	0.03
"""


def test_a_rotary_axis_stands_in_degrees_in_the_file(tmp_path):
    placing = ForeignPlacing(at={"Y": 1.0, "Z": 2.0, "B": np.deg2rad(30.0)})
    campaign = import_iso230_table(write(tmp_path, "x.csv", LONG), "X", placing, machine=MILL)
    write_campaign(campaign, tmp_path / "out.csv")
    assert ",30," in (tmp_path / "out.csv").read_text()


ACCIDENTS = st.lists(
    st.tuples(st.integers(0, 2000), st.integers(0, 3), st.binary(max_size=3)),
    min_size=1,
    max_size=3,
)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(ACCIDENTS, st.sampled_from(["rtl", "table", "ballbar"]))
def test_damaged_files_are_refused_or_whole(tmp_path, accidents, kind):
    text = {"rtl": RTL, "table": BY_TARGET, "ballbar": circle(lambda *_: 0.5)}[kind]
    data = text.encode()
    for at, cut, put in accidents:
        at %= len(data)
        data = data[:at] + put + data[at + cut :]
    path = write(tmp_path, f"x.{kind}", data)
    try:
        if kind == "rtl":
            campaign = import_rtl(path, AT)
        elif kind == "table":
            campaign = import_iso230_table(path, "X", AT)
        else:
            campaign = import_ballbar(path, AT)
    except InputError as error:
        assert error.file in (str(path), None)  # noqa: PT017
        return
    assert campaign.n > 0
    assert np.isfinite(campaign.value).all()
    write_campaign(campaign, tmp_path / "out.csv")
