"""Bad campaign files: each refused with file, line, column, what was found and expected."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign
from tests.support.compcore.campaign_texts import CMM, GOOD, HEADER, MILL, good_lines, read_text

ROW = HEADER + 2  # line 18: the second row
FIELDS = good_lines()[HEADER - 1].split(",")


def with_cell(column: str, text: str, line: int = ROW) -> str:
    """The good file with one cell changed."""
    lines = good_lines()
    cells = lines[line - 1].split(",")
    cells[FIELDS.index(column)] = text
    lines[line - 1] = ",".join(cells)
    return "\n".join(lines) + "\n"


def without_column(column: str) -> str:
    """The good file without one column."""
    at = FIELDS.index(column)
    lines = good_lines()
    for i in range(HEADER - 1, len(lines)):
        cells = lines[i].split(",")
        lines[i] = ",".join(cells[:at] + cells[at + 1 :])
    return "\n".join(lines) + "\n"


def with_line(number: int, text: str) -> str:
    """The good file with one line replaced."""
    lines = good_lines()
    lines[number - 1] = text
    return "\n".join(lines) + "\n"


# id: (text of the file, line, field, words in the message)
BAD: dict[str, tuple[str | bytes, int, str | None, tuple[str, ...]]] = {
    **{
        f"missing column {name}": (without_column(name), HEADER, name, ("missing", "expected"))
        for name in ("setup", "kind", "value", "X", "Y", "Z", "ux", "uz", "base", "base2")
    },
    **{
        f"text in {name}": (with_cell(name, "abc"), ROW, name, ("not a number", "'abc'"))
        for name in ("time", "X", "X_dir", "tool_z", "ux", "value", "sd", "T_x")
    },
    **{
        f"{text!r} in {name}": (with_cell(name, text), ROW, name, (repr(text),))
        for name in ("value", "Z", "T_amb")
        for text in ("nan", "NaN", "-nan", "inf", "-Infinity", "1e999", "1_000", "0x1", "1;5", "٣")
    },
    **{
        f"blank {name}": (with_cell(name, ""), ROW, name, ("blank", "a number"))
        for name in ("time", "Y", "tool_x", "uy", "value", "T_x")
    },
    "blank set-up": (with_cell("setup", " "), ROW, "setup", ("without a set-up",)),
    "axis that the machine lacks": (
        GOOD.replace(",T_amb", ",W"), HEADER, "W", ("no such axis", "one of Y, X, Z")),
    "direction of an axis that the machine lacks": (
        GOOD.replace(",T_amb", ",A_dir"), HEADER, "A_dir", ("no such axis", "'A'")),
    "unit vector too long": (
        with_cell("uz", "1"), ROW, "ux, uy, uz", ("unit vector", "length 1.41421", "length 1")),
    "unit vector nearly of length 1": (
        with_cell("ux", "1.002"), ROW, "ux, uy, uz", ("length 1.002",)),
    "unit vector of zeros": (with_cell("ux", "0"), ROW, "ux, uy, uz", ("length 0",)),
    "duplicate header": (
        GOOD.replace(",T_amb", ",T_x"), HEADER, "T_x", ("twice", "columns 18 and 19")),
    "nameless column": (GOOD.replace(",T_amb", ","), HEADER, None, ("column 19 has no name",)),
    "semicolons": (
        GOOD.replace(",", ";"), 8, None, ("TOML",)),
    "semicolons below the metadata": (
        "\n".join([*good_lines()[:15], *(x.replace(",", ";") for x in good_lines()[15:])]),
        HEADER, None, ("not separated by commas", "';'")),
    "wrong format": (
        GOOD.replace("campaign/1", "campaign/9"), 1, "format", ("campaign/9", "campaign/1")),
    "no format": (
        GOOD.replace("# format", "# form"), 1, "format", ("not a campaign", "abbe-campaign/1")),
    "no metadata": (
        "\n".join(good_lines()[HEADER - 1 :]), 1, "format", ("not a campaign file",)),
    "metadata that is no TOML": (with_line(2, "# machine: CMM"), 2, None, ("not valid TOML",)),
    "a comment among the metadata": (with_line(2, "# Measured by Anna"), 2, None, ("TOML",)),
    "unknown word in free": (
        with_line(8, '# free = ["zero", "tilt"]'), 8, "setups.x_straight_y.free[1]",
        ("'tilt'", "'zero', 'slope' or 'frame'")),
    "word twice in free": (
        with_line(8, '# free = ["zero", "zero"]'), 8, "setups.x_straight_y.free", ("twice",)),
    "free that is no list": (with_line(6, '# free = "zero"'), 6, "setups.x_pos_1.free", ("found",)),
    "misspelt free": (with_line(6, '# fre = ["zero"]'), 5, "setups.x_pos_1.free", ("missing",)),
    "unknown key of a set-up": (
        with_line(6, '# free = ["zero"]\n# hue = 3'), 7, "setups.x_pos_1.hue",
        ("unknown key", "expected one of notes, free, zeros_at")),
    "set-up twice": (with_line(7, "# [setups.x_pos_1]"), 7, None, ("TOML",)),
    "unknown word in a tool's free": (
        with_line(15, '# free = ["x", "w"]'), 15, "tools.T1.free[1]", ("'w'",)),
    "tool without offset": (
        with_line(14, ""), 13, "tools.T1.offset", ("missing",)),
    "base with two coordinates": (
        with_line(10, "# position = [1.0, 2.0]"), 10, "bases.B1.position[2]", ("missing",)),
    "base with a text": (
        with_line(10, '# position = [1.0, 2.0, "3"]'), 10, "bases.B1.position[2]", ("found '3'",)),
    "base with NaN": (
        with_line(10, "# position = [1.0, 2.0, nan]"), 10, "bases.B1.position[2]", ("finite",)),
    "base not declared": (
        with_cell("base", "B7", 20), 20, "base", ("not declared", "'B7'", "B1, B2")),
    "base2 not declared": (with_cell("base2", "B7", 21), 21, "base2", ("not declared",)),
    "distance without base": (with_cell("base", "", 20), 20, "base", ("without a base point",)),
    "distance from a base to itself": (with_cell("base2", "B1", 21), 21, "base2", ("itself",)),
    "negative distance": (with_cell("value", "-3", 21), 21, "value", ("not a distance",)),
    "tool not declared": (with_cell("tool", "T9", 19), 19, "tool", ("not declared", "T1")),
    "named tool and another offset": (
        with_cell("tool_x", "5", 19), 19, "tool_x", ("named tool", "'5'")),
    "unknown kind": (
        with_cell("kind", "length"), ROW, "kind", ("unknown kind", "'length'", "base_distance")),
    "kind in capitals": (with_cell("kind", "Rotation"), ROW, "kind", ("unknown kind",)),
    "too few fields": (
        with_line(ROW, good_lines()[ROW - 1].removesuffix(",,")), ROW, None,
        ("too few fields", "found 20", "22")),
    "too many fields": (
        with_line(ROW, good_lines()[ROW - 1] + ",1"), ROW, None, ("too many fields", "found 23")),
    "one row short, the next long": (
        with_line(ROW, good_lines()[ROW - 1].removesuffix(",")).replace("T1,,\n", "T1,,,\n"),
        ROW, None, ("too few fields",)),
    "decimal comma": (with_line(ROW, good_lines()[ROW - 1].replace("1.25", "1,25")), ROW, None,
        ("too many fields",)),
    "quoted decimal comma": (with_cell("value", '"1,25"').replace('"1,25"', '"1,25"'), ROW, "value",
        ("'1,25'",)),
    "open quote": (with_cell("setup", '"x_pos_1'), ROW, None, ("not a row of CSV",)),
    "metadata below the header": (
        with_line(ROW, '# [setups.late]'), ROW, None, ("metadata below the header",)),
    "direction of 2": (with_cell("X_dir", "2"), ROW, "X_dir", ("not a direction", "'2'")),
    "sd of 0": (with_cell("sd", "0"), ROW, "sd", ("not a standard uncertainty",)),
    "negative sd": (with_cell("sd", "-0.5"), ROW, "sd", ("above 0",)),
    "empty file": ("", 1, None, ("empty",)),
    "blank file": ("\n\n \n", 1, None, ("empty",)),
    "metadata only": ("\n".join(good_lines()[:15]) + "\n", HEADER, None, ("header is missing",)),
    "no rows": ("\n".join(good_lines()[:16]) + "\n", HEADER, None, ("no rows",)),
    "UTF-8 with a damaged letter": (
        GOOD.replace("laser", "Läser").encode().replace(b"ball bar", b"K\xfc\xdfel"), 20, None,
        ("UTF-8", "\\xfc")),
    "a byte that no encoding has": (
        GOOD.encode().replace(b"ball bar", b"ball\x81bar"), 20, None, ("UTF-8",)),
    "UTF-16": (GOOD.encode("utf-16"), 1, None, ("UTF-8",)),
    "NUL bytes": (GOOD.replace("ball bar", "ball\0bar"), 20, None, ("text",)),
    "mixed set-up that is not listed": (
        with_cell("setup", "ball bar"), ROW, "setup", ("mixes distances", "setups.ball bar")),
}  # fmt: skip


@pytest.mark.parametrize("case", list(BAD))
def test_refused_with_its_place(case, tmp_path):
    text, line, field, words = BAD[case]
    with pytest.raises(InputError) as caught:
        read_text(tmp_path, text)
    error = caught.value
    assert error.file == str(tmp_path / "campaign.csv")
    assert (error.line, error.field) == (line, field), str(error)
    for word in words:
        assert word in str(error)
    assert "\n" not in str(error)


def test_an_error_far_down_is_named_by_its_line(tmp_path):
    row = good_lines()[ROW - 1]
    text = GOOD + "\n".join([row] * 60_000) + "\n"
    lines = text.splitlines()
    lines[50_000 - 1] = row.replace("1.25", "1.2.5")
    with pytest.raises(InputError) as caught:
        read_text(tmp_path, "\n".join(lines))
    assert (caught.value.line, caught.value.field) == (50_000, "value")


def test_files_that_cannot_be_opened(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_campaign(tmp_path / "none.csv", CMM)
    with pytest.raises(InputError, match="folder"):
        read_campaign(tmp_path, CMM)


def test_the_spindle_s_angle_in_two_columns(tmp_path):
    text = (
        '# format = "abbe-campaign/1"\ntime,setup,kind,X,Y,Z,B,C,(C),ux,uy,uz,value\n'
        "0,s,displacement,0,0,0,90,-30,-30,1,0,0,1\n"
    )
    with pytest.raises(InputError) as caught:
        read_text(tmp_path, text, MILL)
    assert (caught.value.line, caught.value.field) == (2, "(C)")


DAMAGE = st.one_of(
    st.tuples(st.just("replace"), st.integers(0, len(GOOD)), st.text(max_size=4)),
    st.tuples(st.just("insert"), st.integers(0, len(GOOD)), st.text(max_size=4)),
    st.tuples(st.just("delete"), st.integers(0, len(GOOD)), st.text(max_size=9)),
    st.tuples(st.just("cut"), st.integers(0, len(GOOD)), st.just("")),
    st.tuples(
        st.just("insert"),
        st.integers(0, len(GOOD)),
        st.sampled_from(
            [",", "\n", '"', "#", "nan", "inf", "1", "-", "e", "\r", "\0", ";", "\t", " "]
        ),
    ),
)


def damaged(damage: list[tuple[str, int, str]]) -> str:
    """The good file after some accidents."""
    text = GOOD
    for how, at, what in damage:
        if how == "cut":
            text = text[:at]
        elif how == "insert":
            text = text[:at] + what + text[at:]
        elif how == "delete":
            text = text[:at] + text[at + len(what) :]
        else:
            text = text[:at] + what + text[at + len(what) :]
    return text


@settings(max_examples=400, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(DAMAGE, min_size=1, max_size=4))
def test_a_damaged_file_is_refused_or_whole(tmp_path, damage):
    text = damaged(damage)
    try:
        data = text.encode()
    except UnicodeEncodeError:
        return
    sound_or_refused(tmp_path, data)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, len(GOOD) - 1), st.integers(0, 255)), max_size=5))
def test_damaged_bytes_are_refused_or_whole(tmp_path, damage):
    data = bytearray(GOOD.encode())
    for at, byte in damage:
        data[at] = byte
    sound_or_refused(tmp_path, bytes(data))


def sound_or_refused(tmp_path, data: bytes) -> None:
    """No other error than `InputError`, and what is read is whole and finite."""
    try:
        campaign = read_text(tmp_path, data)
    except InputError as error:
        assert error.file == str(tmp_path / "campaign.csv")  # noqa: PT017
        return
    check_whole(campaign, data)


def check_whole(c: Campaign, data: bytes) -> None:
    """Every row of the file is there, and every number is one."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # or another of one byte a letter: same lines and cells
    lines = text.split("\n")
    below = [line for line in lines[int(c.line[0]) - 1 :] if line.strip()]
    assert len(below) == c.n
    q = c.conditions
    for values in (*q.positions.values(), *q.directions.values(), *q.signals.values()):
        assert values.shape == (c.n,)
        assert np.isfinite(values).all()
    for array in (c.value, q.time, q.tool, q.u):
        assert array is not None
        assert np.isfinite(array).all()
    assert set(np.unique(q.setup)) == set(c.setups)
