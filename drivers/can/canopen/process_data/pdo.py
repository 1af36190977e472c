"""Process data of a node: which PDO carries which objects, and the numbers in its frames."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from abbe.drivers.can.canopen.objects import Type, decode, size_of
from abbe.drivers.can.canopen.sdo.errors import SdoAbortError
from abbe.drivers.link import LinkProtocolError, Sample

_COMMUNICATION, _MAPPING = 0x1800, 0x1A00
_MOST_PDOS = 8
"""Transmit PDOs that are looked at; encoders have two to four."""
_INVALID = 1 << 31
_EXTENDED = 1 << 29
_EVERY_SYNC, _LAST_SYNCHRONOUS = 1, 240

Upload = Callable[[int, int], bytes]
Object = tuple[int, int]


@dataclass(eq=False)
class Pdo:
    """One transmit PDO of a node.

    Attributes
    ----------
    number
        From 1.
    cob_id
        The id of its frames.
    transmission
        Its transmission type (CiA 301, 7.5.2.36): 1 to 240 sent at every so many SYNC, 0 at a SYNC
        after a change, more by itself.
    places
        Object → (first bit, bits) in the frame.
    data, came
        Its last frame and when it came (monotonic, s).
    taken
        The earliest moment at which its values can have been taken (monotonic, s).
    samples
        Channel → its value in that; None until it is worked out.
    awaited_since
        When the SYNC was sent that it answers; None when none is waited for.
    not_before
        Monotonic time in s before which it is not believed: a late one may come.
    """

    number: int
    cob_id: int
    transmission: int
    places: Mapping[Object, tuple[int, int]]
    data: bytes | None = None
    samples: Mapping[str, Sample] | None = None
    came: float = field(default=float("-inf"))
    taken: float = field(default=float("-inf"))
    awaited_since: float | None = None
    not_before: float = float("-inf")

    @property
    def synchronous(self) -> bool:
        """Whether the node sends it at a SYNC."""
        return self.transmission <= _LAST_SYNCHRONOUS

    def is_same(self, other: Pdo) -> bool:
        """Whether both are the same PDO, mapped alike."""
        mine = (self.number, self.cob_id, self.transmission, self.places)
        return mine == (other.number, other.cob_id, other.transmission, other.places)

    def take(
        self, data: bytes, came: float, sync_at: float = math.inf, latest: float | None = None
    ) -> bool:
        """A frame of it came (monotonic, s); False when it is too old to be believed.

        Parameters
        ----------
        data
            Its content.
        came
            When, at the earliest.
        sync_at
            When the last SYNC before that went over the bus, monotonic s.
        latest
            When it came at the latest; default the same.
        """
        since = self.awaited_since
        here = came if latest is None else latest
        if here < self.not_before or (since is not None and here < since):
            return False
        self.data, self.came, self.samples, self.awaited_since = data, came, None, None
        self.taken = came
        if since is not None:
            # that it is an answer is certain enough
            self.came, self.taken = max(came, since), since
        elif self.synchronous:
            self.taken = min(came, sync_at)
        return True

    def reader(self, wanted: Object, kind: Type) -> Callable[[], float]:
        """What reads an object's number in the last frame.

        It raises ValueError when the frame is too short, or its bytes are no such number.

        Raises
        ------
        LinkProtocolError
            When the type does not fit what is mapped.
        """
        first, bits = self.places[wanted]
        if bits != 8 * size_of(kind) or first % 8:
            raise LinkProtocolError(
                f"TPDO{self.number} carries {bits} bits of it from bit {first}, {kind} has "
                f"{8 * size_of(kind)}"
            )
        begin, end = first // 8, (first + bits) // 8

        def read() -> float:
            data = self.data or b""
            if len(data) < end:
                raise ValueError(f"TPDO{self.number} is too short: {len(data)} bytes")
            return decode(kind, data[begin:end])

        return read


def choose_pdo(pdos: Sequence[Pdo], wanted: Object, *, synchronous: bool, required: bool) -> Pdo:
    """The PDO that carries an object.

    Parameters
    ----------
    pdos
        All of a node.
    wanted
        Index and subindex.
    synchronous
        Whether one that answers a SYNC is wanted, else one that the node sends by itself.
    required
        Whether it has to answer every SYNC.

    Raises
    ------
    LinkProtocolError
        When there is none; says what they carry.
    """
    carrying = [pdo for pdo in pdos if wanted in pdo.places]
    if not carrying:
        message = "; ".join(
            f"TPDO{pdo.number}: " + ", ".join(f"{i:04X}h:{s:02X}" for i, s in pdo.places)
            for pdo in pdos
        )
        raise LinkProtocolError(
            f"object {wanted[0]:04X}h:{wanted[1]:02X} is in none of the node's TPDOs "
            f"({message or 'it has none'})"
        )
    if required:
        for pdo in carrying:
            if pdo.transmission == _EVERY_SYNC:
                return pdo
        message = ", ".join(f"that of TPDO{pdo.number} is {pdo.transmission}" for pdo in carrying)
        raise LinkProtocolError(
            f"no TPDO with {wanted[0]:04X}h:{wanted[1]:02X} answers every SYNC: its transmission "
            f"type would be {_EVERY_SYNC}, {message}"
        )
    fitting = [pdo for pdo in carrying if pdo.synchronous is synchronous]
    return (fitting or carrying)[0]


def read_pdos(upload: Upload) -> list[Pdo]:
    """A node's valid transmit PDOs and what they carry; asks it, object by object."""
    pdos = []
    for i in range(_MOST_PDOS):
        try:
            cob_id = int.from_bytes(upload(_COMMUNICATION + i, 1), "little")
            kind = upload(_COMMUNICATION + i, 2)[0]
            count = upload(_MAPPING + i, 0)[0]
        except SdoAbortError:
            continue
        if cob_id & (_INVALID | _EXTENDED):
            continue
        places: dict[Object, tuple[int, int]] = {}
        first = 0
        for entry in range(1, count + 1):
            mapped = int.from_bytes(upload(_MAPPING + i, entry), "little")
            bits = mapped & 0xFF
            places[mapped >> 16, mapped >> 8 & 0xFF] = (first, bits)
            first += bits
        pdos.append(Pdo(i + 1, cob_id & 0x7FF, kind, places))
    return pdos
