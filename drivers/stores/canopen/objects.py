"""The objects of a CANopen node's table memory, and how they are read.

An object is written ``"2301:01"``: index and subindex, hexadecimal.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from abbe.drivers.link import LinkProtocolError
from abbe.drivers.stores.base import ShownCorrection

_WRITTEN = re.compile(r"([0-9A-Fa-f]{4}):([0-9A-Fa-f]{2})")

Object = tuple[int, int]


def _object(value: Any) -> Any:
    if isinstance(value, str):
        match = _WRITTEN.fullmatch(value)
        if match is None:
            raise ValueError(f"{value!r} is not an object like '2301:01' (index:subindex, hex)")
        return int(match[1], 16), int(match[2], 16)
    return value


At = Annotated[Object, BeforeValidator(_object)]
"""Index and subindex; in a file ``"2301:01"``."""


class ObjectMap(BaseModel):
    """The object map of a table memory. The defaults are those of Abbe's simulated controller."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    name: At = (0x1008, 0)
    """What the node calls itself, a string."""
    serial: At = (0x1018, 4)
    """Its serial number, UNSIGNED32."""
    state: At = (0x2300, 0)
    """Unsigned; the bits below."""
    idle_bit: Annotated[int, Field(ge=0, le=31)] = 0
    referenced_bit: Annotated[int, Field(ge=0, le=31)] = 1
    protected_bit: Annotated[int, Field(ge=0, le=31)] | None = 2
    """None: there is no write protection."""
    staged: At = (0x2301, 1)
    """The staging area, a DOMAIN, written and read as a whole."""
    staged_length: At = (0x2301, 2)
    """UNSIGNED32, bytes."""
    staged_crc: At = (0x2301, 3)
    """UNSIGNED32, CRC-32 of what is staged; 0 when nothing whole is."""
    discard: At = (0x2301, 4)
    """UNSIGNED8: 1 empties the staging area."""
    commit: At = (0x2302, 1)
    """UNSIGNED32: a CRC-32 makes what is staged active, if it has this one."""
    active: At = (0x2303, 1)
    """What is active, a DOMAIN."""
    active_length: At = (0x2303, 2)
    active_crc: At = (0x2303, 3)
    deactivate: At = (0x2303, 4)
    """UNSIGNED8: 1 has nothing active."""
    axes: list[str] = ["X", "Y", "Z"]
    """Axes whose positions and corrections are shown, as subindex 1, 2, … of the next three; none:
    the node shows nothing."""
    position: Annotated[int, Field(ge=0x1000, le=0xFFFF)] = 0x2305
    """INTEGER32."""
    correction: Annotated[int, Field(ge=0x1000, le=0xFFFF)] = 0x2306
    """INTEGER32."""
    direction: Annotated[int, Field(ge=0x1000, le=0xFFFF)] | None = 0x2307
    """INTEGER8: 1 upwards, −1 downwards; None: not shown."""
    hold: At | None = (0x2304, 0)
    """UNSIGNED8: 1 holds positions and corrections of one moment; None: they are read until two
    readings agree."""
    step: Annotated[float, Field(gt=0)] = 1e-6
    """mm (rotary: rad) of one count of positions and corrections."""
    adds_error: bool = False
    """The corrections shown are +error (a reading is corrected), not −error."""


def number(data: bytes) -> int:
    """An unsigned number of whatever size the node has.

    Raises
    ------
    LinkProtocolError
        When it is no number.
    """
    if not 1 <= len(data) <= 4:
        raise LinkProtocolError(f"{len(data)} bytes came where a number should be")
    return int.from_bytes(data, "little")


def shown(at: ObjectMap, data: Mapping[Object, bytes]) -> ShownCorrection:
    """What the node shows.

    Parameters
    ----------
    at
        Where.
    data
        Object → bytes.

    Raises
    ------
    LinkProtocolError
        When something is no number of its type.
    """
    position, correction, direction = {}, {}, {}
    try:
        for n, axis in enumerate(at.axes, start=1):
            position[axis] = struct.unpack("<l", data[at.position, n])[0] * at.step
            correction[axis] = struct.unpack("<l", data[at.correction, n])[0] * at.step
            if at.direction is not None:
                (way,) = struct.unpack("<b", data[at.direction, n])
                direction[axis] = (way > 0) - (way < 0)
    except struct.error as error:
        raise LinkProtocolError(f"positions or corrections of another size: {error}") from None
    return ShownCorrection(position, correction, direction)


def shown_objects(at: ObjectMap) -> list[Object]:
    """The objects that `shown` needs."""
    kinds = [at.position, at.correction, *([at.direction] if at.direction is not None else [])]
    return [(kind, n) for kind in kinds for n in range(1, len(at.axes) + 1)]
