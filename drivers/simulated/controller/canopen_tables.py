"""A simulated controller's table memory as objects of a CANopen node.

=======  ===  =============  =======================================================================
index    sub  type           content
=======  ===  =============  =======================================================================
1008h    0    string         name
1018h    4    UNSIGNED32     serial number
2300h    0    UNSIGNED8      state: bit 0 idle, 1 referenced, 2 protected
2301h    1    DOMAIN         staging area; written as a whole, read back
2301h    2    UNSIGNED32     its length
2301h    3    UNSIGNED32     its CRC-32; 0 when nothing whole is there
2301h    4    UNSIGNED8      write 1: empty it
2302h    1    UNSIGNED32     write a CRC-32: make what is staged active, if it is this
2303h    1    DOMAIN         what is active, read only
2303h    2    UNSIGNED32     its length
2303h    3    UNSIGNED32     its CRC-32
2303h    4    UNSIGNED8      write 1: have nothing active
2304h    0    UNSIGNED8      write 1: hold positions and corrections of this moment
2305h    n    INTEGER32      held position of axis n, nm
2306h    n    INTEGER32      held correction of axis n, nm
2307h    n    INTEGER8       held direction of axis n: 1 up, −1 down
=======  ===  =============  =======================================================================

Things go wrong frame by frame: each SDO frame that is heard is one operation of its name in
`abbe.drivers.simulated.controller.table_faults`.
"""

from __future__ import annotations

import asyncio
import contextlib
import struct
import zlib
from collections.abc import Callable

from abbe.drivers.simulated.can.canopen_node import INITIALISING, CanopenNode
from abbe.drivers.simulated.can.sdo_server import AbortCodeError, Entry, Key
from abbe.drivers.simulated.can.wire import CanWire
from abbe.drivers.simulated.controller.table_faults import Faults, TableFault
from abbe.drivers.simulated.controller.table_memory import (
    CHECKSUM,
    CONTENT,
    NO,
    NOT_READY,
    NOTHING_STAGED,
    SESSION,
    TOO_LARGE,
    ControlRefusesError,
    PowerFailsError,
    TableMemory,
)

NODE = 16
NAME, SERIAL = "ABBE SIMULATED CONTROL 1.0", 4711
_ABORTS = {
    NOT_READY: 0x08000022,  # because of the present device state
    NOTHING_STAGED: 0x08000024,  # no data available
    CHECKSUM: 0x06090030,  # value range
    TOO_LARGE: 0x05040005,  # out of memory
    CONTENT: 0x06090030,
    SESSION: 0x08000022,
    NO: 0x08000021,  # because of local control
}
_STATE_NOW = 0x08000022
_BY_OBJECT = {
    (0x2300, 0): "state",
    (0x2301, 2): "status",
    (0x2301, 3): "status",
    (0x2301, 4): "discard",
    (0x2302, 1): "commit",
    (0x2303, 2): "status",
    (0x2303, 3): "status",
    (0x2303, 4): "deactivate",
}
_COMMANDS = ("discard", "commit", "deactivate", "begin", "block")


