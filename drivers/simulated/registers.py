"""Register maps as data: named registers in contiguous blocks, packed and unpacked as one.

Words are big-endian and the high word comes first (ABCD), in every type.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

Table: TypeAlias = Literal["coil", "discrete", "holding", "input"]
"""The four tables of a Modbus device."""

RegisterType: TypeAlias = Literal["uint16", "int16", "uint32", "int32", "float32", "float64", "bit"]

_FORMAT = {
    "uint16": "H",
    "int16": "h",
    "uint32": "I",
    "int32": "i",
    "float32": "f",
    "float64": "d",
}


@dataclass(frozen=True)
class Register:
    """One value of a device.

    Attributes
    ----------
    name
        Its channel name.
    type
        How it is encoded; ``bit`` in coils and discrete inputs.
    doc
        What it is, for people.
    unit, scale
        The physical value is raw × scale, in `unit`.
    table, address
        Where it sits; given by its block.
    writable
        Whether a client may write it; given by its block.
    """

    name: str
    type: RegisterType
    doc: str
    unit: str = ""
    scale: float = 1.0
    table: Table = "input"
    address: int = 0
    writable: bool = False

    @property
    def size(self) -> int:
        """Number of 16-bit registers (of bits in coils and discrete inputs)."""
        return 1 if self.type == "bit" else struct.calcsize(f">{_FORMAT[self.type]}") // 2

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "name": self.name,
            "table": self.table,
            "address": self.address,
            "type": self.type,
            "unit": self.unit,
            "scale": self.scale,
            "writable": self.writable,
            "doc": self.doc,
        }


@dataclass(frozen=True)
class RegisterBlock:
    """Registers that follow each other without gaps.

    Attributes
    ----------
    name
        What the block is for.
    table, start
        Where it begins.
    registers
        In order; their table, address and access are set from the block's.
    writable
        Whether clients may write it.
    doc
        What it is, for people.
    """

    name: str
    table: Table
    start: int
    doc: str
    registers: tuple[Register, ...]
    writable: bool = False
    size: int = field(init=False)
    _struct: struct.Struct = field(init=False, repr=False, compare=False)
    _words: struct.Struct = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        address, placed = self.start, []
        for r in self.registers:
            placed.append(
                Register(r.name, r.type, r.doc, r.unit, r.scale, self.table, address, self.writable)
            )
            address += r.size
        size = address - self.start
        bits = self.table in ("coil", "discrete")
        code = "" if bits else "".join(_FORMAT[r.type] for r in placed)
        object.__setattr__(self, "registers", tuple(placed))
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "_struct", struct.Struct(f">{code}"))
        object.__setattr__(self, "_words", struct.Struct(f">{0 if bits else size}H"))

    def pack(self, values: Sequence[float]) -> list[int]:
        """Words of the whole block from one raw value per register."""
        return list(self._words.unpack(self._struct.pack(*values)))

    def unpack(self, words: Sequence[int]) -> dict[str, float]:
        """Raw values by name from the words of the whole block."""
        values = self._struct.unpack(self._words.pack(*words))
        return dict(zip((r.name for r in self.registers), values, strict=True))

    def overlaps(self, address: int, count: int) -> bool:
        """Whether a request for `count` registers from `address` touches the block."""
        return address < self.start + self.size and self.start < address + count
