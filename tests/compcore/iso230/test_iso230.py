"""ISO 230-2 and 230-6 against examples worked by hand and a machine of known squareness."""

# ruff: noqa: SIM300 (A, B, E, M, R are results, not constants)

import numpy as np
import pytest

from abbe.compcore.iso230.diagonals import evaluate_diagonals
from abbe.compcore.iso230.positioning import evaluate_positioning, positioning_runs
from tests.support.compcore.campaign_texts import CMM, MILL, read_text

HEAD = '# format = "abbe-campaign/1"\n'
UP = [[0, 1, 2], [3, 4, 5], [6, 6, 6]]
DOWN = [[4, 4, 4], [5, 6, 7], [1, 3, 5]]
"""µm: three targets (rows), three runs."""


def cycle(columns: str, fields: str, scale: float = 1.0, targets=(0.0, 100.0, 200.0)) -> str:
    """The test cycle of ISO 230-2 as a campaign: up and down in turn, ends passed."""
    rows, t = [], 0
    for run in range(3):
        for sense, table in ((1, UP), (-1, DOWN)):
            for i in range(3)[::sense]:
                t += 10
                value = table[i][run] * scale
                rows.append(fields.format(t=t, q=targets[i], d=sense, v=value))
    return HEAD + columns + "\n" + "\n".join(rows) + "\n"


LINEAR = cycle(
    "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value",
    "{t},x_pos,displacement,{q},450,-180,{d},1,0,0,{v}",
)


def test_a_worked_example(tmp_path):
    """By hand: means ↑ 1 4 6, ↓ 4 6 3; s ↑ 1 1 0, ↓ 0 1 2; B_i −3 −2 3.

    R_i: max(2+0+3; 4; 0) = 5, max(2+2+2; 4; 4) = 6, max(0+4+3; 0; 8) = 8. A: highest mean + 2 s is
    6 + 2·1 = 8 (↓, second target), lowest 1 − 2·1 = −1 (↑, first) and 3 − 2·2 = −1 (↓, third).
    """
    (runs,) = positioning_runs(read_text(tmp_path, LINEAR), CMM)
    assert (runs.setup, runs.axis, runs.unit) == ("x_pos", "X", "mm")
    np.testing.assert_array_equal(runs.targets, [0, 100, 200])
    np.testing.assert_allclose(runs.up, np.array(UP) * 1e-3)
    np.testing.assert_allclose(runs.down, np.array(DOWN) * 1e-3)
    r = evaluate_positioning(runs)
    np.testing.assert_allclose(r.mean_up, [1e-3, 4e-3, 6e-3])
    np.testing.assert_allclose(r.mean_down, [4e-3, 6e-3, 3e-3])
    np.testing.assert_allclose(r.s_up, [1e-3, 1e-3, 0], atol=1e-15)
    np.testing.assert_allclose(r.s_down, [0, 1e-3, 2e-3], atol=1e-15)
    np.testing.assert_allclose(r.reversal, [-3e-3, -2e-3, 3e-3])
    np.testing.assert_allclose(r.repeatability, [5e-3, 6e-3, 8e-3])
    by_hand = {
        "B": 3, "B_mean": -2 / 3, "R": 8, "R_up": 4, "R_down": 8, "E": 5, "E_up": 5, "E_down": 3,
        "M": 2.5, "A": 9, "A_up": 7, "A_down": 9,
    }  # fmt: skip
    for name, um in by_hand.items():
        assert getattr(r, name) == pytest.approx(um * 1e-3), name
    assert r.notes == (
        "3 runs towards plus, the standard asks for 5",
        "3 runs towards minus, the standard asks for 5",
        "3 targets, the standard asks for at least 5",
    )


def test_a_laser_that_looks_the_other_way_measures_the_same(tmp_path):
    reversed_beam = cycle(
        "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value",
        "{t},x_pos,displacement,{q},450,-180,{d},-1,0,0,{v}",
        scale=-1.0,
    )
    (runs,) = positioning_runs(read_text(tmp_path, reversed_beam), CMM)
    np.testing.assert_allclose(runs.up, np.array(UP) * 1e-3)


def test_directions_follow_from_the_cycle_where_they_are_not_recorded(tmp_path):
    text = LINEAR.replace("X_dir,", "").replace(",1,1,0,0", ",1,0,0").replace(",-1,1,0,0", ",1,0,0")
    (runs,) = positioning_runs(read_text(tmp_path, text), CMM)
    np.testing.assert_allclose(runs.up, np.array(UP) * 1e-3)
    np.testing.assert_allclose(runs.down, np.array(DOWN) * 1e-3)


def test_a_rotary_axis_in_rad(tmp_path):
    text = cycle(
        "time,setup,kind,X,Y,Z,B,B_dir,ux,uy,uz,value",
        "{t},b_pos,rotation,1,2,3,{q},{d},0,1,0,{v}",
        targets=(0.0, 45.0, 90.0),
    )
    (runs,) = positioning_runs(read_text(tmp_path, text, MILL), MILL)
    assert (runs.axis, runs.unit) == ("B", "rad")
    np.testing.assert_allclose(runs.targets, np.deg2rad([0, 45, 90]))
    assert evaluate_positioning(runs).A == pytest.approx(9e-6)


def test_one_run_says_nothing_of_repeatability(tmp_path):
    lines = LINEAR.splitlines()
    r = evaluate_positioning(*positioning_runs(read_text(tmp_path, "\n".join(lines[:8])), CMM))
    assert (r.A, r.R, r.R_up, r.A_up) == (None, None, None, None)
    assert r.B == pytest.approx(5e-3)  # run 1: ↑ 0 3 6, ↓ 4 5 1
    assert r.E == pytest.approx(6e-3)
    assert r.M == pytest.approx(2e-3)
    assert "1 run towards plus, the standard asks for 5" in r.notes


