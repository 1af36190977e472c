"""``abbe import-campaign`` as a user runs it."""

import json
import sys

import pytest

from abbe.daemon.cli import main

TABLE = "target,1+,1-,2+,2-,3+,3-\n0,0,4,1,4,2,4\n100,3,5,4,6,5,7\n200,6,1,6,3,6,5\n"
MODEL = """\
format = "abbe-model/1"
[machine]
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 700.0]
[machine.axes.Y]
travel = [0.0, 900.0]
[machine.axes.Z]
travel = [-360.0, 0.0]
"""


@pytest.fixture
def abbe(monkeypatch, capsys, tmp_path):
    """Run a command in a folder with a table and a model; exit status, output, error."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.csv").write_text(TABLE)
    (tmp_path / "model.toml").write_text(MODEL)

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["abbe", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            main()
        out, err = capsys.readouterr()
        return int(caught.value.code or 0), out, err

    return run


def test_from_a_table_to_the_standard_s_results(abbe):
    status, out, err = abbe(
        "import-campaign", "x.csv", "--as", "iso230-2", "--axis", "X", "--at", "Y=450,Z=-180",
        "--tool", "0,0,-120", "--signal", "T_x=20.5", "--sd", "0.3", "--model", "model.toml",
        "-o", "c.csv",
    )  # fmt: skip
    assert (status, err) == (0, "")
    assert "sign: error = deviation as tabulated (actual − target, ISO 230-2)" in out
    assert "18 rows in set-up x → c.csv" in out
    status, out, _ = abbe("iso230", "c.csv", "--json")
    (result,) = json.loads(out)["positioning"]
    assert [result[k] for k in "AREMB"] == pytest.approx([9, 8, 5, 2.5, 3])


def test_an_axis_that_was_not_stated(abbe, tmp_path):
    status, out, err = abbe(
        "import-campaign", "x.csv", "--as", "iso230-2", "--axis", "X", "--model", "model.toml",
        "-o", "c.csv",
    )  # fmt: skip
    assert (status, out) == (1, "")
    assert "the position of axis Y is not stated" in err
    assert not (tmp_path / "c.csv").exists()


@pytest.mark.parametrize(
    "options",
    [
        ["--as", "iso230-2"],
        ["--as", "map"],
        ["--as", "other"],
        ["--as", "iso230-2", "--axis", "X", "--sign", "2"],
    ],
)
def test_wrong_usage(abbe, options):
    assert abbe("import-campaign", "x.csv", *options, "-o", "c.csv")[0] == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--axis", "X", "--at", "Q=1"], "not the name of an axis"),
        (["--axis", "X", "--at", "Y"], "KEY=VALUE"),
        (["--axis", "X", "--tool", "1,2"], "not three numbers"),
        (["--axis", "X", "--unit", "furlong"], "wrong unit"),
    ],
)
def test_bad_values(abbe, options, words):
    status, _, err = abbe("import-campaign", "x.csv", "--as", "iso230-2", *options, "-o", "c.csv")
    assert status == 1
    assert words in err
    assert len(err.splitlines()) == 1


def test_a_ball_bar_with_all_its_options(abbe, tmp_path):
    (tmp_path / "b.csv").write_text("angle,deviation,direction\n0,1,ccw\n90,2,ccw\n0,3,cw\n")
    status, out, _ = abbe(
        "import-campaign", "b.csv", "--as", "ballbar", "--plane", "XY", "--centre", "350,450",
        "--radius", 100, "--at", "Z=-180", "--setup", "bar", "-o", "c.csv",
    )  # fmt: skip
    assert status == 0
    assert "plane XY, centre 350, 450 mm, radius 100 mm" in out
    text = (tmp_path / "c.csv").read_text()
    assert 'free = [\n#     "zero",\n#     "frame",' in text
    assert "0,bar,displacement,-180,450,450,0,1" in text


def test_a_thermal_test_of_a_logger(abbe, tmp_path):
    (tmp_path / "log.csv").write_text("time,T_bed,x1,x2\n0,20,1.5,2\n60,21,2.5,4\n")
    status, out, err = abbe(
        "import-campaign", "log.csv", "--as", "log", "--at", "X=1,Y=2,Z=-3", "--unit", "um",
        "--measured", "x1=X@0,0,-80", "--measured", "x2=X@0,0,-180", "--model", "model.toml",
        "-o", "c.csv",
    )  # fmt: skip
    assert (status, err) == (0, "")
    assert "x2 is the error along X at tool 0, 0, -180, in um" in out
    assert "4 rows in 2 set-ups → c.csv" in out
    status, _, err = abbe("compare", "model.toml", "c.csv", "--json")
    assert (status, err) == (0, "")


@pytest.mark.parametrize("text", ["x1", "x1=", "x1=E", "x1=X@1,2", "nothing=X"])
def test_a_log_s_readings_that_cannot_be_are_one_line(abbe, tmp_path, text):
    (tmp_path / "log.csv").write_text("time,x1\n0,1.5\n60,2.5\n")
    status, _, err = abbe(
        "import-campaign", "log.csv", "--as", "log", "--measured", text, "-o", "c.csv"
    )
    assert status == 1
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "c.csv").exists()
