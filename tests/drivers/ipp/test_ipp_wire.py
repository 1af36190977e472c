"""I++ DME's lines and grammar: what the standard's test suite holds right and wrong, any split."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.drivers.ipp.errors import Severity, server_error
from abbe.drivers.ipp.grammar import Named, by_name, parse
from abbe.drivers.ipp.question import coordinate_system
from abbe.drivers.ipp.wire import LONGEST, Cutter, ResponseKind, ResponseLine, parsed
from abbe.drivers.link import LinkProtocolError

# from the NIST test suite for I++ DME (numbersResOK.res, numbersErrorRes.res, Get.res, GetProp.res)
GOOD_NUMBERS = {
    "0": 0.0,
    "+90": 90.0,
    "-1.2": -1.2,
    "1234567890123456": 1234567890123456.0,
    "-0000": 0.0,
    "+0000.5E7": 0.5e7,
    "3.9E2": 390.0,
    "+1.234567890123456E003": 1234.567890123456,
    "+1.234567890123456E-123": 1.234567890123456e-123,
    "-6.382e-012": -6.382e-12,
    ".123": 0.123,
    "123.": 123.0,
}
BAD_NUMBERS = ("12345678901234567", "-.", "+", "+1.2 E2", "+1.2E", "+1.2E0010", "0.34.33")


@pytest.mark.parametrize(("text", "value"), GOOD_NUMBERS.items())
def test_numbers_as_the_standard_writes_them(text: str, value: float) -> None:
    assert parse(text) == (value,)
    assert parse(f"X( {text} )") == (Named("X", (value,)),)


@pytest.mark.parametrize("text", [*BAD_NUMBERS, "1e999", "0x10", "1_0", "1,5,"])
def test_what_is_no_number_is_not_read_as_one(text: str) -> None:
    with pytest.raises(LinkProtocolError, match="at character"):
        parse(f"X({text})")


def test_a_name_in_a_number_s_place_is_a_name() -> None:
    assert parse("X(nan), Y(NULL)") == (Named("X", (Named("nan"),)), Named("Y", (Named("NULL"),)))


def test_data_of_the_standard_s_test_suite() -> None:
    assert parse("Y(-.77), X(2.01),  Z(7.)") == (
        Named("Y", (-0.77,)),
        Named("X", (2.01,)),
        Named("Z", (7.0,)),
    )
    assert parse("PtMeas ( X(1.33), IJK(2,2,2))") == (
        Named("PtMeas", (Named("X", (1.33,)), Named("IJK", (2.0, 2.0, 2.0)))),
    )
    assert parse('"GoToPar.Speed", "Number"') == ("GoToPar.Speed", "Number")
    assert parse("ChangeToolAction(Switch, X(0))") == (
        Named("ChangeToolAction", (Named("Switch"), Named("X", (0.0,)))),
    )
    assert parse("(1.00000, 0.00000)") == (Named("", (1.0, 0.0)),)
    assert parse("Tool.CollisionVolume()") == (Named("Tool.CollisionVolume", ()),)
    assert parse("") == ()


@pytest.mark.parametrize(
    "text", ["X(1", "X(1))", "X 1", "X(1) Y(2)", ",", "X(,)", '"half', "(" * 40, "X(1);", "ä(1)"]
)
def test_broken_data_is_an_error_that_says_where(text: str) -> None:
    with pytest.raises(LinkProtocolError, match="at character"):
        parse(text)


def test_answers_by_name() -> None:
    plain = {"X": (1.0,), "Y": (2.0,)}
    assert by_name(parse("X(1), Y(2)"), "Get") == plain
    assert by_name(parse("Get(X(1), Y(2))"), "Get") == plain  # as some servers write it
    with pytest.raises(LinkProtocolError, match="X comes twice"):
        by_name(parse("X(1), X(2)"), "Get")
    with pytest.raises(LinkProtocolError, match="expected a name"):
        by_name(parse("1, 2"), "Get")


@pytest.mark.parametrize("text", ["CoordSystem(PartCsy)", "PartCsy", 'GetCoordSystem("PartCsy")'])
def test_coordinate_systems_in_every_version_s_form(text: str) -> None:
    assert coordinate_system(parse(text)) == "PartCsy"


def test_no_coordinate_system_is_an_error() -> None:
    with pytest.raises(LinkProtocolError, match="expected a coordinate system"):
        coordinate_system(parse("CoordSystem(1)"))


@pytest.mark.parametrize(
    ("text", "severity", "number", "stops", "own"),
    [
        ('Error(0, 0000, "cause", "Buffer full")', 0, 0, False, False),
        ('Error(1, 0504, "cause", "Argument out of range")', 1, 504, False, False),
        ('Error(2, 0513, "00401 StopDaemon(E1234)", "gone")', 2, 513, True, False),
        ('Error(3,0510,"GetProp","Bad property")', 3, 510, True, True),
        ('Error(3, 2500, "GoTo", "Machine limit encountered")', 3, 2500, True, False),
        ('Error(5, 8001, "x", "proprietary")', 3, 8001, True, False),
        ('Error(9, 0503, "cause", "Controller communications failure")', 9, 503, True, False),
        ("Error(9, 0503)", 9, 503, True, False),
        ("what?", 3, 0, True, False),
        ("Error(3", 3, 0, True, False),
    ],
)
def test_errors(text: str, severity: int, number: int, stops: bool, own: bool) -> None:
    error = server_error(text)
    assert error.severity is Severity(severity)
    assert (error.number, error.stops, error.own_fault) == (number, stops, own)
    assert f"{number:04d}" in str(error)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b"00001 &", ResponseLine("00001", ResponseKind.TAKEN, "")),
        (b"00019 # X(99.93)", ResponseLine("00019", ResponseKind.DATA, "X(99.93)")),
        (b"00019 #X(99.93)", ResponseLine("00019", ResponseKind.DATA, "X(99.93)")),
        (b'E0000 # KeyPress("F1")', ResponseLine("E0000", ResponseKind.DATA, 'KeyPress("F1")')),
        (b"99999 %", ResponseLine("99999", ResponseKind.DONE, "")),
        (b"00003 ! Error(3, 2500)", ResponseLine("00003", ResponseKind.ERROR, "Error(3, 2500)")),
    ],
)
def test_responses(line: bytes, message: ResponseLine) -> None:
    assert parsed(line) == message


@pytest.mark.parametrize(
    "line",
    [b"1 &", b"00001&", b"00001 ?", b"00001 & X(1)", b"E001 %", b"e0001 %", b"00001 # \xff", b"&"],
)
def test_what_is_no_response(line: bytes) -> None:
    assert parsed(line) is None


_TAGS = st.integers(1, 99999).map("{:05d}".format) | st.integers(0, 9999).map("E{:04d}".format)
_NUMBERS = st.floats(-1e4, 1e4).map("{:.5f}".format)
_MESSAGES = st.one_of(
    st.tuples(_TAGS, st.sampled_from([ResponseKind.TAKEN, ResponseKind.DONE]), st.just("")),
    st.tuples(_TAGS, st.just(ResponseKind.DATA), _NUMBERS.map("X({})".format)),
    st.tuples(_TAGS, st.just(ResponseKind.ERROR), st.just('Error(2, 0514, "a", "b")')),
).map(lambda parts: ResponseLine(*parts))


def written(message: ResponseLine, end: bytes) -> bytes:
    text = f" {message.text}" if message.text else ""
    return f"{message.tag} {message.kind.value}{text}".encode() + end


@given(
    st.lists(st.tuples(_MESSAGES, st.sampled_from([b"\r\n", b"\n", b"\r\n\r\n"])), max_size=8),
    st.data(),
)
def test_any_split_of_the_stream_gives_the_same_messages(
    lines: list[tuple[ResponseLine, bytes]], data: st.DataObject
) -> None:
    stream = b"".join(written(message, end) for message, end in lines)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    cutter, found = Cutter(), []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += cutter.feed(stream[start:end])
    assert found == [message for message, _ in lines]
    assert cutter.strays == 0


@given(st.binary(max_size=200), st.lists(_MESSAGES, max_size=3))
def test_garbage_hides_nothing_that_follows_on_a_line_of_its_own(
    garbage: bytes, messages: list[ResponseLine]
) -> None:
    cutter = Cutter()
    before = list(cutter.feed(garbage + b"\r\n"))
    assert list(cutter.feed(b"".join(written(m, b"\r\n") for m in messages))) == messages
    assert all(isinstance(message.kind, ResponseKind) for message in before)


@given(st.text(st.sampled_from('XYZ.a_(),"-+19eE \tä'), max_size=40))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        values: Any = parse(text)
    except LinkProtocolError:
        return
    assert isinstance(values, tuple)


def test_a_line_without_end_is_thrown_away() -> None:
    cutter = Cutter()
    for _ in range(LONGEST // 1000 + 2):
        assert list(cutter.feed(b"x" * 1000)) == []
    assert list(cutter.feed(b"\r\n00001 %\r\n")) == [ResponseLine("00001", ResponseKind.DONE, "")]
    assert cutter.strays == 1
