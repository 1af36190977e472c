"""Gauge blocks, step gauges and plates against errors written out here, by the command line."""

import json

import numpy as np
import pytest

from tests.support.daemon.command_line import abbe

SCALE, SQUARE = 20e-6, 30e-6
"""A machine whose X goes 20 ppm too far and whose Y leans by 30 µrad: what is probed is not
where the scales say."""


def there(indicated):
    """Where the tip really is: the machine's error written out, mm."""
    x, y, z = np.asarray(indicated, dtype=float).T
    return np.stack([x * (1 + SCALE) - SQUARE * y, y, z], axis=-1)


def probed(actual):
    """What the scales say when the tip touches a point."""
    x, y, z = np.asarray(actual, dtype=float).T
    return np.stack([(x + SQUARE * y) / (1 + SCALE), y, z], axis=-1)


MODEL = """\
format = "abbe-model/1"
[machine]
name = "M"
structure = "w b Y X Z t"
"""
for _axis in "XYZ":
    MODEL += f"[machine.axes.{_axis}]\ntravel = [-1000.0, 1000.0]\n"
TO_FIT = MODEL + '[[effects]]\nkind = "scale"\naxis = "X"\n[[effects]]\nkind = "squareness"\n'
TO_FIT += 'axes = ["Y", "X"]\n'


def block(length, direction, start=(-200.0, -150.0, 40.0)):
    u = np.array(direction) / np.linalg.norm(direction)
    return probed([np.array(start), np.array(start) + length * u])


