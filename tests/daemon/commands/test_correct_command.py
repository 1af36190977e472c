from __future__ import annotations

import csv
import json
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.effects import make_effect
from abbe.compcore.effects.catalogue.error_grid import ErrorGrid, MeasuredTable
from abbe.compcore.files.grid_file import checksum, format_grid
from abbe.compcore.files.map_file import load_map
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.lag import first_order_lag
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.to_model import import_map
from abbe.compcore.model.model import Model, Term, Value
from tests.support.daemon.command_line import abbe

ROOT = Path(__file__).parents[3]
MAP = ROOT / "tests" / "data" / "bridge-map.txt"
POINT = ("X=200", "Y=600", "Z=-150")


def fitted(machine, kind, keys, *values):
    effect = make_effect(kind, keys)
    names = [p.name for p in (*effect.linear(machine), *effect.nonlinear(machine))]
    return Term(effect, {n: Value(v) for n, v in zip(names, values, strict=True)})


@pytest.fixture
def bridge(tmp_path):
    """The published map as a model file."""
    path = tmp_path / "bridge.toml"
    save_model(import_map(load_map(MAP), Structure.parse("w b Y X Z t")), path)
    return path


@pytest.fixture
def warm(tmp_path):
    """A model with temperatures, play, a lag and an effect that is not fitted."""
    axes = {a: Axis(a, t) for a, t in zip("XYZ", ((0, 700), (0, 900), (-360, 0)), strict=True)}
    signals = {s: Signal(s, role="scale", axis="X") for s in ("T_x", "T_slow", "T_unused")}
    m = Machine("warm", Structure.parse("w b Y X Z t"), axes, signals)
    terms = (
        fitted(m, "scale_expansion", {"axis": "X", "signals": ["T_x"]}, 10e-6),
        fitted(m, "scale_expansion", {"axis": "Y", "signals": ["T_slow"], "tau": 600.0}, 12e-6),
        fitted(m, "backlash", {"axis": "Z"}, 0.008),
        Term(make_effect("positioning", {"axis": "Z"})),
    )
    path = tmp_path / "warm.toml"
    save_model(Model(m, terms), path)
    return path


def answered(*arguments):
    done = abbe("correct", *arguments, "--json")
    assert done.status == 0, done.err
    return json.loads(done.out)


# --- one point -----------------------------------------------------------------------------------


def test_one_point_to_the_letter_of_the_format(bridge):
    found = answered(bridge, *POINT)
    assert found["indicated"] == {"Y": 600.0, "X": 200.0, "Z": -150.0}
    assert found["unit"] == "mm"
    assert {a: round(v, 4) for a, v in found["corrected"].items()} == {
        "X": 200.0469,
        "Y": 600.1875,
        "Z": -149.9208,
    }
    for axis in "XYZ":
        assert found["correction"][axis] == pytest.approx(
            found["corrected"][axis] - found["indicated"][axis], abs=1e-12
        )
    turn = np.array(found["orientation"])
    assert turn.shape == (3, 3)
    np.testing.assert_allclose(
        [turn[1, 0], turn[0, 2], turn[2, 1]], [132e-6, 116e-6, 100e-6], atol=5e-8
    )
    assert found["answers"] == "reading"
    assert "warnings" not in found


def test_the_tool_is_turned_by_the_orientation(bridge):
    tool = np.array([10.0, -20.0, -80.0])
    bare, with_tool = answered(bridge, *POINT), answered(bridge, *POINT, "tool=10,-20,-80")
    turn = np.array(bare["orientation"])
    more = [with_tool["correction"][a] - bare["correction"][a] for a in "XYZ"]
    np.testing.assert_allclose(more, turn @ tool - tool, atol=1e-12)


def test_a_table_for_people(bridge):
    done = abbe("correct", bridge, *POINT)
    assert done.status == 0
    for words in ("indicated", "200.0000 mm", "200.0469 mm", "46.90 µm", "187.55 µm", "79.20 µm",
                  "turned by A 100.0, B 116.0, C 132.0 µrad"):  # fmt: skip
        assert words in done.out
    assert done.err == ""


