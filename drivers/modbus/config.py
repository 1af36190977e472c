"""The configuration section of a Modbus link, checked before anything opens.

The daemon takes ``driver`` out of a ``[links.NAME]`` table and gives the rest to `ModbusConfig`::

    [links.cmm]
    driver = "modbus"
    transport = "tcp"                  # or "rtu": port = "/dev/ttyUSB0", baudrate = 19200, ...
    host = "192.168.0.10"
    port = 502
    timeout = 0.3                      # s
    [links.cmm.blocks.slow]
    every = 1.0                        # s
    [links.cmm.channels.enc_x]
    table = "input"
    address = 0                        # as sent: 30001 in a maker's manual is input 0
    type = "int32"
    order = "ABCD"
    [links.cmm.channels.T_x]
    table = "input"
    address = 20
    type = "uint16"
    scale = 0.1
    unit = "ohm"
    block = "slow"
    [links.cmm.channels.out_x]
    table = "holding"
    address = 100
    type = "int32"
    writable = true
    verify = true

``docs/modbus.md`` is the user's page on each key.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from abbe.drivers.modbus.codec import WORDS, NumberType, Order, raw_range
from abbe.drivers.quarantine import QuarantineConfig
from abbe.drivers.scaled import ScaledNumber
from abbe.drivers.serial.port.settings import SerialSettings

Table = Literal["holding", "input", "coil", "discrete"]

BIT_TABLES: tuple[Table, ...] = ("coil", "discrete")
WRITABLE_TABLES: tuple[Table, ...] = ("holding", "coil")
DEFAULT_BLOCK = "default"
_RTU_ONLY = ("baudrate", "parity", "stopbits", "bytesize", "pause", "late_reply_max", "local_echo")

UnitId = Annotated[int, Field(ge=0, le=255)]
_STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class BlockConfig(BaseModel):
    """A group of channels that are read at one rate."""

    model_config = _STRICT

    every: Annotated[float, Field(ge=0)] = 0.0
    """s between two reads of the device; 0 reads at every call."""
    unit_id: UnitId | None = None
    """Unit of the block's channels, where a channel does not name its own."""


class ModbusChannelConfig(ScaledNumber):
    """One named value: where it sits, how it is encoded, what it stands for."""

    model_config = _STRICT

    table: Table
    address: Annotated[int, Field(ge=0, le=65535)]
    """Of the first register or bit, counted from 0 as sent on the wire."""
    type: NumberType | None = None
    """Required for holding and input registers; coils and discrete inputs are always "bit"."""
    order: Order = "ABCD"
    """Byte and word order, `abbe.drivers.modbus.codec`."""
    bit: Annotated[int, Field(ge=0, le=15)] | None = None
    """For type "bit" in a register: which, 0 the least significant."""
    unit_id: UnitId | None = None
    """Of the device on the bus; default the block's, then the link's."""
    block: str = DEFAULT_BLOCK
    unit: str = ""
    """Unit of the value, for people."""
    writable: bool = False
    verify: bool = False
    """Read back after each write and compare, bit for bit."""

    @property
    def number_type(self) -> NumberType:
        """The type, also of a coil or discrete input that names none."""
        return self.type or "bit"

    @property
    def width(self) -> int:
        """Addresses that the value takes: registers, or one bit."""
        return WORDS[self.number_type]

    @property
    def place(self) -> str:
        """Where it sits, for people: ``holding 100..101``."""
        end = f"..{self.address + self.width - 1}" if self.width > 1 else ""
        dot = f" bit {self.bit}" if self.bit is not None else ""
        return f"{self.table} {self.address}{end}{dot}"

    @model_validator(mode="after")
    def _consistent(self) -> ModbusChannelConfig:
        in_bit_table = self.table in BIT_TABLES
        if in_bit_table and self.type not in (None, "bit"):
            raise ValueError(f"a {self.table} is one bit: type is {self.type!r}, expected none")
        if not in_bit_table and self.type is None:
            raise ValueError(f"type is missing: a {self.table} register needs one, e.g. 'int32'")
        if (self.bit is not None) != (self.number_type == "bit" and not in_bit_table):
            raise ValueError(
                "bit belongs to type = 'bit' in a holding or input register, and only there: "
                f"found type {self.number_type!r}, bit {self.bit} in table {self.table!r}"
            )
        if in_bit_table and self.order != "ABCD":
            raise ValueError(f"a {self.table} is one bit and has no order; found {self.order!r}")
        if self.address + self.width > 65536:
            raise ValueError(f"{self.place} reaches beyond address 65535")
        if self.writable and self.table not in WRITABLE_TABLES:
            raise ValueError(f"Modbus cannot write {self.table}; writable are holding and coil")
        if self.writable and self.bit is not None:
            raise ValueError(
                "a single bit of a register cannot be written without a race against the device; "
                "write the whole register as uint16, or use a coil"
            )
        if self.verify and not self.writable:
            raise ValueError("verify is for channels with writable = true")
        if self.number_type == "bit" and (self.scale, self.offset) != (1.0, 0.0):
            raise ValueError("a bit has neither scale nor offset")
        whole = "float" not in self.number_type
        ends = [self.value_of(end) for end in raw_range(self.number_type)]
        if whole and not all(map(math.isfinite, ends)):
            raise ValueError(f"scale {self.scale} takes {self.type} beyond a float64")
        return self


