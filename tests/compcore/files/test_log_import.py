"""Loggers' tables: moments, thermometers and readings, and every flaw in them named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, write_campaign
from abbe.compcore.files.importers.log import LoggedReading, import_log
from abbe.compcore.files.importers.placing import ForeignPlacing
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure

AT = ForeignPlacing(at={"X": 100.0, "Y": 50.0, "Z": -20.0})
MACHINE = Machine(
    "mill",
    Structure.parse("w b Y X Z t"),
    {a: Axis(a, (-500.0, 500.0)) for a in "XYZ"},
    {"T_air": Signal("T_air", "degC", "ambient"), "T_2": Signal("T_2", "degC", "structure")},
)
ETVE = """\
# a test of 25 minutes
Time [min],T_air [°C],T_2 (°F),dX [mm],dZ_um,remark
0,20.0,68.0,0.0010,1.0,begun
10,20.5,71.6,0.0015,,
25,21.0,77.0,0.0005,4.5,door open
"""


def imported(tmp_path: Path, text: str, **options: object) -> Campaign:
    file = tmp_path / "etve.csv"
    file.write_text(text, "utf-8")
    return import_log(file, options.pop("placing", AT), **options)  # type: ignore[arg-type]


def test_a_thermal_test_of_two_indicators(tmp_path: Path) -> None:
    campaign = imported(tmp_path, ETVE, machine=MACHINE)
    assert set(campaign.setups) == {"etve_dX", "etve_dZ_um"}
    assert {s.free for s in campaign.setups.values()} == {("zero",)}
    x = campaign.conditions.setup == "etve_dX"
    assert campaign.value[x] == pytest.approx([1e-3, 1.5e-3, 0.5e-3])
    assert campaign.value[~x] == pytest.approx([1e-3, 4.5e-3])
    assert campaign.conditions.time is not None
    assert campaign.conditions.time[x].tolist() == [0.0, 600.0, 1500.0]
    assert campaign.conditions.time[~x].tolist() == [0.0, 1500.0]
    assert campaign.conditions.signals["T_2"][x] == pytest.approx([20.0, 22.0, 25.0])
    assert "remark" not in campaign.conditions.signals
    assert campaign.conditions.u is not None
    assert campaign.conditions.u[~x].tolist() == [[0.0, 0.0, 1.0]] * 2
    notes = str(campaign.metadata[0]["notes"])
    assert "left out, since no numbers: remark" in notes
    assert "1 blank readings left out" in notes


def test_what_was_imported_is_read_as_a_campaign(tmp_path: Path) -> None:
    campaign = imported(tmp_path, ETVE, machine=MACHINE)
    write_campaign(campaign, tmp_path / "out.csv")
    again = read_campaign(tmp_path / "out.csv", MACHINE)
    assert np.array_equal(again.value, campaign.value)
    assert np.array_equal(again.conditions.time, campaign.conditions.time)
    assert again.conditions.positions["X"].tolist() == [100.0] * 5


def test_five_sensors_on_a_test_bar(tmp_path: Path) -> None:
    """ISO 230-3: two indicators 150 mm apart show how the spindle tilts."""
    measured = {
        "x_near": LoggedReading("X", (0.0, 0.0, -50.0)),
        "x_far": LoggedReading("X", (0.0, 0.0, -200.0)),
        "tilt": LoggedReading("B"),
    }
    text = "time,x_near,x_far,tilt [urad]\n0,1.5,2.0,-3\n60,2.5,4.0,7\n"
    campaign = imported(tmp_path, text, measured=measured)
    assert sorted(set(campaign.conditions.tool[:, 2])) == [-200.0, -50.0, 0.0]
    turned = campaign.kind == Kind.ROTATION
    assert campaign.value[turned] == pytest.approx([-3e-6, 7e-6])


@pytest.mark.parametrize(
    ("first", "second", "apart"),
    [
        ("2026-03-02 23:59:30", "2026-03-03 00:00:10", 40.0),
        ("2026-03-02T12:00:00Z", "2026-03-02T12:00:01.5Z", 1.5),
        ("2021/07/05-17:46:24", "2021/07/05-17:46:37", 13.0),
        ("28.02.2024 14:00", "01.03.2024 14:00", 2 * 86400.0),
        ("23:59:50", "00:00:05", 15.0),
        ("3.5", "5", 1.5),
    ],
)
def test_moments_as_loggers_write_them(
    tmp_path: Path, first: str, second: str, apart: float
) -> None:
    campaign = imported(tmp_path, f"timestamp,dZ\n{first},1\n{second},2\n")
    assert campaign.conditions.time is not None
    assert campaign.conditions.time.tolist() == pytest.approx([0.0, apart])


def test_a_date_and_an_hour_in_two_columns(tmp_path: Path) -> None:
    text = "Date;Time;T;dZ\n02.03.2026;23:00:00;20,5;1,5\n03.03.2026;01:00:00;20,7;2,5\n"
    campaign = imported(tmp_path, text)
    assert campaign.conditions.time is not None
    assert campaign.conditions.time.tolist() == [0.0, 7200.0]
    assert campaign.metadata[0]["date"] == "2026-03-02"
    assert campaign.conditions.signals["T"].tolist() == [20.5, 20.7]


def test_positions_that_are_logged(tmp_path: Path) -> None:
    text = "time,X,T_air,dX\n0,0,20,1.5\n1,300,20,2\n"
    campaign = imported(tmp_path, text, machine=MACHINE)
    assert campaign.conditions.positions["X"].tolist() == [0.0, 300.0]
    assert campaign.conditions.positions["Y"].tolist() == [50.0, 50.0]


def test_without_a_clock_nothing_is_made_of_the_order(tmp_path: Path) -> None:
    campaign = imported(tmp_path, "load,dZ\n0,1.5\n10,2\n")
    assert "no clock" in str(campaign.metadata[0]["notes"])


@pytest.mark.parametrize(
    ("text", "why", "line"),
    [
        ("time,T\n0,20\n", "readings are known", 1),
        ("time,dZ\n0,1.5\nsoon,2\n", "not a moment of time", 3),
        ("time,dZ\n5,1.5\n4,2\n", "the clock goes back", 3),
        ("time,dZ\n03/04/2026 10:00,1.5\n03/04/2026 10:01,2\n", "not a moment of time", 2),
        ("time [weeks],dZ\n0,1.5\n", "not a unit of time", None),
        ("time,T,dZ\n0,20,1.5\n1,warm,2\n", "not a number", 3),
        ("time,T,dZ\n0,20,1.5\n1,,2\n", "not a number", 3),
        ("time,kind,dZ\n0,1,1.5\n", "meaning of its own", 1),
        ("time,dZ,dZ\n0,1.5,2\n", "same column twice", 1),
        ("time,dB\n0,1.5\n", "unit of the deviations", None),
        ("time,dZ\n0,0.5\n", "unit of the deviations", None),
        ("time,dZ\n0,1.5\n1,1e9\n", "not believable", 3),
    ],
)
def test_every_flaw_is_one_error(tmp_path: Path, text: str, why: str, line: int | None) -> None:
    with pytest.raises(InputError, match=why) as caught:
        imported(tmp_path, text)
    assert caught.value.line == line
    assert "etve.csv" in str(caught.value)


def test_a_column_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such column"):
        imported(tmp_path, "time,dZ\n0,1.5\n", measured={"dY": LoggedReading("Y")})
