"""``abbe import-grid``: rows of ISO/TR 16907's examples, and what the commands make of them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from tests.support.daemon.command_line import abbe

# compensation values, mm and degrees, at X = 0, 50, 100 (ISO/TR 16907, 9.3.1)
GRID = """# format = "abbe-grid/1"
# sign = "compensation"  # indicated - actual
X [mm],dX [mm],dY [mm],dZ [mm],dA [deg],dB [deg],dC [deg]
0,0,0,0,0,0,0
50,0.001,0.001,0,0.001,0.002,0
100,0.002,-0.002,-0.001,-0.003,-0.003,-0.002
"""
TURN = """// a yaw of the bridge of 20 µrad at Y = 200, and of the carriage
[ ECY ]
Gridpoints = {
   0.000 0
   200.000 0.00002
   400.000 0
}
[ EXX ]
Gridpoints = {
   0.000 0
   500.000 0.01
}
[ EYZ ]
Gridpoints = {
   -300.000 0
   0.000 0
}
"""
DEGREE = math.pi / 180.0


def run(*arguments: object, status: int = 0) -> str:
    done = abbe(*map(str, arguments))
    assert done.status == status, done.out + done.err
    return done.out


def corrections(model: Path, *where: str, more: tuple[str, ...] = ()) -> list[float]:
    answer = json.loads(run("correct", model, *where, "--json", *more))
    return [answer["correction"][a] for a in "XYZ"]


def imported(tmp_path: Path, text: str, dialect: str, *more: str) -> Path:
    source, model = tmp_path / "given.txt", tmp_path / "m.toml"
    source.write_text(text, encoding="utf-8")
    run("import-grid", source, "--controller", dialect, "-o", model, *more)
    return model


ISO = ("--structure", "w b Y X Z t", "--travel", "Y=0,400", "--travel", "Z=-300,0")


def test_rows_of_the_standard_correct_as_written_with_their_tool_and_with_another(tmp_path):
    model = imported(tmp_path, GRID, "grid-csv", *ISO, "--tool", "0,0,-100")
    same = "tool=0,0,-100"
    # error = −compensation; at 75 half of the two rows
    assert corrections(model, "X=75", "Y=10", "Z=-20", same) == pytest.approx(
        [-0.0015, 0.0005, 0.0005], abs=1e-9
    )
    assert corrections(model, "X=130", "Y=10", "Z=-20", same) == pytest.approx(
        [-0.002, 0.002, 0.001], abs=1e-9
    )
    # 80 mm longer, s = (0, 0, −80); ω = (−0.001°, −0.002°, 0); ω × s = (ω_y·s_z, −ω_x·s_z, 0)
    longer = [-0.001 + 0.002 * DEGREE * 80.0, -0.001 - 0.001 * DEGREE * 80.0, 0.0]
    assert corrections(model, "X=50", "Y=10", "Z=-20", "tool=0,0,-180") == pytest.approx(
        longer, abs=1e-9
    )
    # what to command: c + error(c) = target; the slope of the X error is −2e-5 from 50 to 100
    command = corrections(model, "X=75", "Y=10", "Z=-20", same, more=("--command",))
    assert command[0] == pytest.approx(0.0015 / (1.0 - 2e-5), abs=1e-9)


def test_etalon_exchange_has_levers(tmp_path):
    model = imported(tmp_path, TURN, "etalon-exchange", "--structure", "w b Y X Z t")
    # E_CY = 20 µrad, lever (X + 5, 7): −20e-6·7 and 20e-6·(X + 5); E_XX = 2 µm at X = 100
    assert corrections(model, "X=100", "Y=200", "Z=-50", "tool=5,7,0") == pytest.approx(
        [-20e-6 * 7.0 + 0.002, 20e-6 * 105.0, 0.0], abs=1e-9
    )


def test_tables_of_it_are_the_grid_again(tmp_path):
    model = imported(tmp_path, GRID, "grid-csv", *ISO)
    run("table", model, "--controller", "grid-csv", "-o", tmp_path / "t", "--points", "11")
    text = (tmp_path / "t" / "grid-xyz.csv").read_text(encoding="utf-8")
    rows = [line.split(",") for line in text.splitlines() if line[:1].isdigit()]
    at = {float(r[0]): [float(v) for v in r[3:]] for r in rows}
    assert at[50.0] == pytest.approx([0.001, 0.001, 0.0, 0.001, 0.002, 0.0], abs=1e-6)
    assert at[100.0] == pytest.approx([0.002, -0.002, -0.001, -0.003, -0.003, -0.002], abs=1e-6)


def test_onto_a_model_it_adds_and_the_record_stays(tmp_path):
    first = imported(tmp_path, TURN, "etalon-exchange", "--structure", "w b Y X Z t")
    grid = tmp_path / "grid.csv"
    grid.write_text(GRID, encoding="utf-8")
    both = tmp_path / "both.toml"
    run("import-grid", grid, "--controller", "grid-csv", "--onto", first, "-o", both)
    assert corrections(both, "X=50", "Y=0", "Z=-50") == pytest.approx([0.0, -0.001, 0.0], abs=1e-9)
    assert "error_grid" in run("history", both)
    left = tmp_path / "left.toml"
    run("remove", both, "error_grid file=m-", "-o", left)
    # without the yaw and the scale
    assert corrections(left, "X=50", "Y=0", "Z=-50") == pytest.approx([-0.001, -0.001, 0], abs=1e-9)


def test_compare_shows_what_the_grid_leaves(tmp_path):
    model = imported(tmp_path, GRID, "grid-csv", *ISO)
    measured = [
        '# format = "abbe-campaign/1"', "# [setups.a]", "# free = []",
        "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd",
        # −1 µm is the grid's error at X = 50, −1.5 at 75: 0.3 µm and −0.4 µm are left
        "0,a,displacement,50,0,0,1,0,0,-0.7,0.1", "1,a,displacement,75,0,0,1,0,0,-1.9,0.1",
    ]  # fmt: skip
    campaign = tmp_path / "c.csv"
    campaign.write_text("\n".join(measured) + "\n", encoding="utf-8")
    answer = json.loads(run("compare", model, campaign, "--json"))
    assert answer["rms"] == pytest.approx(math.sqrt((0.3**2 + 0.4**2) / 2), abs=1e-6)
    assert answer["max"] == pytest.approx(0.4, abs=1e-6)
    done = abbe("fit", model, campaign, "-o", tmp_path / "f.toml")
    assert done.status == 1
    assert "nothing to fit" in done.err


def test_diagnose_finds_what_has_come_since(tmp_path):
    """The grid as measured, and since then a scale that is 40 ppm longer."""
    model = imported(tmp_path, GRID, "grid-csv", *ISO)
    rows = ['# format = "abbe-campaign/1"', "# [setups.a]", '# free = ["zero"]',
            "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value,sd"]  # fmt: skip
    for i in range(63):
        x = 5.0 * (i % 21)
        grid = -x / 50.0  # µm: −1 at 50, −2 at 100
        rows.append(f"{i},a,displacement,{x},{(0, 100, 300)[i // 21]},0,0,1,0,0,"
                    f"{grid + 0.04 * x + 0.05 * (-1) ** i:.4f},0.1")  # fmt: skip
    campaign = tmp_path / "c.csv"
    campaign.write_text("\n".join(rows) + "\n", encoding="utf-8")
    answer = json.loads(run("diagnose", model, campaign, "--json"))
    assert answer["verdict"] == "missing"
    assert answer["candidates"][0]["spec"].startswith(("scale axis=X", "positioning axis=X"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--structure", "w b Y X Z t"), "how far Y travels"),
        (("--structure", "w b Y Z t"), "no such axis"),
        ((), "--structure"),
        ((*ISO, "--travel", "X=5,5"), "not a travel"),
        ((*ISO, "--tool", "1,2"), "tool"),
    ],
)
def test_what_is_missing_is_said_and_nothing_written(arguments, said, tmp_path):
    source, model = tmp_path / "given.csv", tmp_path / "m.toml"
    source.write_text(GRID, encoding="utf-8")
    done = abbe(
        "import-grid", str(source), "--controller", "grid-csv", "-o", str(model), *arguments
    )
    assert done.status in (1, 2)
    assert said in done.err
    assert "Traceback" not in done.err
    assert [p.name for p in tmp_path.iterdir()] == ["given.csv"]


def test_two_files_do_not_go_into_one_stream(tmp_path):
    source = tmp_path / "given.csv"
    source.write_text(GRID, encoding="utf-8")
    done = abbe("import-grid", source, "--controller", "grid-csv", "-o", "/dev/stdout", *ISO)
    assert done.status == 1
    assert "a model with a grid is two files" in done.err
    assert [p.name for p in tmp_path.iterdir()] == ["given.csv"]
