"""The plan of measurements: order of ISO/TR 16907, 10.3, and steps worked out by hand."""

import json

import pytest

from tests.support.daemon.command_line import abbe

SIGNAL = '[machine.signals.T_x]\nunit = "degC"\nrole = "scale"\naxis = "X"\n'


def model_file(folder, structure, travels, more=""):
    text = f'format = "abbe-model/1"\n[machine]\nname = "M"\nstructure = "{structure}"\n'
    for axis, travel in travels.items():
        text += f"[machine.axes.{axis}]\ntravel = {list(travel)}\n"
    (folder / "m.toml").write_text(text + more, encoding="utf-8")
    return folder / "m.toml"


def planned(folder, structure, travels, *options, more=""):
    done = abbe("plan", model_file(folder, structure, travels, more), *options, "--json")
    assert done.status == 0, done.err
    return json.loads(done.out)


BRIDGE = {"Y": (0.0, 900.0), "X": (0.0, 700.0), "Z": (-360.0, 0.0)}
FIVE = {
    "X": (-300.0, 300.0), "Y": (-200.0, 200.0), "Z": (-400.0, 0.0), "A": (-120.0, 30.0),
    "C": (0.0, 360.0),
}  # fmt: skip


def test_a_bridge_from_the_bed_on(tmp_path):
    """Y carries X carries Z: angles, positioning, straightness, squareness to what is measured."""
    found = planned(tmp_path, "w b Y X Z t", BRIDGE, more=SIGNAL)
    assert [(m["axis"], m["what"], m["motions"]) for m in found["measurements"]] == [
        ("Y", "angles", ["E_AY", "E_CY", "E_BY"]),
        ("Y", "positioning", ["E_YY"]),
        ("Y", "straightness", ["E_XY", "E_ZY"]),
        ("X", "angles", ["E_BX", "E_CX", "E_AX"]),
        ("X", "positioning", ["E_XX"]),
        ("X", "straightness", ["E_YX", "E_ZX"]),
        ("X", "squareness", ["E_C0X to Y"]),
        ("Z", "angles", ["E_AZ", "E_BZ", "E_CZ"]),
        ("Z", "positioning", ["E_ZZ"]),
        ("Z", "straightness", ["E_XZ", "E_YZ"]),
        ("Z", "squareness", ["E_A0Z to Y"]),
        ("Z", "squareness", ["E_B0Z to X"]),
    ]
    assert found["record"] == ["T_x"]
    assert found["measurements"][1]["at"] == {"X": 350.0, "Z": -180.0}


def test_five_axes_linear_first_then_rotary_from_the_bed(tmp_path):
    """w C' A' Y' b X Z t: next to the bed Y' and X, then Z; of the rotary ones A', then C'."""
    found = planned(tmp_path, "w C' A' Y' b X Z t", FIVE)
    assert list(dict.fromkeys(m["axis"] for m in found["measurements"])) == list("YXZAC")
    of_c = [(m["what"], m["motions"]) for m in found["measurements"] if m["axis"] == "C"]
    assert of_c == [
        ("tilt", ["E_AC", "E_BC"]),
        ("radial and axial", ["E_XC", "E_YC", "E_ZC"]),
        ("positioning", ["E_CC"]),
        ("location", ["E_X0C", "E_Y0C", "E_A0C", "E_B0C"]),
    ]
    first = next(m for m in found["measurements"] if m["axis"] == "C")
    assert first["at"] == {"A": 0.0, "Y": 0.0, "X": 0.0, "Z": -200.0}
    (steps,) = first["steps"]
    assert (steps["unit"], steps["step"], steps["targets"]) == ("deg", pytest.approx(15.0), 25)


def steps_of(found, axis, what="positioning"):
    (one,) = [m for m in found["measurements"] if (m["axis"], m["what"]) == (axis, what)]
    return one["steps"]


def test_steps_without_a_wave(tmp_path):
    """900/14 = 64 → 50 mm: 19 targets; 360/14 = 25.7 → 25; 3000/14 = 214 → 200 (15 needed)."""
    found = planned(tmp_path, "w b Y X Z t", BRIDGE | {"X": (0.0, 3000.0)})
    expected = {"Y": (50.0, 19, 100.0), "X": (200.0, 16, 400.0), "Z": (25.0, 15, 50.0)}
    for axis, (step, targets, wave) in expected.items():
        (steps,) = steps_of(found, axis)
        assert (steps["step"], steps["targets"], steps["shortest_wave"]) == (step, targets, wave)
        assert (steps["uneven"], steps["wave"]) == (False, None)


def test_a_wave_that_the_whole_travel_can_hold(tmp_path):
    """sinc²(h/λ) = 0.8 at h = 0.2585·λ: 100 mm asks for 25.9 → 25 mm, which holds 0.811."""
    found = planned(tmp_path, "w b Y X Z t", BRIDGE, "--wave", "X=100")
    (steps,) = steps_of(found, "X")
    assert (steps["step"], steps["targets"], steps["wave"]) == (25.0, 29, 100.0)
    assert steps["held"] == pytest.approx(0.8106, abs=1e-4)


def test_a_short_wave_gets_a_short_line_beside_the_long_one(tmp_path):
    """10 mm asks for 2.5 mm, 281 targets over 700: five waves in the middle, and uneven steps."""
    found = planned(tmp_path, "w b Y X Z t", BRIDGE, "--wave", "X=10")
    long, short = steps_of(found, "X")
    assert (long["step"], long["targets"], long["uneven"]) == (50.0, 15, True)
    assert (short["first"], short["last"], short["step"]) == (325.0, 375.0, 2.5)
    assert (short["targets"], short["uneven"], short["shortest_wave"]) == (21, False, 5.0)
    assert len(steps_of(found, "X", "straightness")) == 1
    rotary = planned(tmp_path, "w C' A' Y' b X Z t", FIVE, "--wave", "C=20", "--held", "0.9")
    (steps,) = steps_of(rotary, "C")
    # sinc² = 0.9 at 0.1795: 3.59°, of which 3° divides 360
    assert steps["step"] == pytest.approx(3.0)


def test_in_words_and_on_a_page(tmp_path):
    model = model_file(tmp_path, "w b Y X Z t", BRIDGE, SIGNAL)
    done = abbe("plan", model, "--wave", "X=10", "--report", tmp_path / "p.html")
    assert done.status == 0, done.err
    assert "  7 X squareness: E_C0X to Y" in done.out
    assert "X 325 … 375 mm every 2.5 mm, 21 targets; holds 81 % of a wave of 10 mm" in done.out
    assert "no wave shorter than 100 mm" in done.out
    assert "record with every reading: T_x" in done.out
    html = (tmp_path / "p.html").read_text("utf-8")
    assert "E_C0X to Y" in html
    assert "each moved by a random part of a step" in html


@pytest.mark.parametrize("wave", ["Q=10", "X=1e4", "X=0", "X=abc", "X"])
def test_what_is_no_wave_is_one_line(tmp_path, wave):
    refused = abbe("plan", model_file(tmp_path, "w b Y X Z t", BRIDGE), "--wave", wave)
    assert refused.status in (1, 2)
    assert "Traceback" not in refused.err
    assert refused.err.strip()