class ModbusConfig(QuarantineConfig, SerialSettings):
    """One Modbus bus: a TCP connection or a serial line, its units and its channels.

    Times are in s.
    """

    model_config = _STRICT

    transport: Literal["tcp", "rtu"] = "tcp"
    host: str | None = None
    """TCP: name or address of the device or gateway."""
    port: int | str = 502
    """TCP: port number. RTU: the serial device, e.g. ``/dev/ttyUSB0``."""
    baudrate: Annotated[int, Field(ge=50)] = 19200
    """RTU, bit/s; as the devices are set, like `parity` and `stopbits`."""
    bytesize: Literal[8] = 8
    """Modbus RTU needs eight; the key exists because people look for it."""
    local_echo: bool = False
    """RTU: the adapter hears what it sends (two-wire RS-485 without echo suppression)."""
    pause: Annotated[float, Field(ge=0)] | None = None
    """RTU, s of silence before a request; default 3.5 characters, the protocol's least."""
    late_reply_max: Annotated[float, Field(gt=0)] = 2.0
    """RTU, s after a request beyond which its reply cannot come any more."""

    unit_id: UnitId = 1
    """Unit of channels that neither name one nor belong to a block that does."""
    max_gap: Annotated[int, Field(ge=0, le=124)] = 8
    """Registers (or bits) that may be read in vain to merge two requests into one."""
    max_registers: Annotated[int, Field(ge=1, le=125)] = 125
    """Registers in one request; less for a device that cannot do the protocol's 125."""
    max_bits: Annotated[int, Field(ge=1, le=2000)] = 2000
    """Coils or discrete inputs in one request."""
    separate: Annotated[tuple[Literal["tables", "units"], ...], Field(strict=False)] = ()
    """What the device keeps in memories of its own. Many do not: their holding and input registers
    are the same, or they answer for any unit id on TCP. Unless it is said here, an address that is
    read counts as the one that is written."""
    max_waiting: Annotated[int, Field(ge=1)] = 16
    """Calls that may wait for the bus; one more is turned away at once."""

    blocks: dict[str, BlockConfig] = Field(default_factory=dict)
    channels: Annotated[dict[str, ModbusChannelConfig], Field(min_length=1)]

    @property
    def where(self) -> str:
        """The bus's address, for people."""
        return f"{self.host}:{self.port}" if self.transport == "tcp" else str(self.port)

    @property
    def silence(self) -> float:
        """Silence in s before a request: 3.5 characters, 1.75 ms above 19200 bit/s; TCP none.

        MODBUS over Serial Line, V1.02, 2.5.1.1.
        """
        if self.transport == "tcp":
            return 0.0
        if self.pause is not None:
            return self.pause
        return 3.5 * self.character_time if self.baudrate <= 19200 else 1.75e-3

    def unit_of(self, channel: str) -> int:
        """Unit id of a channel: its own, else its block's, else the link's."""
        config = self.channels[channel]
        if config.unit_id is not None:
            return config.unit_id
        block = self.blocks.get(config.block)
        return self.unit_id if block is None or block.unit_id is None else block.unit_id

    def period_of(self, channel: str) -> float:
        """Time in s between two reads of a channel, from its block."""
        block = self.blocks.get(self.channels[channel].block)
        return block.every if block else 0.0

    @model_validator(mode="after")
    def _transport_is_complete(self) -> ModbusConfig:
        if self.transport == "tcp":
            if not self.host:
                raise ValueError("host is missing: transport = 'tcp' needs one")
            if not isinstance(self.port, int) or not 1 <= self.port <= 65535:
                raise ValueError(f"port is {self.port!r}, expected a TCP port, 1 to 65535")
            strange = [key for key in _RTU_ONLY if key in self.model_fields_set]
            if strange:
                raise ValueError(f"{', '.join(strange)}: only for transport = 'rtu'")
        else:
            if not isinstance(self.port, str) or not self.port:
                raise ValueError(f"port is {self.port!r}, expected a device, e.g. '/dev/ttyUSB0'")
            if self.host is not None:
                raise ValueError("host: only for transport = 'tcp'")
        return self

    @model_validator(mode="after")
    def _channels_fit_together(self) -> ModbusConfig:
        for name, channel in self.channels.items():
            if channel.block != DEFAULT_BLOCK and channel.block not in self.blocks:
                known = ", ".join(sorted(self.blocks)) or "none"
                raise ValueError(
                    f"channel {name!r}: block {channel.block!r} is not defined; there are: {known}"
                )
            unit = self.unit_of(name)
            if self.transport == "rtu" and not 1 <= unit <= 247:
                raise ValueError(f"channel {name!r}: unit_id {unit}; RTU units are 1 to 247")
            if channel.width > self.max_registers:
                raise ValueError(
                    f"channel {name!r}: {channel.type} takes {channel.width} registers, "
                    f"max_registers is {self.max_registers}"
                )
        writable = sorted(
            (self.unit_of(name), channel.table, channel.address, name)
            for name, channel in self.channels.items()
            if channel.writable
        )
        for (unit, table, _, first), (unit2, table2, address, second) in pairwise(writable):
            a, b = self.channels[first], self.channels[second]
            if (unit, table) == (unit2, table2) and address < a.address + a.width:
                raise ValueError(
                    f"writable channels {first!r} ({a.place}, {a.number_type}) and {second!r} "
                    f"({b.place}, {b.number_type}) of unit {unit} overlap"
                )
        return self
