"""Requests for a set of Modbus channels: merged, with the codecs precomputed for each."""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field

from abbe.drivers.modbus.codec import (
    Raw,
    compile_bit_decoder,
    compile_decoder,
    compile_encoder,
    compile_reader,
    compile_readers,
    compile_writer,
)
from abbe.drivers.modbus.config import BIT_TABLES, ModbusChannelConfig, ModbusConfig, Table

WRITE_REGISTERS = 123
"""Registers that one write request holds (MODBUS Application Protocol V1.1b3, 6.12)."""
WRITE_BITS = 1968
"""Coils that one write request holds (same, 6.11)."""

_READ_FUNCTION: dict[Table, int] = {"coil": 1, "discrete": 2, "holding": 3, "input": 4}

Cut = tuple[int, Table, int]
"""Unit, table and address that no request may cross, because the device refused one that did."""

Together = tuple[frozenset[str], ...]
"""Sets of channels that must be of one moment: no request is divided within one."""


@dataclass(frozen=True, slots=True)
class Span:
    """Consecutive addresses of one unit's table.

    Attributes
    ----------
    answer
        First bytes of the answer to a read of them, function code and number of bytes: on RTU, all
        that tells one unit's answers apart.
    confirmation
        First bytes of the answer to a write: function code, address and, where there are more
        than one, count.
    """

    unit: int
    table: Table
    address: int
    count: int
    answer: bytes = field(init=False, repr=False, compare=False)
    confirmation: bytes = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        size = (self.count + 7) // 8 if self.table in BIT_TABLES else 2 * self.count
        object.__setattr__(self, "answer", bytes((_READ_FUNCTION[self.table], size)))
        one, many = (5, 15) if self.table == "coil" else (6, 16)
        confirmed = (
            struct.pack(">BH", one, self.address)
            if self.count == 1
            else struct.pack(">BHH", many, self.address, self.count)
        )
        object.__setattr__(self, "confirmation", confirmed)

    def __str__(self) -> str:
        end = f"..{self.address + self.count - 1}" if self.count > 1 else ""
        return f"{self.table} {self.address}{end} of unit {self.unit}"


@dataclass(frozen=True, slots=True)
class ReadRequest:
    """One read, and what to make of its answer.

    Attributes
    ----------
    span
        What is asked for.
    names, readers
        The channels in it and how the raw number of each becomes its value.
    values
        The same for all of them at once.
    decode
        Bytes of the answer → raw numbers, in the order of `names`.
    """

    span: Span
    names: tuple[str, ...]
    readers: tuple[Callable[[Raw], float], ...]
    values: Callable[[Sequence[Raw]], list[float]]
    decode: Callable[[bytes], tuple[Raw, ...]]


@dataclass(frozen=True, slots=True)
class WriteRequest:
    """One write: channels that follow one another without a gap.

    Attributes
    ----------
    span
        What is written.
    names
        The channels, by address.
    encode
        Raw numbers in the order of `names` → registers (or bits).
    found
        Bytes of a read-back → registers (or bits), as `encode` gives them.
    verify
        For each channel to be read back: name and its slice of the span.
    """

    span: Span
    names: tuple[str, ...]
    encode: Callable[[Sequence[Raw]], tuple[int, ...]]
    found: Callable[[bytes], tuple[Raw, ...]]
    verify: tuple[tuple[str, slice], ...]


@dataclass(frozen=True, slots=True)
class WritePlan:
    """All requests of one batch of writes.

    Attributes
    ----------
    writers
        Channels as named by the caller, and how the value of each becomes a raw number.
    requests
        In the order in which they go out.
    """

    writers: tuple[tuple[str, Callable[[float], Raw]], ...]
    requests: tuple[WriteRequest, ...]


def merge(
    spans: Iterable[tuple[int, int]], limit: int, max_gap: int, cuts: Collection[int] = ()
) -> list[list[int]]:
    """Group spans so that each group is one request; the fewest groups there can be.

    Going by start address, a group takes the next span as long as the request stays within
    `limit` and reads no more than `max_gap` addresses in vain at one place. That is optimal:
    what does not fit begins the next request, which then covers all that this one could have.

    Parameters
    ----------
    spans
        First address and number of addresses of each; may overlap. A span is never divided.
    limit
        Addresses in one request.
    max_gap
        Addresses between two spans that may be read in vain.
    cuts
        Addresses that begin a new request.

    Returns
    -------
    list of list of int
        Indices into `spans`, grouped, by address.
    """
    listed = list(spans)
    groups: list[list[int]] = []
    first = end = 0
    for index in sorted(range(len(listed)), key=listed.__getitem__):
        start, width = listed[index]
        new_end = max(end, start + width)
        if (
            groups
            and start - end <= max_gap
            and new_end - first <= limit
            and not any(end <= cut <= start for cut in cuts)
        ):
            groups[-1].append(index)
            end = new_end
        else:
            groups.append([index])
            first, end = start, start + width
    return groups


