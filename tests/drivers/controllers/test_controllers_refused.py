"""Files that a controller would misread, or that are another's, are refused with their place."""

from __future__ import annotations

from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.drivers.controllers import make_controller
from tests.support.drivers.controllers.cases import CASES, PRODUCT, SIEMENS, machine, one

FOLDER = Path(__file__).parents[2] / "data" / "controllers"
GOLDEN = {case.folder: case for case in CASES}


def reader(folder: str):
    case = GOLDEN[folder]
    return make_controller(case.controller, machine(case.code), case.options)


def text(folder: str, name: str) -> str:
    return (FOLDER / folder / name).read_bytes().decode("utf-8")


LINUXCNC = "-100 -100.01 -100.02\n0 0 -0.01\n100 100.03 100.015\n"


@pytest.mark.parametrize(
    ("content", "line", "words"),
    [
        ("# a comment\n" + LINUXCNC, 1, "reads no further than this line"),
        (LINUXCNC.replace("0 0 -0.01\n", "\n0 0 -0.01\n"), 2, "reads no further"),
        (LINUXCNC.replace("0 0 -0.01", "0, 0, -0.01, 1"), 2, "reads no further"),
        (LINUXCNC.replace("0 0 -0.01", "0 0"), 2, "reads no further"),
        (LINUXCNC.replace("0 0 -0.01", "-200 0 -0.01"), 2, "does not increase"),
        (LINUXCNC.replace("0 0 -0.01", "-100 0 -0.01"), 2, "does not increase"),
        ("".join(f"{i} {i} {i}\n" for i in range(257)), 257, "ignores the lines from here on"),
        (LINUXCNC.replace("100.03", "nan"), 3, "not a number"),
    ],
)
def test_linuxcncs_silent_traps_are_loud(content, line, words):
    with pytest.raises(InputError, match=words) as raised:
        reader("linuxcnc").read({"x.comp": content})
    assert raised.value.line == line
    assert raised.value.file == "x.comp"


def test_linuxcnc_reads_carriage_returns_as_it_does():
    found = reader("linuxcnc").read({"x.comp": LINUXCNC.replace("\n", "\r\n")})
    assert found[0].forward.tolist() == pytest.approx([-0.01, 0.0, 0.03])
    with pytest.raises(InputError, match="not that of an axis"):
        reader("linuxcnc").read({"joint_0.comp": LINUXCNC})


