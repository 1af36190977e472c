"""The parts of a serial link alone: checksums, cutting lines, fields, configurations refused."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from abbe.drivers.serial.checksum import ALGORITHMS, ChecksumConfig, ChecksumError, Kind
from abbe.drivers.serial.config import SerialChannelConfig, SerialConfig
from abbe.drivers.serial.fields import FieldError, compile_reader
from abbe.drivers.serial.port.lines import Splitter
from abbe.drivers.serial.question import SerialQuestion

# Checksums


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("sum", 0xDD),
        ("sum16", 0x1DD),
        ("xor", 0x31),
        ("lrc", 0x23),
        # the published check values of the CRC catalogues
        ("crc16", 0x4B37),
        ("crc16-arc", 0xBB3D),
        ("crc16-ccitt", 0x29B1),
        ("crc16-xmodem", 0x31C3),
    ],
)
def test_check_values(kind: Kind, value: int) -> None:
    assert ALGORITHMS[kind](b"123456789") == value


def test_a_sentence_of_nmea_0183() -> None:
    check = ChecksumConfig(kind="xor", skip=1, after="*")
    body = b"$GPGLL,5300.97914,N,00259.98174,E,125926,A"
    assert check.add(body) == body + b"*28"
    assert check.take(body + b"*28") == body


def test_an_example_of_modbus_ascii() -> None:
    # MODBUS over Serial Line V1.02, annex: unit 17, function 3; LRC of the binary message
    message = bytes.fromhex("11 03 00 6B 00 03")
    check = ChecksumConfig(kind="lrc", form="binary")
    assert check.add(message)[-1] == 0x7E


def test_a_block_check_character_covers_etx() -> None:
    check = ChecksumConfig(kind="xor", form="binary", skip=1, after="\x03", covers_after=True)
    assert check.add(b"\x02AB") == b"\x02AB\x03" + bytes([0x41 ^ 0x42 ^ 0x03])


KINDS = st.sampled_from(sorted(ALGORITHMS))
CHECKSUMS = st.builds(
    ChecksumConfig,
    kind=KINDS,
    form=st.sampled_from(["hex", "binary", "binary-low-first"]),
    after=st.sampled_from(["", "*", "\x03"]),
    covers_after=st.booleans(),
    skip=st.integers(0, 2),
)


@given(CHECKSUMS, st.binary(min_size=2, max_size=40))
def test_what_is_added_is_taken_off_again(check: ChecksumConfig, line: bytes) -> None:
    assert check.take(check.add(line)) == line


@given(CHECKSUMS, st.binary(min_size=3, max_size=30), st.data())
def test_one_wrong_bit_is_always_found(
    check: ChecksumConfig, line: bytes, data: st.DataObject
) -> None:
    whole = bytearray(check.add(line))
    place = data.draw(st.integers(check.skip, len(whole) - 1))
    bit = data.draw(st.integers(0, 7))
    whole[place] ^= 1 << bit
    spoilt = bytes(whole)
    if spoilt.upper() == check.add(line).upper() and place >= len(whole) - check.width:
        return  # the other case of a hexadecimal digit
    with pytest.raises(ChecksumError):
        check.take(spoilt)


def test_a_line_without_its_checksum() -> None:
    check = ChecksumConfig(kind="xor", after="*")
    for line in (b"", b"X", b"+1.5", b"+1.5*", b"*7"):
        with pytest.raises(ChecksumError):
            check.take(line)


# Lines


@given(
    st.lists(st.text(alphabet="ab\r", max_size=12), max_size=6),
    st.lists(st.integers(1, 5), min_size=1, max_size=40),
    st.sampled_from(["\r\n", "\n", "#"]),
)
def test_lines_are_the_same_in_any_pieces(
    lines: list[str], sizes: list[int], terminator: str
) -> None:
    lines = [line.rstrip("\r") if terminator == "\r\n" else line for line in lines]
    data = "".join(line + terminator for line in lines).encode()
    splitter, found, start = Splitter(terminator.encode(), 12), [], 0
    while start < len(data):
        size = sizes[start % len(sizes)]
        found += splitter.feed(data[start : start + size])
        start += size
    assert [line.decode() for line in found] == lines
    assert splitter.held == b""


@given(st.integers(11, 60), st.integers(1, 7))
def test_what_is_too_long_is_thrown_away_and_the_next_line_is_found(size: int, piece: int) -> None:
    data = b"x" * size + b"\r\nnext\r\n"
    splitter, found = Splitter(b"\r\n", 10), []
    for start in range(0, len(data), piece):
        found += splitter.feed(data[start : start + piece])
        assert len(splitter.held) <= 12
    assert found == [b"next"]
    assert splitter.thrown_away == 1


# Fields


def reader(**section: Any) -> Any:
    return compile_reader(SerialChannelConfig(message="m", **section))


@given(st.floats(-1e6, 1e6))
def test_decimal_numbers(value: float) -> None:
    text = f"{value:+.4f}"
    assert reader()(text) == float(text)
    assert reader()(f"{text[0]}   {text[1:]}") == float(text)
    assert reader(decimal=",")(text.replace(".", ",")) == float(text)
    assert reader(scale=0.001, offset=5.0)(text) == float(text) * 0.001 + 5.0


@pytest.mark.parametrize(
    "text",
    ["", " ", "-", "1.2.3", "1_000", "nan", "inf", "1e999", "0x10", "１２", "--1", "1,5", None],
)
def test_what_is_no_number(text: str | None) -> None:
    with pytest.raises(FieldError):
        reader()(text)


def test_a_point_where_a_comma_is_the_decimal_sign() -> None:
    with pytest.raises(FieldError):
        reader(decimal=",")("1.234,5")


@given(st.integers(-(1 << 31), (1 << 31) - 1))
def test_hexadecimal_numbers(value: int) -> None:
    assert reader(base=16, bits=32)(f"{value & 0xFFFFFFFF:08X}") == value
    assert reader(base=16)(f"{value & 0xFFFFFFFF:x}") == value & 0xFFFFFFFF


@pytest.mark.parametrize(
    ("text", "bits"), [("", 32), ("g", 32), ("100000000", 32), ("20000000000001", None)]
)
def test_hexadecimal_numbers_that_are_refused(text: str, bits: int | None) -> None:
    with pytest.raises(FieldError):
        reader(base=16, bits=bits)(text)


def test_texts_that_stand_for_values() -> None:
    read = reader(values={"OK": 1, "ERR": 0})
    assert (read("OK"), read(" ERR ")) == (1.0, 0.0)
    with pytest.raises(FieldError, match="found 'NO', expected one of OK, ERR"):
        read("NO")


@given(st.floats(allow_nan=False, allow_infinity=False, min_value=-1e9, max_value=1e9))
def test_commands_carry_the_value(value: float) -> None:
    channel = SerialChannelConfig(command="SX{value:+.6f};", scale=2.0, offset=1.0)
    assert float(channel.text_of(value)[2:-1]) == pytest.approx((value - 1.0) / 2.0, abs=1e-6)
    counts = SerialChannelConfig(command="{value:08d}", scale=0.5)
    assert int(counts.text_of(round(value))) == round(round(value) / 0.5)


# Which answers could be taken for which


def test_confusable_questions() -> None:
    number = SerialQuestion("a", r"(?P<a>\d+)")
    other, words = SerialQuestion("b", r"(?P<b>\d+)"), SerialQuestion("c", "T=(?P<c>.*)")
    assert number.confusable(number)
    assert not number.confusable(words)
    assert not number.confusable(other)  # nothing is known of them yet
    number.match([b"12"])
    assert number.confusable(other)
    assert other.confusable(number)
    assert not words.confusable(number)
    assert SerialQuestion("d", r"(?P<a>\d+)").confusable(number)
    assert SerialQuestion("e", "(?P<e>.*)", lines=2).confusable(words)


# Configurations

GOOD: dict[str, Any] = {
    "port": "/dev/ttyUSB0",
    "messages": {"m": {"query": "R", "pattern": r"(?P<x>\d+)"}},
    "channels": {"x": {"message": "m"}},
}


def test_a_good_configuration() -> None:
    config = SerialConfig.model_validate(GOOD)
    assert config.character_time == pytest.approx(10 / 9600)
    assert config.field_of("x") == "x"


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"port": ""}, "at least 1 character"),
        ({"port": "ftp://x"}, "ftp:// is not known"),
        ({"baud": 9600}, "Extra inputs"),
        ({"parity": "M"}, "'N', 'E' or 'O'"),
        ({"terminator": ""}, "at least 1 character"),
        ({"terminator": "§"}, "not ASCII"),
        ({"reconnect_min": 3.0}, "reconnect_max 2.0 is below reconnect_min 3.0"),
        ({"messages": {}}, "message 'm' is not defined; there are: none"),
        ({"messages": {"m": {"pattern": "("}}}, r"pattern '\(' is no regular expression"),
        ({"messages": {"m": {"pattern": r"\d+"}}}, "has no named field"),
        ({"messages": {"m": {"pattern": "(?P<y>.)"}}}, "has no field 'x'; its pattern has: y"),
        (
            {"messages": {"m": {"pattern": "(?P<x>.)", "lines": 2}}},
            "lines: only for a message with",
        ),
        ({"messages": {"m": {"pattern": "(?P<x>.)", "every": 2.0}}}, "every: only"),
        (
            {"messages": {"m": {"query": "R", "pattern": "(?P<x>.)", "within": 2.0}}},
            "within: only for a message without a query",
        ),
        ({"messages": {"m": {"query": "R", "pattern": "(?P<x>.*)"}}}, "fits the query 'R' itself"),
        (
            {"messages": GOOD["messages"] | {"s": {"pattern": "(?P<x>.)"}}},
            "either asked .m. or sends by itself",
        ),
        (
            {"messages": GOOD["messages"] | {"n": {"query": "N", "pattern": "(?P<x>=)"}}},
            "message 'n' is used by no channel",
        ),
        ({"channels": {}}, "at least 1 item"),
        ({"channels": {"x": {}}}, "needs either message .* or command"),
        ({"channels": {"x": {"message": "m", "command": "S{value}"}}}, "needs either"),
        ({"channels": {"x": {"message": "m", "scale": 0.0}}}, "scale is 0"),
        ({"channels": {"x": {"message": "m", "acknowledge": "OK"}}}, "acknowledge: only"),
        ({"channels": {"x": {"message": "m", "bits": 16}}}, "bits: only for base = 16"),
        ({"channels": {"o": {"command": "S"}}}, r"expected \{value\} once"),
        ({"channels": {"o": {"command": "S{value}{value}"}}}, r"expected \{value\} once"),
        ({"channels": {"o": {"command": "S{0}"}}}, r"expected \{value\} once"),
        ({"channels": {"o": {"command": "S{value:q}"}}}, "command 'S{value:q}'"),
        ({"channels": {"o": {"command": "S{value.__class__}"}}}, r"expected \{value\} once"),
        (
            {"channels": {"o": {"command": "S{value}", "acknowledge": "("}}},
            "acknowledge: pattern '",
        ),
        ({"channels": {"x": {"message": "m", "values": {"A": 1}, "base": 16}}}, "in place of numb"),
    ],
)
def test_a_configuration_that_cannot_work(change: dict[str, Any], wrong: str) -> None:
    with pytest.raises(ValidationError, match=wrong):
        SerialConfig.model_validate(GOOD | change)
