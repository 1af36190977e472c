"""ISO 10360-2 against examples worked out by hand, through the command line."""

import json

import pytest

from abbe.compcore.artefacts.permissible import PermissibleError
from abbe.compcore.errors import InputError
from tests.support.daemon.command_line import abbe
from tests.support.daemon.pages import packed

LENGTHS = (20.0, 200.0, 400.0, 600.0, 800.0)
"""mm; with ±(1.9 + L/400) µm the limits are ±1.95, 2.4, 2.9, 3.4, 3.9 µm."""
LIMITS = (1.95, 2.4, 2.9, 3.4, 3.9)
POSITIONS = ("+X+Y+Z", "+X+Y-Z", "+X-Y+Z", "+X-Y-Z", "X", "Y", "Z")
MPE = ("--mpe", "1.9 + L/400")


def error(position: int, length: int, run: int) -> float:
    """µm: at most 0.1 + 6·0.05 + 4·0.3 + 0.2 = 1.8, below every limit but 600 mm's share."""
    return round(0.1 + 0.05 * position + 0.3 * length + (0.0, 0.2, -0.1)[run], 3)


def lengths_file(path, changed=None, extra=(), head=""):
    """The 105 values, a few changed: (position, length, run) → µm; further rows at the end."""
    rows = ["position,calibrated,run,measured,sd"]
    for p, name in enumerate(POSITIONS):
        for i, length in enumerate(LENGTHS):
            for run in range(3):
                off = (changed or {}).get((p, i, run), error(p, i, run))
                rows.append(f"{name},{length},{run + 1},{length + off * 1e-3:.6f},0.2")
    path.write_text(head + "\n".join([*rows, *extra]) + "\n", encoding="utf-8")
    return path


def evaluated(path, *options):
    done = abbe("iso10360", path, *MPE, *options, "--json")
    assert done.status == 0, done.err
    return json.loads(done.out)


def test_105_values_inside(tmp_path):
    found = evaluated(lengths_file(tmp_path / "l.csv"), "--mpl-r0", "0.35")
    (test,) = found["tests"]
    assert (test["test"], test["outcome"], test["notes"]) == ("E0", "passes", [])
    values = [v for s in test["sets"] for v in s["values"]]
    assert len(values) == 105
    # by hand: 0.1 + 0.05·6 + 0.3·i + 0.2 over 1.95, 2.4 …: 0.308, 0.375, 0.414, 0.441, 0.462
    worst = test["worst"]
    assert (worst["position"], worst["length"], worst["run"]) == ("Z", 800.0, 2)
    assert worst["error"] == pytest.approx(1.8)
    assert worst["mpe"] == pytest.approx(3.9)
    # 0.2 − (−0.1)
    assert found["R0"]["value"] == pytest.approx(0.3)
    assert found["R0"]["outcome"] == "passes"
    assert evaluated(tmp_path / "l.csv", "--mpl-r0", "0.29")["R0"]["outcome"] == "fails"


def test_every_limit_is_that_of_its_length(tmp_path):
    found = evaluated(lengths_file(tmp_path / "l.csv"))
    for s in found["tests"][0]["sets"]:
        expected = LIMITS[LENGTHS.index(s["length"])]
        assert s["values"][0]["mpe"] == pytest.approx(expected)
    capped = abbe("iso10360", tmp_path / "l.csv", "--mpe", "min(1.9+L/400, 3)", "--json")
    (test,) = json.loads(capped.out)["tests"]
    mpe = {s["length"]: s["values"][0]["mpe"] for s in test["sets"]}
    assert mpe == pytest.approx(dict(zip(LENGTHS, (1.95, 2.4, 2.9, 3.0, 3.0), strict=True)))


AGAIN = [f"Y,400,{run},{400 + 1e-3:.6f},0.2" for run in range(4, 14)]