CHANGES = [
    ("fanuc", "pitch.txt", "%\nN03620", "N03620", "does not begin and end with %"),
    ("fanuc", "pitch.txt", "N10003Q0P1", "G10 L50", "not a parameter or pitch block"),
    ("fanuc", "pitch.txt", "N10003Q0P1", "N10003Q0P1.5", "a whole number"),
    ("fanuc", "pitch.txt", "N03621Q1A1P1\n", "", "a parameter is missing"),
    ("fanuc", "pitch.txt", "A1P", "A7P", "axis number that the machine has no axis for"),
    ("weihong", "axeserr.dat", ";unit=mm\n", "", "no unit line"),
    ("weihong", "axeserr.dat", ";unit=mm", ";unit=inch", "only mm"),
    ("weihong", "axeserr.dat", "-450.020", "-650.020", "do not increase"),
    ("weihong", "axeserr.dat", "[X]\n", "", "not a row of an axis"),
    ("fanuc", "pitch.txt", "N10003Q0P1", "N10003Q0A1P1", "a pitch block is of no axis"),
    ("fanuc", "pitch.txt", "N10003Q0P1", "N10003Q0P1-", "not a number"),
    ("pmac", "comp.pmc", " -16 -24", " -16 x", "not an entry or a command"),
    ("pmac", "comp.pmc", "#2,110000\n -16 ", "#2,110000\n ", "not complete"),
    ("pmac", "comp.pmc", "#1D,#3", "#1D,#9", "a motor that no axis belongs to"),
    ("heidenhain-nd", "nd-x.txt", "MM", "IN", "not in mm"),
    ("heidenhain-nd", "nd-x.txt", "X NR. 00      = +       0.000", "X NR. 00      = +       0.001",
     "the first value is always 0"),
    ("heidenhain-nd", "nd-x.txt", "SPACING X     =     14", "SPACING X     =     99",
     "a spacing that no unit has"),
    ("heidenhain-nd", "nd-x.txt", "X NR. 02", "X NR. 05", "a point is missing"),
    ("heidenhain-nd", "nd-x.txt", "*\r\nND", "ND", r"does not begin and end with \*"),
    ("heidenhain-nd", "nd-x.txt", "AXIS X        =      0", "AXIS X        =      4",
     "axis number"),
    ("heidenhain-tnc", "config.cma", "*", " ", "not one line is active"),
    ("heidenhain-tnc", "config.cma", "y.com", "q.com", "a table that is named is missing"),
    ("heidenhain-tnc", "y.com", "BEGIN", "BEGUN", "not a whole table of a TNC"),
    ("heidenhain-tnc", "y.com", " MM", " INCH", "not in mm"),
    ("heidenhain-tnc", "y.com", "[END]", "", "not a whole table of a TNC"),
    ("heidenhain-tnc", "y.com", "-85.0000", "-84.0000", "at different distances"),
    ("heidenhain-tnc", "y.com", "-85.0000", "-95.0000", "do not increase"),
    ("heidenhain-tnc", "y.com", "  Z", "  Q", "an axis that this table cannot have"),
    ("heidenhain-tnc", "y.com", "AXISPOS", "AXISSOP", "a column is missing"),
    ("heidenhain-tnc", "z.com", "0.0123", "0.o123", "not a number"),
    ("heidenhain-tnc", "y.com", "0.0170      ", "0.0170000000", "reaches into the next column"),
    ("aerotech-2d", "calibration.cal", "POSUNIT=PRIMARY", "POSUNIT=COUNTS", "units"),
    ("aerotech-2d", "calibration.cal", "0.100\t-0.200\t", "0.100\t", "a row of the wrong length"),
    ("aerotech-2d", "calibration.cal", " 10.000 20.000 3", " 10.000 20.000", "not the head"),
    ("aerotech-2d", "calibration.cal", " 10.000 20.000 3", " 0.000 20.000 3", "not above 0"),
    ("aerotech-2d", "calibration.cal", ":END", "", "not a complete table"),
    ("siemens-840d", "ax_eec.ini", "[0,1,X1]=0.010000", "[0,5,X1]=0.010000", "not complete"),
    ("siemens-840d", "ax_eec.ini", "X1", "Q1", "does not have"),
    ("siemens-840d", "ax_eec.ini", "M17", "M30", "not an assignment"),
    ("siemens-840d", "ax_eec.ini", "IS_MODULO[0,X1]=0", "IS_MODULO[0,X1]=1", "modulo"),
    ("siemens-840d", "nc_cec.ini", "MULT_BY_TABLE[0]=0", "MULT_BY_TABLE[0]=2", "multiplied"),
    ("siemens-840d", "nc_cec.ini", "DIRECTION[2]=-1", "DIRECTION[2]=1", "no partner"),
    ("siemens-840d", "nc_cec.ini", "$AN_CEC_STEP[0]=50.000\n", "", "variable is missing"),
    ("siemens-840d-products", "nc_cec.ini", "$AN_CEC[3,1]=0.002000", "$AN_CEC[3,1]=0.003000",
     "without its counterpart"),
    ("siemens-840d-products", "nc_cec.ini", "MULT_BY_TABLE[3]=5", "MULT_BY_TABLE[3]=0",
     "without its counterpart"),
    ("siemens-840d-products", "nc_cec.ini", "MULT_BY_TABLE[3]=5", "MULT_BY_TABLE[3]=3",
     "without its counterpart"),
    ("siemens-840d-products", "nc_cec.ini", "MULT_BY_TABLE[3]=5", "MULT_BY_TABLE[3]=4",
     "no lever"),
    ("siemens-840d-products", "nc_cec.ini", "MULT_BY_TABLE[2]=0", "MULT_BY_TABLE[2]=5",
     "no lever"),
    ("siemens-840d-products", "nc_cec.ini", "$AN_CEC[2,1]=0.000000", "$AN_CEC[2,1]=0.010000",
     "no lever"),
    ("siemens-840d-products", "nc_cec.ini", "OUTPUT_AXIS[4]=(X1)", "OUTPUT_AXIS[4]=(Y1)",
     "no lever"),
    ("siemens-840d-products", "nc_cec.ini", "DIRECTION[1]=0", "DIRECTION[1]=1", "no lever"),
    ("siemens-840d-products", "nc_cec.ini", "INPUT_AXIS[1]=(Y1)", "INPUT_AXIS[1]=(W1)",
     "without its counterpart"),
    ("siemens-840d-products", "nc_cec.ini", "CEC_STEP[0]=25.000", "CEC_STEP[0]=0.000",
     "not a range"),
    ("siemens-840d-products", "nc_cec.ini", "CEC_STEP[0]=25.000", "CEC_STEP[0]=abc",
     "not a number"),
    ("siemens-840d-products", "nc_cec.ini", "DIRECTION[0]=0", "DIRECTION[0]=up",
     "not a whole number"),
    ("siemens-840d-products", "nc_cec.ini", "$AN_CEC[0,1]", "$AN_CEC[0.1]", "number of a table"),
    ("twincat-isg", "volcomp1.csv", "EXX", "EXY", "not a component error of the block's axis"),
    ("twincat-isg", "volcomp1.csv", "X\tEXX", "A\tEXA", "not over one axis"),
    ("twincat-isg", "volcomp1.csv", "10.000\t0.0000000\t", "10.000\t", "wrong number of columns"),
    ("twincat-isg", "volcomp1.csv", "10.000\t0.0000000", "-1.000\t0.0000000", "do not increase"),
    ("twincat-isg-axes", "achskw1.lis", "ssfk.unit 1", "ssfk.unit 0", "only metric"),
    ("twincat-isg-axes", "achskw1.lis", "kw.ssfk.table[1].neg 67\n", "", "not complete"),
    ("twincat-isg-axes", "achskw1.lis", "].setpoint", "].set", "no points"),
    ("siemens-840d-products", "nc_cec.ini", "CEC_STEP[0]=25.000", "CEC_STEP[0]=1e-12",
     "not complete"),
    ("twincat-isg-axes", "achskw2.lis", "master_ax_nr 1", "master_ax_nr 8", "not the number"),
    ("etalon-exchange", "volcomp.txt", "}  // end of EXY\n", "", "not a line|does not end"),
    ("etalon-exchange", "volcomp.txt", "[EXY]", "[EXQ]", "not a component error"),
    ("etalon-exchange", "volcomp.txt", "[EXY]", "[C0Y]\nVALUE = 1e-5\n[EXY]", "choice of axes"),
    ("cmm-map", "map.txt", "X Axis", "U Axis", "no such axis"),
    ("csv", "x.csv", '# sign = "error"', "# sign = ", "does not say what the numbers are"),
    ("csv", "x.csv", "E_XX (+) [mm]", "E_XX (+) [µm]", "not a column of this axis"),
    ("csv", "x.csv", "X [mm],", "Q [mm],", "not an axis's position"),
    ("csv", "x.csv", "50.000,0.001500", "50.000", "wrong number of columns"),
    ("grid-csv", "grid-xyz.csv", '"compensation"', '"correction"', "does not say what"),
    ("grid-csv", "grid-xyz.csv", "dC [deg]", "dC [rad]", "not the columns of a grid"),
    ("grid-csv", "grid-xyz.csv", "50.000,0.000,0.000,", "50.000,1.000,0.000,", "full grid"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("folder", "name", "old", "new", "words"), CHANGES,
    ids=[f"{c[0]}-{i}" for i, c in enumerate(CHANGES)],
)  # fmt: skip
def test_a_damaged_file_is_refused(folder, name, old, new, words):
    content = text(folder, name)
    assert old in content, "the change changes nothing"
    with pytest.raises(InputError, match=words) as raised:
        reader(folder).read({name: content.replace(old, new)})
    assert folder.startswith("cmm") or raised.value.file == name


def test_etalons_constants_of_rotary_axes_are_added_to_their_tables():
    owner = machine("w C' b X Y Z t")
    found = make_controller("etalon-exchange", owner).read(
        {"v.txt": "[X0C]\nVALUE = 0.012\n[EXC]\nGridpoints = {\n 0 0.001\n 90 0.003\n}\n"}
    )
    (table,) = found
    assert table.name == "E_XC"
    assert table.forward.tolist() == pytest.approx([0.013, 0.015])


def test_negcor_of_an_aerotech_file_turns_its_sign():
    content = text("aerotech-2d", "calibration.cal")
    plain = reader("aerotech-2d").read({"a.cal": content})
    with_negcor = content.replace(":START2D PO", ":START2D NEGCOR PO")
    turned = reader("aerotech-2d").read({"a.cal": with_negcor})
    assert turned[0].forward == pytest.approx(-plain[0].forward)


@pytest.mark.parametrize("name", ["siemens-840d", "weihong", "csv"])
def test_a_controller_that_holds_no_products_is_given_none(name):
    with pytest.raises(InputError, match="holds no products") as raised:
        make_controller(name, machine()).write(PRODUCT)
    assert raised.value.found == "E_XY·Z"


def test_more_tables_or_points_than_the_control_has():
    with pytest.raises(InputError, match="no more CEC tables"):
        make_controller("siemens-840d", machine(), {"cec_tables": "2"}).write(SIEMENS)
    few = {"products": "mirrored", "cec_tables": "4"}
    with pytest.raises(InputError, match="no more CEC tables"):
        make_controller("siemens-840d", machine(), few).write(PRODUCT)
    long = [one(a, a, [0.0, 50.0, 100.0], [0.0, 1e-3, 2e-3]) for a in "XYZ"]
    table = one("Y", "Y", [0.0, 100.0], [0.0, 1e-3])
    with pytest.raises(InputError, match="more tables than motors"):
        make_controller("pmac", machine(), {"owners": "1"}).write([table] * 3)
    with pytest.raises(InputError, match="no more points"):
        make_controller("fanuc", machine(), {"first_point": "1020"}).write(long)