def test_a_command_reaches_the_target(bridge):
    found = answered(bridge, *POINT, "--command")
    assert found["indicated"] == {"Y": 600.0, "X": 200.0, "Z": -150.0}, "the target as given"
    assert found["answers"] == "command"
    assert found["contraction"] < 1e-3
    command = [f"{a}={found['corrected'][a]!r}" for a in "XYZ"]
    reached = answered(bridge, *command)["corrected"]
    for axis, target in found["indicated"].items():
        assert reached[axis] == pytest.approx(target, abs=1e-9)
        assert found["correction"][axis] == pytest.approx(found["corrected"][axis] - target)
    done = abbe("correct", bridge, *POINT, "--command")
    assert "target" in done.out
    assert "command" in done.out


def test_explained_parts_sum_to_the_correction(bridge):
    found = answered(bridge, *POINT, "tool=10,-20,-80", "--explain")
    assert len(found["effects"]) == 18
    for axis in "XYZ":
        parts = sum(part[axis] for part in found["effects"]) + found["second_order"][axis]
        assert parts == pytest.approx(found["correction"][axis], abs=1e-12)
        assert 0.0 < abs(found["second_order"][axis]) < 1e-5
    done = abbe("correct", bridge, *POINT, "tool=10,-20,-80", "--explain")
    assert "angular axis=Y about=Z shape=table" in done.out
    assert "positions=" not in done.out
    assert "second order" in done.out
    assert "what the correction is made of, µm:" in done.out


def test_explained_commands_sum_to_the_opposite(bridge):
    found = answered(bridge, *POINT, "--command", "--explain")
    for axis in "XYZ":
        parts = sum(part[axis] for part in found["effects"]) + found["second_order"][axis]
        assert parts == pytest.approx(-found["correction"][axis], abs=1e-9)


def test_outside_the_travel_is_said_once(bridge):
    done = abbe("correct", bridge, "X=450", "Y=600", "Z=-250")
    assert done.status == 0
    notes = done.err.splitlines()
    assert len(notes) == 2
    assert "X=450 mm is outside 0 … 400 mm" in notes[0]
    assert "Z=-250 mm is outside -200 … 0 mm" in notes[1]
    assert answered(bridge, "X=450", "Y=600", "Z=-150")["warnings"]


def test_signals_directions_and_what_is_not_fitted(warm):
    given = (*POINT, "T_x=22", "T_slow=21", "Z_dir=-1")
    found = answered(warm, *given)
    assert found["correction"]["X"] == pytest.approx(10e-6 * 200 * 2)
    assert found["correction"]["Y"] == pytest.approx(12e-6 * 600 * 1)
    assert found["correction"]["Z"] == pytest.approx(-0.004)
    assert found["warnings"] == [
        "T_slow: taken as steady for long (the model follows them slowly)",
        "not fitted yet, predicts 0: positioning axis=Z",
    ]


def test_a_thermometer_that_reads_wrong_needs_nothing_more(warm):
    """Its amendment copies the conditions: neither the time nor anything else is read thereby."""
    model = load_model(warm)
    steady = tuple(t for t in model.terms if t.effect.kind == "scale_expansion")[:1]
    given = (*POINT, "T_x=25")
    answers = []
    for kind, value in (("sensor_offset", 1.0), ("sensor_gain", 0.25), ("sensor_bend", 4e-4)):
        wrong = fitted(model.machine, kind, {"signal": "T_x"}, value)
        save_model(Model(model.machine, (*steady, wrong)), warm)
        found = answered(warm, *given)
        assert "warnings" not in found
        answers.append(found["corrected"]["X"])
    true = [4.0, 5.0 / 1.25, (np.sqrt(1.0 + 4.0 * 4e-4 * 5.0) - 1.0) / (2.0 * 4e-4)]
    np.testing.assert_allclose(answers, [200.0 + 200.0 * 10e-6 * t for t in true], atol=2e-7)


