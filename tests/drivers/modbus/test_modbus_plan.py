"""Merging: covers everything, tears nothing, keeps the limits, and cannot be done with less."""

from __future__ import annotations

from functools import cache

from hypothesis import given
from hypothesis import strategies as st

from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.plan import cut_of, merge, read_plan, write_plan

spans = st.lists(st.tuples(st.integers(0, 60), st.sampled_from([1, 1, 2, 4])), max_size=12)


def fewest(wanted: list[tuple[int, int]], limit: int, max_gap: int) -> int:
    """The least number of requests, by trying all divisions of the spans in order of address."""
    ordered = sorted(wanted)

    def fits(group: list[tuple[int, int]]) -> bool:
        end = group[0][0]
        for start, width in group:
            if start - end > max_gap:
                return False
            end = max(end, start + width)
        return end - group[0][0] <= limit

    @cache
    def best(first: int) -> int:
        if first == len(ordered):
            return 0
        return min(
            1 + best(last)
            for last in range(first + 1, len(ordered) + 1)
            if fits(ordered[first:last])
        )

    return best(0)


@given(spans, st.integers(4, 20), st.integers(0, 6), st.sets(st.integers(0, 60), max_size=3))
def test_groups_cover_all_and_keep_the_limits(
    wanted: list[tuple[int, int]], limit: int, max_gap: int, cuts: set[int]
) -> None:
    groups = merge(wanted, limit, max_gap, cuts)
    assert sorted(i for group in groups for i in group) == list(range(len(wanted)))
    for group in groups:
        members = sorted(wanted[i] for i in group)
        first = members[0][0]
        end = first
        for i, (start, width) in enumerate(members):
            assert start - end <= max_gap
            assert not (i and any(end <= cut <= start for cut in cuts))
            end = max(end, start + width)
        assert end - first <= limit


@given(spans, st.integers(4, 20), st.integers(0, 6))
def test_no_division_needs_fewer_requests(
    wanted: list[tuple[int, int]], limit: int, max_gap: int
) -> None:
    assert len(merge(wanted, limit, max_gap)) == fewest(wanted, limit, max_gap)


def config(channels: dict[str, dict[str, object]], **more: object) -> ModbusConfig:
    return ModbusConfig.model_validate({"host": "127.0.0.1", "channels": channels, **more})


def many(table: str, step: int, count: int, **more: object) -> dict[str, dict[str, object]]:
    return {f"c{i}": {"table": table, "address": step * i, **more} for i in range(count)}


def shape(settings: ModbusConfig, names: list[str] | None = None) -> list[tuple[str, int, int]]:
    plan = read_plan(settings, names or list(settings.channels))
    return [(r.span.table, r.span.address, r.span.count) for r in plan]


def test_three_axes_and_six_thermistors_are_one_request() -> None:
    channels = {
        f"enc_{a}": {"table": "input", "address": 2 * i, "type": "int32"}
        for i, a in enumerate("xyz")
    }
    channels |= {
        f"T_{i}": {"table": "input", "address": 10 + i, "type": "uint16"} for i in range(6)
    }
    assert shape(config(channels)) == [("input", 0, 16)]


def test_a_value_is_never_torn_at_the_limit_of_125_registers() -> None:
    assert shape(config(many("holding", 2, 63, type="float32"))) == [
        ("holding", 0, 124),
        ("holding", 124, 2),
    ]
    assert shape(config(many("holding", 4, 32, type="int64"))) == [
        ("holding", 0, 124),
        ("holding", 124, 4),
    ]


def test_2000_bits_are_one_request_2001_are_two() -> None:
    assert shape(config(many("coil", 1, 2000))) == [("coil", 0, 2000)]
    assert shape(config(many("coil", 1, 2001))) == [("coil", 0, 2000), ("coil", 2000, 1)]


def test_gap_up_to_the_setting() -> None:
    channels = {
        "a": {"table": "input", "address": 0, "type": "int16"},
        "b": {"table": "input", "address": 9, "type": "int16"},
    }
    assert shape(config(channels)) == [("input", 0, 10)]
    assert shape(config(channels, max_gap=7)) == [("input", 0, 1), ("input", 9, 1)]


def test_units_and_tables_are_asked_apart() -> None:
    channels = {
        "a": {"table": "input", "address": 0, "type": "int16"},
        "b": {"table": "holding", "address": 1, "type": "int16"},
        "c": {"table": "input", "address": 2, "type": "int16", "unit_id": 2},
        "d": {"table": "discrete", "address": 3},
        "e": {"table": "input", "address": 1, "type": "int16"},
    }
    plan = read_plan(config(channels), list(channels))
    assert [(r.span.unit, r.span.table, r.names) for r in plan] == [
        (1, "discrete", ("d",)),
        (1, "holding", ("b",)),
        (1, "input", ("a", "e")),
        (2, "input", ("c",)),
    ]


def test_a_refused_request_is_divided_at_its_widest_gap_then_in_the_middle() -> None:
    settings = config(
        {
            name: {"table": "input", "address": at, "type": "int16"}
            for name, at in {"a": 0, "b": 1, "c": 7, "d": 8, "e": 9, "f": 10}.items()
        }
    )
    [request] = read_plan(settings, list(settings.channels))
    cuts = {cut_of(settings, request)}
    assert cuts == {(1, "input", 7)}
    left, right = read_plan(settings, list(settings.channels), cuts)
    assert (left.names, right.names) == (("a", "b"), ("c", "d", "e", "f"))
    assert cut_of(settings, right) == (1, "input", 9)
    [alone] = read_plan(settings, ["a"])
    assert cut_of(settings, alone) is None


def writable(addresses: dict[str, int], **more: object) -> ModbusConfig:
    return config(
        {
            name: {"table": "holding", "address": at, "type": "int32", "writable": True, **more}
            for name, at in addresses.items()
        }
    )


def test_writes_are_merged_without_gaps_in_the_order_of_the_caller() -> None:
    settings = writable({"z": 104, "x": 100, "y": 102, "beat": 90, "far": 107})
    plan = write_plan(settings, ["x", "y", "z", "far", "beat"])
    assert [(r.span.address, r.span.count, r.names) for r in plan.requests] == [
        (100, 6, ("x", "y", "z")),
        (107, 2, ("far",)),
        (90, 2, ("beat",)),
    ]
    assert [name for name, _ in plan.writers] == ["x", "y", "z", "far", "beat"]


def test_writes_keep_to_123_registers() -> None:
    settings = writable({f"c{i}": 2 * i for i in range(70)})
    plan = write_plan(settings, list(settings.channels))
    assert [(r.span.address, r.span.count) for r in plan.requests] == [(0, 122), (122, 18)]


def test_first_bytes_tell_what_a_reply_shows() -> None:
    [request] = read_plan(config({"a": {"table": "input", "address": 5, "type": "int32"}}), ["a"])
    assert request.span.answer == b"\x04\x04"
    [bits] = read_plan(config({"a": {"table": "coil", "address": 5}}), ["a"])
    assert bits.span.answer == b"\x01\x01"
    [write] = write_plan(writable({"x": 0x102}), ["x"]).requests
    assert write.span.confirmation == b"\x10\x01\x02\x00\x02"