@pytest.mark.parametrize(
    ("changed", "extra", "outcome"),
    [
        ({(5, 2, 1): 3.0}, [], "again"),
        ({(5, 2, 1): 3.0}, AGAIN, "passes"),
        ({(5, 2, 1): 3.0}, AGAIN[:9], "again"),
        ({(5, 2, 1): 3.0}, [*AGAIN[:9], "Y,400,13,400.0030,0.2"], "fails"),
        ({(5, 2, 1): 3.0, (5, 2, 2): -3.0}, AGAIN, "fails"),
        ({(p, 4, 0): 4.0 for p in range(6)}, [], "fails"),
        ({(p, 4, 0): 4.0 for p in range(5)}, [], "again"),
    ],
    ids=["one", "ten more", "nine more", "one of ten", "two of three", "six sets", "five sets"],
)
def test_one_of_three_may_be_measured_ten_times_more(tmp_path, changed, extra, outcome):
    """At 400 mm ±2.9 µm, at 800 mm ±3.9 µm; in at most five of the 35 sets."""
    path = lengths_file(tmp_path / "l.csv", changed, extra)
    assert evaluated(path)["tests"][0]["outcome"] == outcome


@pytest.mark.parametrize(
    ("value", "simple", "acceptance", "rejection"),
    [(3.4, "passes", "passes", "passes"), (3.6, "passes", "fails", "passes"),
     (4.2, "fails", "fails", "passes"), (4.4, "fails", "fails", "fails")],
)  # fmt: skip
def test_who_proves_bears_the_uncertainty(tmp_path, value, simple, acceptance, rejection):
    """At 800 mm ±3.9 µm; U = 2·0.2 = 0.4 µm: zones ±3.5 and ±4.3. Two of three at the value."""
    path = lengths_file(tmp_path / "l.csv", {(0, 4, 0): value, (0, 4, 1): value})
    for decision, expected in (
        ("simple", simple), ("acceptance", acceptance), ("rejection", rejection)
    ):  # fmt: skip
        found = evaluated(path, "--decision", decision)
        assert found["tests"][0]["outcome"] == expected, decision
    wide = evaluated(path, "--decision", "acceptance", "--coverage", "1.65")
    limit = wide["tests"][0]["sets"][4]["values"][0]["limit"]
    assert limit == pytest.approx(3.9 - 1.65 * 0.2)


def test_a_length_is_taken_at_its_temperature(tmp_path):
    """500 mm of 11.5 ppm/K at 21.4 °C is 500.00805 mm; the machine reads 500.0100: +1.95 µm.

    Its uncertainty: hypot(0.3, 500·1.4·1 ppm/K = 0.7, 500·11.5 ppm·0.1 K = 0.575) = √0.910625 µm.
    """
    (tmp_path / "l.csv").write_text(
        "# expansion = 11.5\n# expansion_sd = 1\n# temperature_sd = 0.1\n"
        "position;calibrated;measured;sd;temperature\nX;500;500,0100;0,3;21,4\n"
    )
    asked = abbe("iso10360", tmp_path / "l.csv", *MPE)
    assert asked.status == 1
    assert "--not-reduced" in asked.err
    (test,) = evaluated(tmp_path / "l.csv", "--not-reduced")["tests"]
    (value,) = test["sets"][0]["values"]
    assert value["error"] == pytest.approx(1.95, abs=1e-6)
    assert value["sd"] == pytest.approx(0.910625**0.5, abs=1e-6)
    (test,) = evaluated(tmp_path / "l.csv", "--reduced")["tests"]
    assert test["sets"][0]["values"][0]["error"] == pytest.approx(10.0)
    assert test["sets"][0]["range"] is None
    assert "1 positions, the standard asks for 7" in test["notes"]


