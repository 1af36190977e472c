"""Signs, one by one: a wrong sign scraps a part.

The error is known: at X = 100 mm the machine stands 10 µm too far (actual − indicated = +0.010).
What each file must then hold is worked out here by hand, from what the controller does with its
numbers.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from abbe.compcore.tables.table import Sign, Table, move
from abbe.drivers.controllers import controller_kinds, make_controller
from tests.support.drivers.controllers.cases import PRODUCT, machine, motions, one, plane

TOO_FAR = 0.010
"""mm at X = 100, growing from 0 at X = 0."""


def error(down: float | None = None):
    back = None if down is None else [0.0, down]
    return [one("X", "X", [0.0, 100.0], [0.0, TOO_FAR], back)]


def written(name: str, tables, **options: str) -> dict[str, str]:
    return make_controller(name, machine(), options).write(tables)


def test_linuxcnc_type_0_holds_the_actual_position():
    """At nominal 100 the carriage was measured at 100.010."""
    last = written("linuxcnc", error(0.012))["x.comp"].splitlines()[-1]
    assert [float(n) for n in last.split()] == [100.0, 100.010, 100.012]


def test_linuxcnc_type_1_holds_what_is_added_to_the_command():
    """To stand at 100 it must be sent 10 µm less far."""
    last = written("linuxcnc", error(0.012), type="1")["x.comp"].splitlines()[-1]
    assert [float(n) for n in last.split()] == [100.0, -0.010, -0.012]


def test_siemens_enc_comp_is_added_to_the_actual_value():
    """Actual value 100 becomes 100.010, and the axis moves back: positive is the error."""
    text = written("siemens-840d", error())["ax_eec.ini"]
    assert "$AA_ENC_COMP[0,1,X1]=0.010000" in text


def test_siemens_cec_is_an_additional_setpoint():
    """The axis must be sent 10 µm less far: negative."""
    text = written("siemens-840d", error(0.012), pitch="cec")["nc_cec.ini"]
    assert "$AN_CEC[0,1]=-0.010000" in text
    assert "$AN_CEC_DIRECTION[0]=1" in text
    assert "$AN_CEC[1,1]=-0.012000" in text
    assert "$AN_CEC_DIRECTION[1]=-1" in text


def test_siemens_product_is_against_the_error():
    """Angle 16 µrad at Y = 50, lever 25 mm up to Z = 0: X stands 0.4 µm too far, −0.4 µm it is.

    Each of the two products gives half: −0.002 mm times 0.1 mm, taken in mm.
    """
    text = written("siemens-840d", PRODUCT, products="mirrored")["nc_cec.ini"]
    for line in (
        "$AN_CEC[1,1]=-0.002000", "$AN_CEC[2,2]=0.100000", "$AN_CEC_MULT_BY_TABLE[1]=3",
        "$AN_CEC[3,1]=0.002000", "$AN_CEC[4,2]=-0.100000", "$AN_CEC_MULT_BY_TABLE[3]=5",
    ):  # fmt: skip
        assert line in text.splitlines()
    correction = 2 * -0.002 * 0.100
    assert correction == pytest.approx(-16e-6 * 25.0)


def test_isg_leadscrew_list_is_actual_minus_setpoint():
    """The kernel's worked example: setpoint 19866.7 µm, actual 19856.5 µm, entry −102."""
    short = [one("X", "X", [0.0, 19.8667], [0.0, 19.8565 - 19.8667])]
    text = written("twincat-isg", short, form="axes")["achskw1.lis"]
    assert "kw.ssfk.table[1].setpoint 198667" in text
    assert "kw.ssfk.table[1].pos -102" in text


def test_isg_cross_list_has_the_leadscrew_lists_sign():
    cross = [one("Y", "X", [0.0, 100.0], [0.0, TOO_FAR])]
    text = written("twincat-isg", cross, form="axes")["achskw2.lis"]
    assert "kw.crosscomp.table[1].correction 100" in text


@pytest.mark.parametrize(
    ("name", "file", "found"),
    [
        ("twincat-isg", "volcomp1.csv", r"100\.000\t0\.0100000"),
        ("etalon-exchange", "volcomp.txt", r"\[EXX\](?s:.*?)100\.000 0\.010000000000"),
        ("cmm-map", "map.txt", r"100\.0000\t0\.0100"),
    ],
)
def test_volumetric_files_hold_the_errors_of_iso_230(name, file, found):
    tables = [
        t for a in "XYZ" for t in motions(a, [0, 100], [[0] * 6, [TOO_FAR, 0, 0, 0, 0, 2e-5]])
    ]
    text = written(name, tables)[file]
    assert re.search(found, text), text
    # right-handed, counter-clockwise positive: +20 µrad about Z is +0.02 mm/m, +2e-5 rad
    assert re.search(r"0\.0200$|0\.0000200000$|0\.000020000000$", text, re.MULTILINE)


def test_aerotech_corrects_by_minus_the_error():
    tables = plane("XY", [0, 100], [0, 100], [[[0, TOO_FAR], [0, TOO_FAR]], [[0, 0], [0, 0]]])
    row = written("aerotech-2d", tables)["calibration.cal"].splitlines()[4].split()
    assert [float(v) for v in row] == [0.0, 0.0, -10.0, 0.0]


def test_pmac_adds_the_error_to_the_sensors_position():
    """10 µm at 1000 counts a millimetre are 10 counts, 160 sixteenths."""
    text = written("pmac", EXAMPLES["pmac"])["comp.pmc"]
    assert text.splitlines()[3].split() == ["160", "0"]