def test_one_direction_only(tmp_path):
    lines = [line for line in LINEAR.splitlines() if ",-1,1,0,0," not in line]
    r = evaluate_positioning(*positioning_runs(read_text(tmp_path, "\n".join(lines)), CMM))
    assert (r.A, r.R, r.B, r.E, r.M, r.A_down) == (None,) * 6
    assert r.A_up == pytest.approx(7e-3)
    assert "not measured towards minus" in r.notes


def test_a_reading_missed_in_one_run(tmp_path):
    lines = LINEAR.splitlines()
    del lines[3]  # run 1 upwards, second target
    r = evaluate_positioning(*positioning_runs(read_text(tmp_path, "\n".join(lines)), CMM))
    assert r.mean_up[1] == pytest.approx(4.5e-3)
    assert r.s_up[1] == pytest.approx(np.sqrt(0.5) * 1e-3)
    assert "not every target was read in every run towards plus" in r.notes


@pytest.mark.parametrize(
    ("old", "new"),
    [
        pytest.param(",1,0,0,", ",0,1,0,", id="straightness"),
        pytest.param("displacement", "rotation", id="pitch"),
        pytest.param(",450,", ",{t},", id="another axis moves as well"),
    ],
)
def test_what_is_no_positioning_test(tmp_path, old, new):
    lines = LINEAR.splitlines()
    text = [lines[0], lines[1], *(x.replace(old, new.format(t=i)) for i, x in enumerate(lines[2:]))]
    assert positioning_runs(read_text(tmp_path, "\n".join(text)), CMM) == []


def diagonal_rows(setup: str, start: np.ndarray, end: np.ndarray, error) -> str:
    """A diagonal measured both ways; `error` (3,) mm at a point (3,) mm."""
    u = (end - start) / np.linalg.norm(end - start)
    rows = []
    for sense in (1, -1):
        for i in range(9)[::sense]:
            p = start + (end - start) * i / 8
            d = [int(np.sign(x)) * sense for x in end - start]
            value = float(error(p) @ u) * 1e3
            rows.append(
                f"0,{setup},displacement,{p[0]},{p[1]},{p[2]},{d[0]},{d[1]},{d[2]},"
                f"{u[0]:.12f},{u[1]:.12f},{u[2]:.12f},{value!r}"
            )
    return "\n".join(rows) + "\n"


def test_diagonals_give_squareness_back(tmp_path):
    """A machine with axes out of square and of wrong scale, from geometry alone.

    Its axes' true directions are written out; the error at a point is where they lead, less where
    they should.
    """
    xy, yz, zx = 20e-6, -35e-6, 50e-6
    x = np.array([1 + 8e-6, 0, 0])
    y = np.array([-np.sin(xy), np.cos(xy), 0])  # X to Y: 90° + xy
    z = np.array([-zx, -yz, 1 - 11e-6])  # Z·X = −zx, Z·Y = −yz: angles wider than 90°

    def error(p):
        return p[0] * x + p[1] * y + p[2] * z - p

    low, high = np.array([0.0, 0.0, -300.0]), np.array([600.0, 800.0, 0.0])
    text = HEAD + "time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,ux,uy,uz,value\n"
    for i, flip in enumerate(([0, 0, 0], [0, 0, 1], [0, 1, 0], [0, 1, 1])):
        start = np.where(flip, high, low)
        text += diagonal_rows(f"body{i}", start, np.where(flip, low, high), error)
    found = evaluate_diagonals(read_text(tmp_path, text), CMM)
    assert [d.name for d in found.diagonals] == ["+X+Y+Z", "+X+Y-Z", "+X-Y+Z", "+X-Y-Z"]
    assert all(d.body for d in found.diagonals)
    assert found.diagonals[0].length == pytest.approx(np.linalg.norm(high - low))
    assert found.squareness == pytest.approx(
        {("X", "Y"): xy, ("Y", "Z"): yz, ("Z", "X"): zx}, abs=1e-8
    )
    assert found.E_face is None
    assert found.E_body == pytest.approx(
        max(abs(d.slope) * d.length for d in found.diagonals), rel=1e-3
    )
    assert found.diagonals[0].result.B == pytest.approx(0.0, abs=1e-9)


def test_two_crossing_face_diagonals_tell_one_squareness(tmp_path):
    c = 30e-6

    def error(p):
        return np.array([-c * p[1], 0, 0])

    text = HEAD + "time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,ux,uy,uz,value\n"
    a, b = np.array([0.0, 0.0, -100.0]), np.array([400.0, 300.0, -100.0])
    text += diagonal_rows("one", a, b, error)
    alone = evaluate_diagonals(read_text(tmp_path, text), CMM)
    assert alone.squareness == {}
    text += diagonal_rows("other", np.array([400.0, 0, -100.0]), np.array([0.0, 300, -100]), error)
    both = evaluate_diagonals(read_text(tmp_path, text), CMM)
    assert [d.name for d in both.diagonals] == ["+X+Y", "+X-Y"]
    assert both.squareness == pytest.approx({("X", "Y"): c}, rel=1e-6)
    assert both.E_face is not None
    assert both.E_body is None


def test_a_path_that_is_no_diagonal(tmp_path):
    text = HEAD + "time,setup,kind,X,Y,Z,ux,uy,uz,value\n"
    for i in range(5):
        text += f"{i},bent,displacement,{i * 100},{i * i * 10},0,1,0,0,0\n"
    assert evaluate_diagonals(read_text(tmp_path, text), CMM).diagonals == ()
