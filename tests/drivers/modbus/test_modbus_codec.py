"""Types, byte and word orders, scaling: against layouts spelt out by hand and against `struct`."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.drivers.modbus.codec import (
    EXACT_LIMIT,
    WORDS,
    NotRepresentableError,
    compile_bit_decoder,
    compile_decoder,
    compile_encoder,
    compile_reader,
    compile_writer,
    raw_range,
)
from abbe.drivers.scaled import ScaledNumber

ORDERS = ("ABCD", "CDAB", "BADC", "DCBA")
NUMBERS = tuple(t for t in WORDS if t != "bit")
LAYOUTS = {
    (16, "ABCD"): "AB",
    (16, "CDAB"): "AB",
    (16, "BADC"): "BA",
    (16, "DCBA"): "BA",
    (32, "ABCD"): "ABCD",
    (32, "CDAB"): "CDAB",
    (32, "BADC"): "BADC",
    (32, "DCBA"): "DCBA",
    (64, "ABCD"): "ABCDEFGH",
    (64, "CDAB"): "GHEFCDAB",
    (64, "BADC"): "BADCFEHG",
    (64, "DCBA"): "HGFEDCBA",
}
"""Bits, order → bytes as they stand in the registers, A the most significant."""

STRUCT = {
    "int16": ">h",
    "int32": ">i",
    "int64": ">q",
    "uint16": ">H",
    "uint32": ">I",
    "uint64": ">Q",
    "float32": ">f",
    "float64": ">d",
}


def on_the_wire(number_type: str, order: str, raw: float) -> bytes:
    """The registers' bytes, from the letters of `LAYOUTS`."""
    big_endian = struct.pack(STRUCT[number_type], raw)
    letters = LAYOUTS[8 * len(big_endian), order]
    return bytes(big_endian["ABCDEFGH".index(letter)] for letter in letters)


def raws(number_type: str) -> st.SearchStrategy[float]:
    if number_type.startswith("float"):
        return st.floats(width=int(number_type[5:]), allow_nan=False)
    bits = int(number_type.lstrip("uint"))
    if number_type.startswith("u"):
        return st.integers(0, 2**bits - 1)
    return st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


fields = st.tuples(st.sampled_from(NUMBERS), st.sampled_from(ORDERS)).flatmap(
    lambda field: st.tuples(st.just(field[0]), st.just(field[1]), raws(field[0]))
)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("number_type", NUMBERS)
def test_every_type_in_every_order_alone(number_type: str, order: str) -> None:
    raw = {"float32": -2.5e-3, "float64": math.pi}.get(number_type, 1 + 2 * 256)
    if number_type.endswith("32") and "int" in number_type:
        raw = 0x0A0B0C0D
    if number_type.endswith("64") and "int" in number_type:
        raw = 0x0A0B0C0D0E0F1011
    wire = on_the_wire(number_type, order, raw)
    count = len(wire) // 2
    [back] = compile_decoder(count, [(0, number_type, order)])(wire)
    assert back == struct.unpack(STRUCT[number_type], struct.pack(STRUCT[number_type], raw))[0]
    words = compile_encoder([(number_type, order)])([raw])
    assert struct.pack(f">{count}H", *words) == wire


@given(st.lists(fields, min_size=1, max_size=12))
def test_a_run_of_mixed_values_there_and_back(run: list[tuple[str, str, float]]) -> None:
    wire = b"".join(on_the_wire(*field) for field in run)
    words = compile_encoder([(t, o) for t, o, _ in run])([raw for *_, raw in run])
    assert struct.pack(f">{len(words)}H", *words) == wire
    at = 0
    places = []
    for number_type, order, _ in run:
        places.append((at, number_type, order))
        at += WORDS[number_type]
    assert compile_decoder(at, places)(wire) == tuple(raw for *_, raw in run)


@given(st.data(), st.binary(min_size=40, max_size=40))
def test_fields_may_leave_gaps_overlap_and_stand_in_any_order(
    data: st.DataObject, wire: bytes
) -> None:
    places = data.draw(
        st.lists(
            st.tuples(st.integers(0, 16), st.sampled_from(NUMBERS), st.sampled_from(ORDERS)),
            min_size=1,
            max_size=8,
        )
    )
    decoded = compile_decoder(20, places)(wire)
    for (at, number_type, order), found in zip(places, decoded, strict=True):
        piece = wire[2 * at : 2 * (at + WORDS[number_type])]
        letters = LAYOUTS[8 * len(piece), order]
        big_endian = bytes(piece[letters.index("ABCDEFGH"[k])] for k in range(len(piece)))
        [expected] = struct.unpack(STRUCT[number_type], big_endian)
        assert found == expected or (math.isnan(found) and math.isnan(expected))