def test_an_unknown_direction_is_said(warm):
    done = abbe("correct", warm, *POINT, "T_x=22", "T_slow=21")
    assert "Z's approach direction is not given (Z_dir=1 or -1)" in done.err


def test_signals_that_are_missing_are_named_with_what_to_add(warm):
    done = abbe("correct", warm, *POINT)
    assert done.status == 1
    assert done.out == ""
    assert done.err.count("\n") == 1
    assert "the model needs T_x, T_slow, not given (scale_expansion axis=X signals=T_x" in done.err
    assert "expected T_x=.. (degC) T_slow=.. (degC)" in done.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("X=200", "Y=600"), r"no position given for Z: expected Z=\.\. \(mm\)"),
        ((*POINT, "W=1"), "'W': the model knows no such axis or signal.*one of Y, X, Z, tool"),
        ((*POINT, "X=300"), "X is given twice"),
        ((*POINT, "300"), "cannot read an argument: found '300', expected KEY=VALUE"),
        (("X=abc", "Y=600", "Z=0"), "'X': not a number: found 'abc', expected a number in mm"),
        (("X=nan", "Y=600", "Z=0"), "'X': not a number: found 'nan'"),
        ((*POINT, "tool=1,2"), "'tool': not three numbers: found '1,2', expected x,y,z in mm"),
        ((*POINT, "X_dir=2"), "'X_dir': not a direction: found '2'"),
    ],
)
def test_mistakes_are_one_line_and_status_1(bridge, arguments, message):
    done = abbe("correct", bridge, *arguments)
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith("abbe: ")
    assert done.err.count("\n") == 1
    assert re.search(message, done.err), done.err


def test_wrong_usage_is_status_2(bridge, tmp_path):
    assert abbe("correct", bridge, "--points", tmp_path / "a.csv").status == 2
    assert abbe("correct", bridge, "-o", tmp_path / "a.csv", *POINT).status == 2
    both = ("--points", tmp_path / "a.csv", "-o", tmp_path / "b.csv", "--explain")
    assert abbe("correct", bridge, *both).status == 2
    assert abbe("correct").status == 2


def test_a_broken_model_is_one_line(tmp_path):
    path = tmp_path / "m.toml"
    path.write_text('format = "abbe-model/1"\n[machine]\nstructure = "w b X t"\nname = 5\n')
    done = abbe("correct", path, "X=1")
    assert done.status == 1
    assert "m.toml, line 4, field 'machine.name'" in done.err


def rotary_model():
    axes = {a: Axis(a, (-500.0, 500.0)) for a in "XYZ"} | {"C": Axis("C", (-math.pi, math.pi))}
    m = Machine("five", Structure.parse("w X' b Y Z C (C) t"), axes)
    terms = (
        fitted(m, "rotary_location", {"axis": "C"}, *[0.01, -0.02, 1e-5, 2e-5, 0.0]),
        fitted(m, "scale", {"axis": "X"}, 2e-5),
    )
    return Model(m, terms)


def test_rotary_axes_are_in_degrees_at_the_edge(tmp_path):
    model = rotary_model()
    save_model(model, tmp_path / "five.toml")
    found = answered(tmp_path / "five.toml", *POINT, "C=90", "tool=10,0,-100")
    assert found["indicated"]["C"] == 90.0
    assert found["corrected"]["C"] == 90.0
    assert set(found["correction"]) == {"X", "Y", "Z"}
    at = Conditions.at(
        {"X": 200.0, "Y": 600.0, "Z": -150.0, "C": math.pi / 2}, tool=(10.0, 0.0, -100.0)
    )
    expected = model.axis_error(at)
    for axis in "XYZ":
        assert found["correction"][axis] == pytest.approx(expected[axis][0], abs=1e-12)
    turned = answered(tmp_path / "five.toml", *POINT, "C=90", "(C)=180", "tool=10,0,-100")
    assert turned["correction"] != found["correction"], "the spindle turns the tool's offset"
    done = abbe("correct", tmp_path / "five.toml", *POINT, "C=190")
    assert "C=190° is outside -180 … 180°" in done.err
    assert "190.0000°" in done.out


