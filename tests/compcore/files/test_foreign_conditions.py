"""Foreign files: encodings, units that nobody states, a laser's environment and normalisation."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, write_campaign
from abbe.compcore.files.importers.lines.iso230_table import import_iso230_table
from abbe.compcore.files.importers.lines.laser_environment import Normalisation
from abbe.compcore.files.importers.lines.rtl import import_rtl
from abbe.compcore.files.text.encodings import decoded
from tests.compcore.files.test_importers import AT, RTL
from tests.support.compcore.campaign_texts import CMM
from tests.support.daemon.command_line import abbe

ENVIRONMENT = """\
ENVIRONMENT::
Air temperature: 21.40 C
Air pressure: 1009.3 mbar
Relative humidity: 45 %
Material temperature 1: 23.80 C
Material temperature 2: 24.20 C
Expansion coefficient: 11.70 ppm/C
Start time: 09:12:33
EQUIPMENT::
Laser: XL 123456
"""
SURROUNDED = RTL.replace("RUNS::", ENVIRONMENT + "RUNS::")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "cp1252", "utf-16"])
@pytest.mark.parametrize("name", ["Fräse Süd", "Größe fräßt", "Übermaß, 2 µm"])
def test_umlauts_stay_what_they_are(tmp_path, encoding, name):
    path = tmp_path / "x.rtl"
    path.write_bytes(RTL.replace("Werkstatt 7, Fräse", name).encode(encoding))
    campaign = import_rtl(path, AT)
    assert campaign.metadata[0]["machine"] == name
    out = tmp_path / "c.csv"
    write_campaign(campaign, out)
    assert read_campaign(out, CMM).metadata[0]["machine"] == name


@pytest.mark.parametrize("name", ["车间七号", "加工中心 No. 3", "测量"])
def test_chinese_stays_chinese(name):
    assert decoded(f"Machine: {name}\r\n".encode("gbk")) == f"Machine: {name}\r\n"


def test_a_table_in_windows_1252_is_read(tmp_path):
    path = tmp_path / "runs.csv"
    text = "# Prüfer = Jürgen\nposition;run;direction;Abweichung [µm]\n0;1;up;0,0\n100;1;up;3,5\n"
    path.write_bytes(text.replace("Abweichung", "deviation").encode("cp1252"))
    campaign = import_iso230_table(path, "X", AT)
    np.testing.assert_allclose(campaign.value, [0.0, 3.5e-3])


def test_the_environment_becomes_conditions(tmp_path):
    path = tmp_path / "x.rtl"
    path.write_text(SURROUNDED, encoding="utf-8")
    campaign = import_rtl(path, AT, normalisation=Normalisation(done=False))
    signals = campaign.conditions.signals
    assert {name: float(v[0]) for name, v in signals.items()} == pytest.approx(
        {"T_air": 21.4, "p_air": 1009.3, "h_air": 45.0, "T_material": 24.0}
    )
    head = campaign.metadata[0]
    assert "Start time: 09:12:33" in head["environment"], "what is not known is kept word for word"
    assert head["equipment"] == "Laser: XL 123456"
    out = tmp_path / "c.csv"
    write_campaign(campaign, out)
    again = read_campaign(out, CMM)
    assert again.metadata[0]["environment"] == head["environment"]
    assert again.conditions.signals["T_material"][0] == 24.0


def test_fahrenheit_is_taken_as_such(tmp_path):
    path = tmp_path / "x.rtl"
    text = SURROUNDED.replace("temperature: 21.40 C", "temperature: 68.0 F")
    path.write_text(text, encoding="utf-8")
    campaign = import_rtl(path, AT, normalisation=Normalisation(done=False))
    assert campaign.conditions.signals["T_air"][0] == pytest.approx(20.0)


def test_whether_readings_are_normalised_is_asked_where_the_file_tells_a_coefficient(tmp_path):
    path = tmp_path / "x.rtl"
    path.write_text(SURROUNDED, encoding="utf-8")
    with pytest.raises(InputError, match=r"normalised to 20 °C: found '11.7 ppm/K'.*--normalised"):
        import_rtl(path, AT)
    plain = tmp_path / "plain.rtl"
    plain.write_text(RTL, encoding="utf-8")
    notes = str(import_rtl(plain, AT).metadata[0]["notes"])
    assert "taken as not normalised to 20 °C: the file does not say" in notes


def test_normalised_readings_are_turned_back_to_what_the_machine_did(tmp_path):
    """11.7 ppm/K × 4 K × 100, 200 mm = 4.68 and 9.36 µm come back, whatever the datum."""
    path = tmp_path / "x.rtl"
    path.write_text(SURROUNDED, encoding="utf-8")
    bare = import_rtl(path, AT, normalisation=Normalisation(done=False))
    back = import_rtl(path, AT, normalisation=Normalisation(done=True))
    added = (back.value - bare.value) * 1e3
    at = bare.conditions.position("X")
    expected = {0.0: 0.0, 100.0: 4.68, 200.0: 9.36}
    np.testing.assert_allclose(added, [expected[x] for x in at], atol=1e-9)
    other = import_rtl(
        path, AT, normalisation=Normalisation(done=True, expansion=10e-6, temperature=25.0)
    )
    gained = (other.value - bare.value)[at == 200.0] * 1e3
    np.testing.assert_allclose(gained, 10.0, atol=1e-9)  # 10 ppm/K × 5 K × 200 mm
    pitch = import_rtl(path, AT, component="B", unit="urad")
    assert "normalised" not in str(pitch.metadata[0]["notes"]), "an angle is not a length"


def test_what_is_missing_to_turn_back_is_asked_for(tmp_path):
    path = tmp_path / "x.rtl"
    path.write_text(RTL, encoding="utf-8")
    with pytest.raises(InputError, match="without the coefficient of expansion.*--expansion"):
        import_rtl(path, AT, normalisation=Normalisation(done=True))
    with pytest.raises(InputError, match="without the temperature.*--material-temperature"):
        import_rtl(path, AT, normalisation=Normalisation(done=True, expansion=1e-5))


@pytest.mark.parametrize("heading", ["deviation", "deviation [mm]"])
def test_a_table_in_mm_is_not_taken_for_micrometres(tmp_path, heading):
    path = tmp_path / "runs.csv"
    path.write_text(
        f"position,run,direction,{heading}\n0,1,up,0.000\n100,1,up,0.004\n200,1,up,0.009\n",
        encoding="utf-8",
    )
    if "mm" in heading:
        campaign = import_iso230_table(path, "X", AT)
        np.testing.assert_allclose(campaign.value, [0.0, 0.004, 0.009])
        return
    with pytest.raises(InputError, match=r"unit .* not stated.*largest is 0.009.*--unit mm"):
        import_iso230_table(path, "X", AT)
    np.testing.assert_allclose(import_iso230_table(path, "X", AT, unit="mm").value[2], 0.009)


def test_a_table_of_angles_must_say_its_unit(tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text("position,run,direction,deviation\n0,1,up,0\n100,1,up,12\n", encoding="utf-8")
    with pytest.raises(InputError, match="unit .* not stated.*arcsec"):
        import_iso230_table(path, "X", AT, component="B")
    campaign = import_iso230_table(path, "X", AT, component="B", unit="arcsec")
    assert campaign.value[1] == pytest.approx(np.deg2rad(12.0 / 3600.0))


def test_a_unit_that_was_assumed_is_said(tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text("position,run,direction,deviation\n0,1,up,0\n100,1,up,12\n", encoding="utf-8")
    notes = str(import_iso230_table(path, "X", AT).metadata[0]["notes"])
    assert "deviations in um, as no heading and no --unit says otherwise" in notes


@pytest.mark.parametrize(
    ("written", "air"),
    [("70.52 F", 21.4), ("70.52 °F", 21.4), ("21.4 °C", 21.4), ("21.40", 21.4), ("70.52", 70.52)],
)
def test_temperatures_in_the_unit_beside_them(tmp_path, written, air):
    path = tmp_path / "x.rtl"
    path.write_text(SURROUNDED.replace("21.40 C", written), encoding="utf-8")
    campaign = import_rtl(path, AT, normalisation=Normalisation(done=False))
    assert float(campaign.conditions.signals["T_air"][0]) == pytest.approx(air)


@pytest.mark.parametrize(
    ("written", "hpa"),
    [("1009.3 hPa", 1009.3), ("100.93 kPa", 1009.3), ("757.03 mmHg", 1009.29),
     ("29.80 inHg", 1009.14), ("100930 Pa", 1009.3), ("1009.3", 1009.3)],
)  # fmt: skip
def test_pressures_in_the_unit_beside_them(tmp_path, written, hpa):
    path = tmp_path / "x.rtl"
    path.write_text(SURROUNDED.replace("1009.3 mbar", written), encoding="utf-8")
    campaign = import_rtl(path, AT, normalisation=Normalisation(done=False))
    assert float(campaign.conditions.signals["p_air"][0]) == pytest.approx(hpa, abs=0.01)


def test_readings_are_not_turned_back_with_fahrenheit(tmp_path):
    """24 °C in °F and no unit beside it: 55 K more than it was. Asked, unless it is told."""
    path = tmp_path / "x.rtl"
    text = SURROUNDED.replace("23.80 C", "74.84").replace("24.20 C", "75.56")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"may be in °F: found '75.2, no unit") as caught:
        import_rtl(path, AT, normalisation=Normalisation(done=True))
    assert caught.value.field == "T_material"
    told = Normalisation(done=True, temperature=24.0)
    turned = import_rtl(path, AT, normalisation=told).value
    plain = import_rtl(path, AT, normalisation=Normalisation(done=False))
    at = plain.conditions.position("X")
    np.testing.assert_allclose(turned - plain.value, 11.7e-6 * 4.0 * at, atol=1e-12)


def test_what_may_be_fahrenheit_is_said_at_the_import(tmp_path):
    path = tmp_path / "x.rtl"
    path.write_text(SURROUNDED.replace("21.40 C", "70.52"), encoding="utf-8")
    where = ("--at", "Y=0,Z=0", "--not-normalised", "-o")
    done = abbe("import-campaign", path, "--as", "rtl", *where, tmp_path / "a.csv")
    assert done.status == 0, done.err
    assert "SUSPICIOUS: T_air reads 70.52 °C; 70.52 °F would be 21.4 °C" in done.out
    path.write_text(SURROUNDED, encoding="utf-8")
    done = abbe("import-campaign", path, "--as", "rtl", *where, tmp_path / "b.csv")
    assert "SUSPICIOUS" not in done.out


def test_a_unit_that_is_none_of_length_is_told_with_its_file(tmp_path):
    path = tmp_path / "inch.csv"
    path.write_text("position,run,direction,deviation [in]\n0,1,up,0\n100,1,up,2\n", "utf-8")
    with pytest.raises(InputError, match=r"inch\.csv, field 'unit': wrong unit: found 'in'"):
        import_iso230_table(path, "X", AT)