def test_fanuc_outputs_pulses_against_the_error():
    """Between the reference point and 100 mm ten pulses less: two steps of −5 with a limit of 7."""
    tables = [one("X", "X", [0.0, 50.0, 100.0], [0.0, 0.005, TOO_FAR])]
    text = written("fanuc", tables)["pitch.txt"]
    assert "N10001Q0P-5\nN10002Q0P-5\n" in text


def test_heidenhain_adds_the_error_to_the_display():
    """A scale that shows 100 where the slide is at 100.010 must show 100.010."""
    tables = [one("X", "X", [0.0, 65.536, 131.072], [0.0, 0.006, TOO_FAR])]
    text = written("heidenhain-nd", tables)["nd-x.txt"]
    assert re.search(r"X NR. 02 +=\s+\+\s+0\.010", text)


def test_heidenhain_tnc_holds_the_error():
    """MP720, the linear compensation: "positive if the table travel is too long"."""
    text = written("heidenhain-tnc", error(0.012))["x.com"]
    head, last = text.splitlines()[1].split(), text.splitlines()[3].split()
    row = dict(zip(head, last, strict=True))
    assert row == {"NR": "1", "AXISPOS": "100.0000", "X": "0.0100", "BACKLASH": "0.0120"}


@pytest.mark.parametrize(("sign", "value"), [("error", "0.00573"), ("compensation", "-0.00573")])
def test_heidenhain_tnc_error_motions_are_degrees_by_their_names(sign, value):
    """An angle E_CX of 100 µrad is 0.00573 degrees, in column C6."""
    tables = motions("X", [0, 100], [[0] * 6, [0, 0, 0, 0, 0, 1e-4]])
    tables = [t.scaled(0.00573 * np.pi / 180.0 / 1e-4) for t in tables]
    text = written("heidenhain-tnc", tables, form="kinematics", kinematics_sign=sign)["x.com"]
    head, last = text.splitlines()[1].split(), text.splitlines()[3].split()
    assert dict(zip(head, last, strict=True))["C6"] == value


def test_weihong_holds_the_error_of_each_direction():
    """Their own example: a backlash of 0.03 mm is a backward error of +0.030."""
    text = written("weihong", error(TOO_FAR + 0.030))["axeserr.dat"]
    assert "100.000, 0.0100, 0.0400" in text


@pytest.mark.parametrize(("sign", "value"), [("error", "0.010000"), ("compensation", "-0.010000")])
def test_csv_holds_what_its_head_says(sign, value):
    text = written("csv", error(), holds="moves", sign=sign)["x.csv"]
    assert f'# sign = "{sign}"' in text
    assert text.splitlines()[-1] == f"100.000,{value}"


@pytest.mark.parametrize(("sign", "value"), [("error", "0.010000"), ("compensation", "-0.010000")])
def test_grids_hold_what_their_head_says(sign, value):
    nodes = (np.array([0.0, 100.0]), np.zeros(1), np.zeros(1))
    tables = [
        Table(move(c), tuple("XYZ"), nodes, np.array([0, TOO_FAR * (c == "X")]).reshape(2, 1, 1))
        for c in "XYZABC"
    ]
    text = written("grid-csv", tables, sign=sign)["grid-xyz.csv"]
    assert f'# sign = "{sign}"' in text
    assert text.splitlines()[-1].startswith(f"100.000,0.000,0.000,{value},")


EXAMPLES = {
    "aerotech-2d": plane("XY", [0, 100], [0, 100], [[[0, 1e-2], [0, 1e-2]], [[0, 0], [0, 0]]]),
    "cmm-map": motions("X", [0, 100], [[0] * 6, [1e-2, 0, 0, 0, 0, 0]]),
    "csv": motions("X", [0, 100], [[0] * 6, [1e-2, 0, 0, 0, 0, 0]]),
    "etalon-exchange": motions("X", [0, 100], [[0] * 6, [1e-2, 0, 0, 0, 0, 0]]),
    "twincat-isg": motions("X", [0, 100], [[0] * 6, [1e-2, 0, 0, 0, 0, 0]]),
    "pmac": [one("Y", "Y", [0.0, 100.0], [0.0, TOO_FAR])],
    "heidenhain-nd": [one("X", "X", [0.0, 65.536, 131.072], [0.0, 0.006, TOO_FAR])],
    "fanuc": [one("X", "X", [0.0, 50.0, 100.0], [0.0, 0.005, TOO_FAR])],
}


@pytest.mark.parametrize("name", [n for n in controller_kinds() if n != "grid-csv"])
def test_invert_turns_every_number_round_and_reads_it_back(name):
    tables = EXAMPLES.get(name, error())
    plain = make_controller(name, machine())
    turned = make_controller(name, machine(), {"invert": "true"})
    files = turned.write(tables)
    assert files != plain.write(tables)
    as_negative = plain.write([t.scaled(-1.0) for t in tables])
    assert files == as_negative
    for table, found in zip(tables, turned.read(files), strict=False):
        assert found.difference(table) < 1e-11


@pytest.mark.parametrize("name", list(controller_kinds()))
def test_compensations_and_errors_of_the_same_tables_give_the_same_files(name):
    tables = EXAMPLES.get(name, error()) if name != "grid-csv" else None
    if tables is None:
        return
    controller = make_controller(name, machine())
    assert controller.write(tables) == controller.write(
        [t.as_sign(Sign.COMPENSATION) for t in tables]
    )


@pytest.mark.parametrize("name", list(controller_kinds()))
def test_every_dialect_says_which_of_the_two_it_holds(name):
    cls = controller_kinds()[name]
    assert re.search(r"error|compensation", cls.sign)