def test_e150_has_its_own_limit_and_two_positions(tmp_path):
    rows = ["test,position,calibrated,error 1 [um],error 2 [um],error 3 [um]"]
    for name in ("YZ+", "YZ-"):
        rows += [f"E150,{name},{length},2.0,2.1,1.9" for length in LENGTHS]
    (tmp_path / "l.csv").write_text("\n".join(rows) + "\n")
    refused = abbe("iso10360", tmp_path / "l.csv", *MPE)
    assert (refused.status, "--mpe-150" in refused.err) == (1, True)
    found = evaluated(tmp_path / "l.csv", "--mpe-150", "2.2")
    (test,) = found["tests"]
    assert (test["test"], test["outcome"], test["notes"]) == ("E150", "passes", [])
    assert found["R0"] is None
    assert evaluated(tmp_path / "l.csv", "--mpe-150", "2.05")["tests"][0]["outcome"] == "fails"


def test_in_words_and_on_a_page(tmp_path):
    path = lengths_file(tmp_path / "l.csv", {(5, 2, 1): 3.0}, head="# operator = A. Turner\n")
    done = abbe("iso10360", path, *MPE, "--mpl-r0", "1.2", "--report", tmp_path / "r.html")
    assert done.status == 0, done.err
    assert "ISO 10360-2, E0: not decided" in done.out
    assert "outside: +3.00 µm of ±2.90 at 400 mm, Y, run 2 (line 85)" in done.out
    # 3.0 less the least of the three, 0.1 + 0.05·5 + 0.6 − 0.1
    assert "R0 2.15 µm at 400 mm, Y; limit 1.2 µm: fails" in done.out
    html = (tmp_path / "r.html").read_text("utf-8")
    assert "E0: not decided" in html
    assert "A. Turner" in html
    assert html.count("<figure") == 1
    assert '"name":"MPE"' in packed(html, "figures")


@pytest.mark.parametrize(
    ("text", "at_600"),
    [("1.9", 1.9), ("1.9+L/300", 3.9), ("±(1.9+3L/1000)".replace("(", "").replace(")", ""), 3.7),
     ("1.7 + 0.3 L/100", 3.5), ("min(1.9 + L/300, 3.5)", 3.5)],
)  # fmt: skip
def test_limits_as_makers_write_them(text, at_600):
    assert PermissibleError.parse(text).at(600.0) == pytest.approx(at_600 * 1e-3)


@pytest.mark.parametrize("text", ["", "L", "1.9+L", "1.9+L/0", "-1", "nan", "1e9", "0", "2+X/3"])
def test_what_is_no_limit_is_refused(text):
    with pytest.raises(InputError):
        PermissibleError.parse(text)


def test_no_uncertainty_no_proof(tmp_path):
    (tmp_path / "l.csv").write_text("position,calibrated,1,2,3\nX,500,500.001,500.001,500.001\n")
    refused = abbe("iso10360", tmp_path / "l.csv", *MPE, "--decision", "acceptance")
    assert refused.status == 1
    assert refused.err.startswith(f"abbe: {tmp_path / 'l.csv'}, line 2, field 'sd'")
    assert len(refused.err.splitlines()) == 1


@pytest.mark.parametrize(
    "text",
    ["position,calibrated\nX,5\n", "a,b\n1,2\n", "position,calibrated,measured\nX,500,abc\n",
     "position,calibrated,measured\nX,-5,500\n", "position,calibrated,measured\n",
     "test,position,calibrated,measured\nE9,X,500,500\n"],
)  # fmt: skip
def test_bad_files_are_one_line(tmp_path, text):
    (tmp_path / "l.csv").write_text(text)
    refused = abbe("iso10360", tmp_path / "l.csv", *MPE)
    assert (refused.status, len(refused.err.splitlines())) == (1, 1)
    assert "l.csv" in refused.err


def test_another_commands_file_is_named(tmp_path):
    (tmp_path / "b.csv").write_text("angle,ccw,cw\n0,1,2\n90,1,2\n")
    refused = abbe("iso10360", tmp_path / "b.csv", *MPE)
    assert f"abbe import-campaign {tmp_path / 'b.csv'} --as ballbar" in refused.err