class TableNode(CanopenNode):
    """The objects of one `TableMemory`.

    Parameters
    ----------
    wire
        Its bus.
    memory
        The controller.
    faults
        What goes wrong.

    Attributes
    ----------
    protected
        Nothing can be made active.
    """

    def __init__(self, wire: CanWire, memory: TableMemory, faults: Faults) -> None:
        self.memory, self.faults = memory, faults
        self.protected = False
        self._lies = self._alters = False
        self._transfer = "status"
        self._held = memory.step()
        super().__init__(wire, NODE, 0, self._objects())

    def restart(self) -> None:
        """Off and on again, at once."""
        self.memory.restart()
        self._held = self.memory.step()
        self.sdo.forget()
        self.boot()

    def wake(self) -> None:
        """Answer again."""
        self.silent = self.deaf = False

    # objects

    def _objects(self) -> dict[Key, Entry]:
        memory = self.memory

        def u32(get: Callable[[], int]) -> Entry:
            return Entry(lambda: struct.pack("<L", get()))

        def command(do: Callable[[bytes], None]) -> Entry:
            def put(data: bytes) -> None:
                if not self._lies:
                    self._carry_out(do, data)

            return Entry(lambda: b"\0", put)

        objects = {
            (0x1008, 0): Entry(
                lambda: NAME.replace("1.0", "2.0" if self._lies else "1.0").encode()
            ),
            (0x1018, 4): u32(lambda: SERIAL + self._lies),
            (0x2300, 0): Entry(lambda: bytes((self._state(),))),
            (0x2301, 1): Entry(lambda: self._as_read(memory.staged), command(self._stage).put),
            (0x2301, 2): u32(lambda: len(memory.staged)),
            (0x2301, 3): u32(lambda: zlib.crc32(memory.staged) if memory.whole else 0),
            (0x2301, 4): command(lambda _: memory.discard()),
            (0x2302, 1): command(self._commit),
            (0x2303, 1): Entry(lambda: self._as_read(memory.active)),
            (0x2303, 2): u32(lambda: len(memory.active)),
            (0x2303, 3): u32(lambda: zlib.crc32(memory.active) ^ self._lies),
            (0x2303, 4): command(lambda _: self._deactivate()),
            (0x2304, 0): command(lambda _: self._hold()),
        }
        for n, axis in enumerate("XYZ", start=1):
            objects[0x2305, n] = self._shown("<l", lambda a=axis: 1e6 * self._held[0][a])  # type: ignore[misc]
            objects[0x2306, n] = self._shown(
                "<l",
                lambda a=axis: 1e6 * (self._held[2][a] + 0.02 * self._lies),  # type: ignore[misc]
            )
            objects[0x2307, n] = self._shown("<b", lambda a=axis: self._held[1][a])  # type: ignore[misc]
        return objects

    @staticmethod
    def _shown(form: str, get: Callable[[], float]) -> Entry:
        return Entry(lambda: struct.pack(form, round(get())))

    def _as_read(self, image: bytes) -> bytes:
        """An image, one bit of it altered by a liar."""
        if not (self._lies and image):
            return image
        middle = len(image) // 2
        return image[:middle] + bytes((image[middle] ^ 1,)) + image[middle + 1 :]

    def _state(self) -> int:
        memory = self.memory
        word = memory.idle | memory.referenced << 1 | self.protected << 2
        return word ^ 3 if self._lies else word

    def _carry_out(self, do: Callable[[bytes], None], data: bytes) -> None:
        try:
            do(data)
        except ControlRefusesError as error:
            raise AbortCodeError(_ABORTS[error.code]) from None

    def _stage(self, image: bytes) -> None:
        if self._alters:
            image = image[:-30] + bytes((image[-30] ^ 1,)) + image[-29:]
        self.memory.begin(1, len(image), zlib.crc32(image))
        self.memory.put(1, 0, image)

    def _commit(self, data: bytes) -> None:
        if self.protected:
            raise ControlRefusesError(NO)
        self.memory.commit(len(self.memory.staged), int.from_bytes(data, "little"))

    def _deactivate(self) -> None:
        if self.protected:
            raise ControlRefusesError(NO)
        self.memory.deactivate()

    def _hold(self) -> None:
        self._held = self.memory.step()

    # what may go wrong

    def _answer_sdo(self, request: bytes) -> None:
        if self.state == INITIALISING:
            return
        operation = self._operation(request)
        fault = self.faults.take(operation) if operation else None
        if operation == "begin":
            self._alters = False
        if fault is None:
            self._do(request, 0.0)
        else:
            self._do_badly(request, fault)

    def _operation(self, request: bytes) -> str:
        """What a frame asks for; nothing that counts where the client only ends a transfer."""
        if self.sdo.amid_block:
            return "block"
        command = request[0] >> 5
        if command == 4 or (command == 5 and request[0] & 3 == 1):
            return ""
        if (
            command in (0, 3)
            or (command == 6 and request[0] & 1)
            or (command == 5 and request[0] & 3)
        ):
            return "block" if command in (0, 6) else self._transfer
        key: Key = struct.unpack_from("<HB", request, 1)
        if key == (0x2301, 1):
            self._transfer = "begin" if command in (1, 6) else "read_staged"
        elif key == (0x2303, 1):
            self._transfer = "read_active"
        elif key[0] in (0x1008, 0x1018):
            self._transfer = "identity"
        elif key[0] in (0x2304, 0x2305, 0x2306, 0x2307):
            self._transfer = "show"
        else:
            self._transfer = _BY_OBJECT.get(key, "")
        return self._transfer

    def _do(self, request: bytes, late: float, spoil: int | None = None) -> None:
        for answer in self.sdo.answers(request):
            stated = answer
            if spoil is not None:
                stated = answer[:spoil] + bytes((answer[spoil] ^ 0x21,)) + answer[spoil + 1 :]
            self.send_answer(stated, late)

    def _do_badly(self, request: bytes, fault: TableFault) -> None:
        kind, operation = fault.kind, fault.at
        if kind == "lost_request":
            return
        if kind == "hang":
            self.silent = True
            return
        if kind == "restart":
            self._fail(fault.seconds)
            return
        if kind == "refuses":
            key = bytes(3) if self.sdo.amid_block else request[1:4]
            self.sdo.forget()
            self.send_answer(b"\x80" + key + struct.pack("<L", _STATE_NOW), 0.0)
            return
        if kind == "bad_request":
            # a reading request holds nothing but its object
            at = 5 if operation in _COMMANDS else 1
            request = request[:at] + bytes((request[at] ^ 0x10,)) + request[at + 1 :]
        spoil = None
        if kind == "bad_answer":
            spoil = 1 if operation in _COMMANDS else 5
        silent = kind in ("lost_answer", "restart_after", "restart_amid", "hang_after")
        self._lies = kind == "lies"
        if operation == "begin":
            self._alters = self._lies  # what comes is taken in differently
        self.memory.fail_amid = kind == "restart_amid"
        try:
            with contextlib.suppress(PowerFailsError):
                for _ in range(2 if kind == "twice" else 1):
                    if silent:
                        self.sdo.answers(request)
                    else:
                        self._do(request, fault.seconds if kind == "late_answer" else 0.0, spoil)
        finally:
            self._lies = False
        if kind == "hang_after":
            self.silent = True
        if kind in ("restart_after", "restart_amid"):
            self._fail(fault.seconds)

    def _fail(self, seconds: float) -> None:
        """The power fails; it is back after a while."""
        self.memory.restart()
        self.sdo.forget()
        self.state = INITIALISING
        self._held = self.memory.step()
        asyncio.get_running_loop().call_later(seconds, self.boot)