def read_plan(
    config: ModbusConfig,
    names: Sequence[str],
    cuts: Collection[Cut] = (),
    together: Together = (),
) -> tuple[ReadRequest, ...]:
    """Requests that read `names`, each channel once, in the order of their units.

    Sets in `together` are read in as few requests as they need by themselves; no cut divides them.
    """
    requests: list[ReadRequest] = []
    for (unit, table), members in _by_place(config, names).items():
        limit = config.max_bits if table in BIT_TABLES else config.max_registers
        pieces = _pieces(config, members, limit, together)
        groups = merge(
            [(first, end - first) for first, end, _ in pieces],
            limit,
            config.max_gap,
            [at for cut_unit, cut_table, at in cuts if (cut_unit, cut_table) == (unit, table)],
        )
        for group in groups:
            chosen = sorted(
                (config.channels[name].address, place, name)
                for i in group
                for place, name in enumerate(pieces[i][2])
            )
            requests.append(
                _read_request(unit, {name: config.channels[name] for _, _, name in chosen})
            )
    return tuple(requests)


def _pieces(
    config: ModbusConfig, names: Sequence[str], limit: int, together: Together
) -> list[tuple[int, int, list[str]]]:
    """First address, end and channels of what is never divided, within one table of one unit."""
    pieces = []
    rest = list(names)
    for members in together:
        chosen = [name for name in rest if name in members]
        if len(chosen) < 2:
            continue
        spans = [(config.channels[n].address, config.channels[n].width) for n in chosen]
        for group in merge(spans, limit, config.max_gap):
            first, end = spans[group[0]][0], max(sum(spans[i]) for i in group)
            pieces.append((first, end, [chosen[i] for i in group]))
        rest = [name for name in rest if name not in members]
    for name in rest:
        channel = config.channels[name]
        pieces.append((channel.address, channel.address + channel.width, [name]))
    return pieces


def cut_of(config: ModbusConfig, request: ReadRequest, together: Together = ()) -> Cut | None:
    """Where to divide a request that the device refused: the widest gap, else the middle.

    None when it holds one channel only, or channels that overlap or belong together: these are
    then refused themselves.
    """
    span = request.span
    pieces = sorted(_pieces(config, request.names, span.count, together))
    best: tuple[int, float, int] | None = None
    middle = span.address + span.count / 2
    end = 0
    for i, (start, stop, _) in enumerate(pieces):
        if i and start >= end:
            candidate = (start - end, -abs(start - middle), start)
            best = candidate if best is None else max(best, candidate)
        end = max(end, stop)
    return None if best is None else (span.unit, span.table, best[2])


def write_plan(config: ModbusConfig, names: Sequence[str]) -> WritePlan:
    """Requests that write `names`: merged without gaps, in the order in which they are named.

    A request goes out when the first of its channels is due by that order, so a caller who names
    a heartbeat last has it written last.
    """
    requests: list[tuple[int, WriteRequest]] = []
    rank = {name: i for i, name in enumerate(names)}
    for (unit, table), members in _by_place(config, names).items():
        limit = WRITE_BITS if table in BIT_TABLES else WRITE_REGISTERS
        limit = min(limit, config.max_bits if table in BIT_TABLES else config.max_registers)
        channels = [config.channels[name] for name in members]
        for group in merge([(c.address, c.width) for c in channels], limit, 0):
            chosen = {members[i]: channels[i] for i in group}
            requests.append(
                (min(rank[name] for name in chosen), _write_request(unit, table, chosen))
            )
    return WritePlan(
        writers=tuple(
            (name, compile_writer(c.number_type, scaled=c))
            for name, c in ((name, config.channels[name]) for name in names)
        ),
        requests=tuple(request for _, request in sorted(requests, key=lambda pair: pair[0])),
    )


def _by_place(config: ModbusConfig, names: Sequence[str]) -> dict[tuple[int, Table], list[str]]:
    places: dict[tuple[int, Table], list[str]] = {}
    for name in dict.fromkeys(names):
        key = config.unit_of(name), config.channels[name].table
        places.setdefault(key, []).append(name)
    return dict(sorted(places.items()))


def _read_request(unit: int, channels: dict[str, ModbusChannelConfig]) -> ReadRequest:
    table = next(iter(channels.values())).table
    first = min(c.address for c in channels.values())
    count = max(c.address + c.width for c in channels.values()) - first
    offsets = [c.address - first for c in channels.values()]
    if table in BIT_TABLES:
        decode = compile_bit_decoder(offsets)
    else:
        decode = compile_decoder(
            count,
            [
                (at, c.number_type, c.order)
                for at, c in zip(offsets, channels.values(), strict=True)
            ],
        )
    kinds = [(c.number_type, c.bit or 0, c) for c in channels.values()]
    return ReadRequest(
        span=Span(unit, table, first, count),
        names=tuple(channels),
        readers=tuple(compile_reader(*kind) for kind in kinds),
        values=compile_readers(kinds),
        decode=decode,
    )


def _write_request(
    unit: int, table: Table, channels: dict[str, ModbusChannelConfig]
) -> WriteRequest:
    first = next(iter(channels.values())).address
    count = sum(c.width for c in channels.values())
    encode: Callable[[Sequence[Raw]], tuple[int, ...]]
    if table in BIT_TABLES:

        def encode(numbers: Sequence[Raw]) -> tuple[int, ...]:
            return tuple(int(number) for number in numbers)

    else:
        encode = compile_encoder([(c.number_type, c.order) for c in channels.values()])
    return WriteRequest(
        span=Span(unit, table, first, count),
        names=tuple(channels),
        encode=encode,
        found=(
            compile_bit_decoder(range(count))
            if table in BIT_TABLES
            else compile_decoder(count, [(at, "uint16", "ABCD") for at in range(count)])
        ),
        verify=tuple(
            (name, slice(c.address - first, c.address - first + c.width))
            for name, c in channels.items()
            if c.verify
        ),
    )