def blocks_file(path, temperature=20.0, expansion=11.5e-6):
    """A block of 500.0002 mm in five orientations."""
    rows = ["position,calibrated,sd,expansion,temperature,x1,y1,z1,x2,y2,z2"]
    ways = {"X": (1, 0, 0), "Y": (0, 1, 0), "XY+": (1, 1, 0), "XY-": (1, -1, 0), "XYZ": (1, 1, 1)}
    for name, way in ways.items():
        actual = 500.0002 * (1 + expansion * (temperature - 20.0))
        ends = ",".join(f"{v:.7f}" for v in block(actual, way).ravel())
        rows.append(f"{name},500.0002,0.1,{expansion * 1e6},{temperature},{ends}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def closed_form(way):
    """µm: to first order L·(−k·u_x² + c·u_x·u_y), k the scale, c the squareness."""
    u = np.array(way) / np.linalg.norm(way)
    return 500.0 * (-SCALE * u[0] ** 2 + SQUARE * u[0] * u[1]) * 1e3


@pytest.mark.parametrize("temperature", [20.0, 22.5])
def test_a_block_in_five_orientations(tmp_path, temperature):
    """By hand: X −10, Y 0, XY+ −5 + 7.5 = +2.5, XY− −5 − 7.5 = −12.5, XYZ −3.33 + 5 = +1.67 µm."""
    done = abbe("gauges", blocks_file(tmp_path / "b.csv", temperature), "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    errors = {g["position"]: g["before"] for g in found["lengths"]}
    assert errors == pytest.approx(
        {"X": -10.0, "Y": 0.0, "XY+": 2.5, "XY-": -12.5, "XYZ": 5.0 / 3.0}, abs=2e-3
    )
    assert errors["XY-"] == pytest.approx(closed_form((1, -1, 0)), abs=2e-3)
    assert found["worst_before"] == pytest.approx(12.5, abs=2e-3)
    assert found["worst_after"] is None
    warm = found["lengths"][0]["actual"] - 500.0002
    assert warm == pytest.approx(500.0002 * 11.5e-6 * (temperature - 20.0))


def test_a_fit_of_a_block_finds_scale_and_squareness(tmp_path):
    """The imported rows carry the lengths to a model, whose correction takes the errors away."""
    path = blocks_file(tmp_path / "b.csv", 21.3)
    (tmp_path / "m.toml").write_text(TO_FIT, encoding="utf-8")
    campaign, fitted = tmp_path / "c.csv", tmp_path / "f.toml"
    done = abbe("import-campaign", path, "--as", "lengths", "-o", campaign, "--sd", "0.2",
                "--model", tmp_path / "m.toml")  # fmt: skip
    assert done.status == 0, done.err
    done = abbe("fit", tmp_path / "m.toml", campaign, "-o", fitted, "--json")
    assert done.status == 0, done.err
    effects = json.loads(done.out)["effects"]
    values = {n: p["value"] for e in effects for n, p in e["parameters"].items()}
    scale, square = values.values()
    assert scale == pytest.approx(SCALE, abs=2e-9)
    assert abs(square) == pytest.approx(SQUARE, abs=2e-9)
    after = abbe("gauges", path, "--model", fitted, "--json")
    found = json.loads(after.out)
    assert found["worst_before"] > 12.0
    assert found["worst_after"] < 0.01
    said = abbe("gauges", path, "--model", fitted, "--report", tmp_path / "r.html").out
    assert "worst length: 12.5 µm → 0.0 µm with f.toml" in said
    html = (tmp_path / "r.html").read_text("utf-8")
    assert "worst length after" in html
    assert html.count("<figure") == 1


def test_faces_of_a_step_gauge_share_the_first(tmp_path):
    """Six faces, two runs: each run is one set-up with one zero, not five lengths with five."""
    rows = ["position,run,calibrated,x1,y1,z1,x2,y2,z2"]
    for run in (1, 2):
        for k in range(1, 6):
            ends = ",".join(f"{v:.7f}" for v in block(100.0 * k, (1, 0, 0)).ravel())
            rows.append(f"X,{run},{100.0 * k},{ends}")
    (tmp_path / "s.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    done = abbe("import-campaign", tmp_path / "s.csv", "--as", "lengths", "-o", tmp_path / "c.csv")
    assert done.status == 0, done.err
    text = (tmp_path / "c.csv").read_text("utf-8").splitlines()
    header = next(i for i, line in enumerate(text) if not line.startswith("#"))
    names = text[header].split(",")
    rows = [dict(zip(names, line.split(","), strict=True)) for line in text[header + 1 :]]
    assert len(rows) == 12
    assert len({row["setup"] for row in rows}) == 2
    # the actual length is 20 ppm longer than indicated: +2 µm a step
    values = [float(row["value"]) for row in rows[:6]]
    assert values == pytest.approx([0.0, 2.0, 4.0, 6.0, 8.0, 10.0], abs=1e-3)
    assert {row["ux"] for row in rows} == {"1"}


def plate_file(path, holes=False, noise=None):
    """Five by five balls every 100 mm on a plate that stands turned and tilted."""
    grid = np.array([(100.0 * i, 100.0 * j, 0.0) for j in range(5) for i in range(5)])
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    tilt = np.array([[1, 0, 0], [0, np.cos(0.2), -np.sin(0.2)], [0, np.sin(0.2), np.cos(0.2)]])
    point = probed(grid @ (tilt @ turn).T + np.array([-150.0, -220.0, 30.0]))
    point = point if noise is None else point + noise
    rows = ["placing,ball,cx,cy" + ("" if holes else ",cz") + ",x,y,z"]
    for k, (cal, at) in enumerate(zip(grid, point, strict=True)):
        calibrated = cal[:2] if holes else cal
        cells = [f"{v:.7f}" for v in (*calibrated, *at)]
        rows.append(f"A,{k + 1},{','.join(cells)}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("holes", [False, True])
def test_a_plate_and_its_correction(tmp_path, holes):
    """The worst length is that of the pair for which the closed form is greatest."""
    path = plate_file(tmp_path / "p.csv", holes)
    done = abbe("gauges", path, "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    (plate,) = found["plates"]
    assert plate["planar"] is holes
    grid = np.array([(100.0 * i, 100.0 * j, 0.0) for j in range(5) for i in range(5)])
    rows = path.read_text("utf-8").splitlines()[1:]
    at = np.array([[float(v) for v in row.split(",")[-3:]] for row in rows])
    pairs = [(i, j) for i in range(25) for j in range(i)]
    errors = [np.linalg.norm(at[i] - at[j]) - np.linalg.norm(grid[i] - grid[j]) for i, j in pairs]
    worst = max(errors, key=abs)
    assert plate["before"]["worst_length"]["error"] == pytest.approx(worst * 1e3, abs=1e-3)
    assert found["worst_before"] == pytest.approx(abs(worst) * 1e3, abs=1e-3)
    (tmp_path / "m.toml").write_text(TO_FIT, encoding="utf-8")
    imported = abbe("import-campaign", path, "--as", "plate", "-o", tmp_path / "c.csv", "--sd",
                    "0.2", "--model", tmp_path / "m.toml")  # fmt: skip
    assert imported.status == 0, imported.err
    assert f"{(2 if holes else 3) * 25} rows in set-up p A" in imported.out
    fit = abbe("fit", tmp_path / "m.toml", tmp_path / "c.csv", "-o", tmp_path / "f.toml")
    assert fit.status == 0, fit.err
    after = abbe("gauges", path, "--model", tmp_path / "f.toml", "--report", tmp_path / "r.html")
    assert after.status == 0, after.err
    assert "→ 0.0 µm with f.toml" in after.out
    assert "Plate, placing A" in (tmp_path / "r.html").read_text("utf-8")


def test_one_ball_that_is_wrong_is_seen_as_it_is(tmp_path):
    """A ball 10 µm high of 25: the least-squares plane takes (1/25 + …) of it; the rest is left."""
    noise = np.zeros((25, 3))
    noise[12, 2] = 10e-3  # the middle ball: its leverage on the plane is 1/25 exactly
    perfect = plate_file(tmp_path / "a.csv")
    plain = json.loads(abbe("gauges", perfect, "--json").out)["plates"][0]["points"][12]["before"]
    wrong = plate_file(tmp_path / "b.csv", noise=noise)
    found = json.loads(abbe("gauges", wrong, "--json").out)["plates"][0]["points"][12]["before"]
    assert found[2] - plain[2] == pytest.approx(10.0 * 24 / 25, abs=2e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("placing,ball,cx,cy,cz,x,y,z\nA,1,0,0,0,0,0,0\nA,2,1,0,0,1,0,0\n", "three points"),
        ("placing,ball,cx,cy,cz,x,y,z\n" + "".join(f"A,{i},{i},0,0,{i},0,0\n" for i in range(4)),
         "three points"),
        ("placing,ball,cx,cy,cz,x,y,z\nA,1,0,0,0,0,0,0\nA,2,100,0,0,100,0,0\nA,3,0,90,0,0,70,0\n",
         "not where the plate"),
        ("position,calibrated,x1,y1,z1,x2,y2,z2\nX,5,1,1,1,1,1,1\n", "two probed points"),
        ("a,b\n1,2\n", "not a table of measured lengths"),
    ],
)  # fmt: skip
def test_bad_files_are_one_line(tmp_path, text, message):
    (tmp_path / "p.csv").write_text(text)
    refused = abbe("gauges", tmp_path / "p.csv")
    assert (refused.status, len(refused.err.splitlines())) == (1, 1)
    assert message in refused.err


def test_a_signal_that_the_model_needs_is_named(tmp_path):
    model = MODEL + '[machine.signals.T_x]\nunit = "degC"\nrole = "scale"\naxis = "X"\n'
    model += '[[effects]]\nkind = "scale_expansion"\naxis = "X"\nsignals = ["T_x"]\n'
    model += '[effects.parameters.alpha]\nvalue = 1e-5\nsd = 1e-7\nunit = "1/K"\n'
    (tmp_path / "m.toml").write_text(model, encoding="utf-8")
    path = blocks_file(tmp_path / "b.csv")
    refused = abbe("gauges", path, "--model", tmp_path / "m.toml")
    assert refused.status == 1
    assert "'T_x'" in refused.err
    text = path.read_text("utf-8").splitlines()
    warm = [text[0] + ",T_x", *(line + ",21.0" for line in text[1:])]
    path.write_text("\n".join(warm) + "\n", encoding="utf-8")
    found = json.loads(abbe("gauges", path, "--model", tmp_path / "m.toml", "--json").out)
    first = found["lengths"][0]
    # a scale 1 K too warm is 10 ppm too long: the correction adds 5 µm over 500 mm
    assert first["after"] - first["before"] == pytest.approx(5.0, abs=1e-3)