def test_bits_of_an_answer_count_from_the_least_significant_of_the_first_byte() -> None:
    # MODBUS Application Protocol V1.1b3, 6.1: coils 20-38 come as CD 6B 05.
    expected = [1, 0, 1, 1, 0, 0, 1, 1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 0, 1]
    assert list(compile_bit_decoder(range(19))(bytes.fromhex("CD6B05"))) == expected


@pytest.mark.parametrize("bit", range(16))
def test_bit_of_a_register(bit: int) -> None:
    read = compile_reader("bit", bit=bit)
    assert read(1 << bit) == 1.0
    assert read(0xFFFF ^ 1 << bit) == 0.0


@given(st.sampled_from(NUMBERS), st.data())
def test_raw_to_value_to_raw_is_exact_without_scale(number_type: str, data: st.DataObject) -> None:
    raw = data.draw(raws(number_type))
    if not math.isfinite(raw) or (abs(raw) > EXACT_LIMIT and not number_type.startswith("float")):
        with pytest.raises(NotRepresentableError):
            compile_reader(number_type)(raw)
        return
    value = compile_reader(number_type)(raw)
    assert isinstance(value, float)
    assert compile_writer(number_type)(value) == raw


@given(
    st.integers(-(2**31), 2**31 - 1),
    st.floats(1e-6, 1e6),
    st.booleans(),
    st.floats(-1e3, 1e3),
)
def test_a_scaled_count_survives_the_round_trip(
    raw: int, size: float, negative: bool, offset: float
) -> None:
    scale = -size if negative else size
    scaled = ScaledNumber(scale=scale, offset=offset)
    value = compile_reader("int32", scaled=scaled)(raw)
    assert value == raw * scale + offset
    back = compile_writer("int32", scaled=scaled)
    # The offset may eat a count's digits; half a count of that is the most that is lost.
    if abs(offset) < 1e6 * size:
        assert back(value) == raw


def test_writing_rounds_to_the_nearest_count() -> None:
    write = compile_writer("int16", scaled=ScaledNumber(scale=0.1))
    assert write(1.26) == 13
    assert write(-1.26) == -13
    assert write(3276.74) == 32767


@pytest.mark.parametrize(
    ("number_type", "low", "high"),
    [
        ("int16", -(2**15), 2**15 - 1),
        ("uint16", 0, 2**16 - 1),
        ("int32", -(2**31), 2**31 - 1),
        ("uint32", 0, 2**32 - 1),
        ("int64", -(2**53) + 1, 2**53 - 1),
        ("uint64", 0, 2**53 - 1),
        ("float32", -3.4028234663852886e38, 3.4028234663852886e38),
        ("float64", -1.7976931348623157e308, 1.7976931348623157e308),
    ],
)
def test_range_ends_are_written_and_what_lies_beyond_is_refused(
    number_type: str, low: float, high: float
) -> None:
    assert raw_range(number_type) == (low, high)
    write = compile_writer(number_type)
    assert (write(float(low)), write(float(high))) == (low, high)
    compile_encoder([(number_type, "ABCD")])([write(float(high))])
    step = 2.0**100 if number_type == "float32" else 1.0
    beyond = math.inf if number_type == "float64" else float(high) + step
    with pytest.raises(NotRepresentableError):
        write(beyond)
    with pytest.raises(NotRepresentableError):
        write(-math.inf if number_type == "float64" else float(low) - step)


def test_the_refusal_names_value_type_and_range_in_the_channels_unit() -> None:
    with pytest.raises(
        NotRepresentableError, match=r"40\.0 does not fit int16: .*-32\.768 to 32\.767"
    ):
        compile_writer("int16", scaled=ScaledNumber(scale=0.001))(40.0)


@pytest.mark.parametrize("number_type", [*NUMBERS, "bit"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_nan_and_infinity_are_never_written(number_type: str, value: float) -> None:
    with pytest.raises(NotRepresentableError):
        compile_writer(number_type)(value)


@pytest.mark.parametrize("number_type", ["float32", "float64"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_nan_and_infinity_from_the_device_are_not_values(number_type: str, value: float) -> None:
    with pytest.raises(NotRepresentableError):
        compile_reader(number_type)(value)


@pytest.mark.parametrize("number_type", ["int64", "uint64"])
def test_a_count_that_a_float_would_round_is_refused(number_type: str) -> None:
    read = compile_reader(number_type, scaled=ScaledNumber(scale=1e-6))
    assert read(2**53 - 1) == (2**53 - 1) * 1e-6
    for raw in (2**53, 2**53 + 1, 2**63 - 1):
        with pytest.raises(NotRepresentableError, match=str(raw)):
            read(raw)
    # 2**53 + 1 is already 2**53 as a float: accepting 2**53 would accept a rounded count.
    with pytest.raises(NotRepresentableError):
        compile_writer(number_type)(float(2**53 + 1))


@pytest.mark.parametrize("value", [0.5, 2.0, -1.0, 1.0000001])
def test_only_0_and_1_are_bits(value: float) -> None:
    with pytest.raises(NotRepresentableError):
        compile_writer("bit")(value)