def test_the_installed_command_and_start_up(bridge):
    """In a process of its own, as users run it."""
    code = "from abbe.daemon.cli import main; main()"
    run = subprocess.run(
        [sys.executable, "-c", code, "correct", str(bridge), *POINT, "--json"],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert json.loads(run.stdout)["corrected"]["X"] == pytest.approx(200.0469, abs=5e-5)


def test_the_page_about_correct_tells_every_option_and_the_readme_s_first_steps_work(tmp_path):
    page = (ROOT / "docs" / "correct.md").read_text(encoding="utf-8")
    for option in ("--command", "--explain", "--points", "--json", "-o out.csv"):
        assert option in page
        assert option.split()[0] in abbe("correct", "--help").out
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    steps = re.findall(r"^abbe (import-map|correct) (.*)$", readme, re.M)
    assert [name for name, _ in steps[:2]] == ["import-map", "correct"]
    for name, arguments in steps[:2]:
        words = [w.strip('"') for w in re.findall(r'"[^"]*"|\S+', arguments)]
        words = [str(tmp_path / w) if w == "machine.toml" else w for w in words]
        words = [str(ROOT / w) if w.startswith("examples/") else w for w in words]
        done = abbe(name, *words)
        assert done.status == 0, done.err
    for shown in ("200.0469 mm", "600.1875 mm", "-149.9208 mm"):
        assert shown in done.out


# --- many points ---------------------------------------------------------------------------------


def rows_of(path):
    lines = [t for t in path.read_text(encoding="utf-8").splitlines() if not t.startswith("#")]
    return list(csv.DictReader(lines))


def test_a_file_of_points(bridge, tmp_path):
    rng = np.random.default_rng(0)
    n = 40_000
    q = np.column_stack([rng.uniform(0, 400, n), rng.uniform(0, 800, n), rng.uniform(-200, 0, n)])
    tool = rng.uniform(-50, 50, (n, 3))
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    head = '# format = "abbe-campaign/1"\n# notes = "anything"\n'
    text = "\n".join(
        f"p{i},{','.join(f'{v:.6f}' for v in (*q[i], *tool[i]))},seen" for i in range(n)
    )
    source.write_text(f"{head}name,X,Y,Z,tool_x,tool_y,tool_z,remark\n{text}\n", encoding="utf-8")
    done = abbe("correct", bridge, "--points", source, "-o", out)
    assert done.status == 0, done.err
    assert "40000 points, greatest correction" in done.out
    assert out.read_text(encoding="utf-8").startswith(head), "metadata stays"
    rows = rows_of(out)
    assert list(rows[0]) == [
        *["name", "X", "Y", "Z", "tool_x", "tool_y", "tool_z", "remark"],
        *("X_corrected", "Y_corrected", "Z_corrected"),
    ]
    assert len(rows) == n
    assert (rows[7]["name"], rows[7]["remark"]) == ("p7", "seen")
    at = Conditions({a: np.round(q[:, k], 6) for k, a in enumerate("XYZ")}, tool=np.round(tool, 6))
    error = load_model(bridge).axis_error(at)
    for axis in "XYZ":
        got = np.array([float(r[f"{axis}_corrected"]) for r in rows])
        np.testing.assert_allclose(got, at.position(axis) + error[axis], atol=1e-7)


def test_a_file_of_targets_to_commands(bridge, tmp_path):
    source, out, back = (tmp_path / n for n in ("in.csv", "out.csv", "back.csv"))
    source.write_text("X,Y,Z\n200,600,-150\n10.5,700,-20\n")
    assert abbe("correct", bridge, "--points", source, "-o", out, "--command").status == 0
    commands = rows_of(out)
    columns = "\n".join(",".join(r[f"{a}_corrected"] for a in "XYZ") for r in commands)
    source.write_text(f"X,Y,Z\n{columns}\n")
    assert abbe("correct", bridge, "--points", source, "-o", back).status == 0
    reached = [[float(r[f"{a}_corrected"]) for a in "XYZ"] for r in rows_of(back)]
    np.testing.assert_allclose(reached, [[200, 600, -150], [10.5, 700, -20]], atol=2e-7)


def test_what_the_file_lacks_may_stand_on_the_command_line(bridge, tmp_path):
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_text("X,Y\n200,600\n")
    done = abbe("correct", bridge, "--points", source, "-o", out, "Z=-150", "tool=0,0,-80")
    assert done.status == 0, done.err
    expected = answered(bridge, *POINT, "tool=0,0,-80")["corrected"]
    for axis in "XYZ":
        assert float(rows_of(out)[0][f"{axis}_corrected"]) == pytest.approx(
            expected[axis], abs=1e-7
        )


def test_json_of_a_file(bridge, tmp_path):
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_text("X,Y,Z\n200,600,-150\n500,600,-150\n")
    done = abbe("correct", bridge, "--points", source, "-o", out, "--json")
    found = json.loads(done.out)
    assert found["rows"] == 2
    assert found["out"] == str(out)
    assert found["unit"] == "um"
    assert "X=500 mm is outside 0 … 400 mm" in found["warnings"][0]
    assert done.err.count("outside") == 1


def test_named_tools_of_a_campaign(bridge, tmp_path):
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_text(
        '# format = "abbe-campaign/1"\n# [tools.long]\n# offset = [0.0, 0.0, -80.0]\n'
        "X,Y,Z,tool\n200,600,-150,long\n200,600,-150,\n"
    )
    assert abbe("correct", bridge, "--points", source, "-o", out).status == 0
    got = [float(r["X_corrected"]) for r in rows_of(out)]
    bare, tool = answered(bridge, *POINT), answered(bridge, *POINT, "tool=0,0,-80")
    assert got == pytest.approx([tool["corrected"]["X"], bare["corrected"]["X"]], abs=1e-7)


def test_a_lag_goes_on_from_piece_to_piece(warm, tmp_path, monkeypatch):
    """Any number of rows at once gives the same numbers as all at once."""
    rng = np.random.default_rng(3)
    n = 900
    time = np.cumsum(rng.uniform(1.0, 40.0, n)).round(3)
    slow = (20.0 + 3.0 * np.sin(time / 900.0)).round(4)
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    body = "\n".join(f"{t},100,500,-50,20,{s},1" for t, s in zip(time, slow, strict=True))
    source.write_text(f"time,X,Y,Z,T_x,T_slow,Z_dir\n{body}\n")
    monkeypatch.setattr("abbe.compcore.files.points_file._PIECE", 64)
    done = abbe("correct", warm, "--points", source, "-o", out)
    assert done.status == 0, done.err
    got = np.array([float(r["Y_corrected"]) for r in rows_of(out)])
    lagged = first_order_lag(time, slow, 600.0)
    np.testing.assert_allclose(got, 500.0 + 12e-6 * 500.0 * (lagged - 20.0), atol=1e-7)
    assert np.ptp(got) > 0.01


def test_rows_out_of_the_order_of_time_are_refused_where_the_past_matters(
    warm, tmp_path, monkeypatch
):
    monkeypatch.setattr("abbe.compcore.files.points_file._PIECE", 2)
    source = tmp_path / "in.csv"
    rows = "".join(f"{t},100,500,-50,20,21\n" for t in (0, 10, 20, 30, 5))
    source.write_text(f"time,X,Y,Z,T_x,T_slow\n{rows}")
    done = abbe("correct", warm, "--points", source, "-o", tmp_path / "out.csv")
    assert done.status == 1
    assert "line 6, field 'time': rows are not in the order of time" in done.err


HEAD = "X,Y,Z\n200,600,-150\n"


@pytest.mark.parametrize(
    ("text", "more", "line", "message"),
    [
        ("X,Y\n1,2\n", (), 1, "'Z': a column is missing.*indicated position of axis Z, mm"),
        (HEAD + "1,2\n", (), 3, "too few fields: found 2, expected 3"),
        (HEAD + "1,2,3,4\n", (), 3, "too many fields"),
        (HEAD + "1,2,abc\n", (), 3, "'Z': not a number: found 'abc'"),
        (HEAD + "1,,3\n", (), 3, "'Y': not a number: found ''"),
        (HEAD + "1,nan,3\n", (), 3, "'Y': not a number: found 'nan'"),
        ("X,Y,Z,X\n1,2,3,4\n", (), 1, "'X': the same column twice"),
        ("X,Y,Z,W\n1,2,3,4\n", (), 1, "'W': the machine has no such axis"),
        ("X,Y,Z,X_dir\n1,2,3,1\n1,2,3,7\n", (), 3, "'X_dir': not a direction: found '7'"),
        ("X,Y,Z,X_corrected\n1,2,3,4\n", (), 1, "'X_corrected': the file has corrected columns"),
        (HEAD, ("X=5",), 1, "'X': given on the command line and in the file"),
        ("X,Y,Z\n", (), None, "no points"),
        ("", (), 1, "the header is missing"),
        ('X,Y,Z\n"1",2,x\n', (), 2, "'Z': not a number: found 'x'"),
    ],
)
def test_bad_rows_name_file_line_and_column_and_write_nothing(
    bridge, tmp_path, text, more, line, message
):
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_text(text)
    out.write_text("X,X_corrected\nprecious")
    done = abbe("correct", bridge, "--points", source, "-o", out, *more)
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith(f"abbe: {source}" + (f", line {line}" if line else "")), done.err
    assert re.search(message, done.err), done.err
    assert out.read_text() == "X,X_corrected\nprecious"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bridge.toml", "in.csv", "out.csv"]


def test_a_signal_that_file_and_command_line_lack(warm, tmp_path):
    source = tmp_path / "in.csv"
    source.write_text("time,X,Y,Z,T_x\n0,1,2,3,20\n")
    done = abbe("correct", warm, "--points", source, "-o", tmp_path / "out.csv")
    assert done.status == 1
    assert "in.csv, line 1: the model needs T_slow, not given" in done.err
    source.write_text("X,Y,Z,T_x,T_slow\n1,2,3,20,20\n")
    done = abbe("correct", warm, "--points", source, "-o", tmp_path / "out.csv")
    assert "'time': a column is missing: the model follows a signal slowly" in done.err


def test_quoted_cells_blank_lines_and_windows_line_ends(bridge, tmp_path):
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_bytes(b'\xef\xbb\xbfname,X,Y,Z\r\n"a, ""b""",200,600,-150\r\n\r\nc,1,2,-3\r\n')
    assert abbe("correct", bridge, "--points", source, "-o", out).status == 0
    rows = rows_of(out)
    assert [r["name"] for r in rows] == ['a, "b"', "c"]
    assert float(rows[0]["X_corrected"]) == pytest.approx(200.0469, abs=5e-5)


def test_a_command_that_cannot_be_found_names_the_lines(tmp_path):
    m = Machine("m", Structure.parse("w b Y X Z t"), {a: Axis(a, (0.0, 900.0)) for a in "XYZ"})
    save_model(Model(m, (fitted(m, "scale", {"axis": "X"}, -1.2),)), tmp_path / "m.toml")
    source = tmp_path / "in.csv"
    source.write_text("X,Y,Z\n5,0,0\n")
    done = abbe(
        "correct", tmp_path / "m.toml", "--points", source, "-o", tmp_path / "o.csv", "--command"
    )
    assert done.status == 1
    assert "in.csv, lines 2 to 2: the correction cannot be undone at X=5" in done.err
    done = abbe("correct", tmp_path / "m.toml", "X=5", "Y=0", "Z=0", "--command")
    assert done.status == 1
    assert "1.2 mm per mm of travel" in done.err


@pytest.fixture
def head(tmp_path):
    """A head whose B stands 80 µrad farther than it says."""
    axes = {a: Axis(a, (-500.0, 500.0)) for a in "XYZ"}
    axes |= {"C": Axis("C", (-3.0, 3.0)), "B": Axis("B", (-1.8, 1.8), location=(0.0, 0.0, 100.0))}
    m = Machine("head", Structure.parse("w b X Y Z C B (C1) t"), axes)
    table = MeasuredTable(ErrorMotion("B", "B"), ("B",), (np.zeros(1),), np.array([80e-6]))
    text = format_grid([table], {})
    grid = ErrorGrid(file="b.json").holding([table], checksum(text), text)
    path = tmp_path / "head.toml"
    save_model(Model(m, (Term(grid),), "exact"), path)
    return path


FIVE = ("X=100", "Y=20", "Z=-30", "C=0", "B=40", "tool=0,0,-150")


def test_a_command_turns_rotary_axes_back(head):
    done = abbe("correct", head, *FIVE, "--command", "--json")
    assert done.status == 0, done.err
    answer = json.loads(done.out)
    # E_BB of B is 80 µrad whatever else: B is sent back by just that, X Y Z stay
    assert answer["rotary_correction"]["B"] == pytest.approx(-math.degrees(80e-6), abs=1e-9)
    assert answer["rotary_correction"]["C"] == pytest.approx(0.0, abs=1e-9)
    assert answer["correction"] == pytest.approx({"X": 0.0, "Y": 0.0, "Z": 0.0}, abs=1e-6)
    assert answer["orientation_left"]["direction"] == pytest.approx(0.0, abs=1e-3)
    assert answer["orientation_left"]["near_pole"] is False


def test_held_axes_stay_and_what_is_left_is_reported(head):
    done = abbe("correct", head, *FIVE, "--command", "--hold", "all", "--json")
    answer = json.loads(done.out)
    assert answer["corrected"]["B"] == 40.0
    assert answer["orientation_left"]["direction"] == pytest.approx(80.0, abs=1e-3)
    # 80 µrad about Y over the arm from B's line to the tip, R_y(40°)·(0, 0, −250)
    arm_x, arm_z = -250.0 * math.sin(math.radians(40.0)), -250.0 * math.cos(math.radians(40.0))
    assert answer["correction"]["X"] == pytest.approx(-80e-6 * arm_z, abs=1e-5)
    assert answer["correction"]["Z"] == pytest.approx(80e-6 * arm_x, abs=1e-5)
    text = abbe("correct", head, *FIVE, "--command", "--hold", "C,B").out
    assert "points 80.00 µrad beside where it should" in text


def test_points_with_rotary_commands(head, tmp_path):
    points, out = tmp_path / "in.csv", tmp_path / "out.csv"
    points.write_text("X,Y,Z,C,B\n100,20,-30,0,40\n100,20,-30,50,-20\n", encoding="utf-8")
    done = abbe("correct", head, "--points", points, "-o", out, "tool=0,0,-150", "--command")
    assert done.status == 0, done.err
    rows = list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))
    for row, b in zip(rows, (40.0, -20.0), strict=True):
        assert float(row["B_corrected"]) == pytest.approx(b - math.degrees(80e-6), abs=1e-8)
        assert float(row["orientation_left_urad"]) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--hold", "B"), "--hold goes with --command"),
        (("--command", "--hold", "X"), "not a rotary axis"),
        (("--command", "--hold", "Q"), "not a rotary axis"),
    ],
)
def test_what_cannot_be_held_is_refused(head, words, said):
    done = abbe("correct", head, *FIVE, *words)
    assert done.status in (1, 2)
    assert said in done.err
