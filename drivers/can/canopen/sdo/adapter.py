"""Adapter of the canopen package: SDO, NMT, emergencies; raises nothing but `LinkError`.

What canopen 2.4.1 does by itself, and what is done about it here:

- It receives with python-can's `Notifier` and its thread. Here `Network.notify` is fed by
  `abbe.drivers.can.bus`, whose errors are seen.
- An SDO answer that comes late passes for the answer to the next request for the same object. After
  a request that went unanswered, the device type (1000h) is asked for first, until its answer is
  there: a node answers in turn, so nothing older can come then.
- Block transfers that break: `abbe.drivers.can.canopen.sdo.blocks`.
- A frame that is too short (altered on a serial line) makes it raise `struct.error`.
"""

from __future__ import annotations

import contextlib
import math
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import can
import canopen

from abbe.drivers.can.bus import CanBus
from abbe.drivers.can.canopen.sdo.blocks import Done, receive_block, send_block
from abbe.drivers.can.canopen.sdo.errors import SdoAbortError, TooLongError
from abbe.drivers.can.canopen.sdo.expedited import Ask, Expedited
from abbe.drivers.can.frames import frame
from abbe.drivers.link import LinkDownError, LinkError, LinkTimeoutError, TooLateError

DEVICE_TYPE = 0x1000
_ABORT_GENERAL = 0x08000000
_NO_SUCH_COMMAND = 0x05040001
_PROBES = 3
"""Answers to something else that are passed over before a node counts as silent."""


class _Feed(canopen.Network):
    """canopen's network with our bus under it."""

    def __init__(self, bus: CanBus) -> None:
        super().__init__()
        self._abbe_bus = bus

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame from a worker's thread."""
        self._abbe_bus.send_and_wait(frame(can_id, data, remote=remote))


class Network:
    """The canopen package's network on a bus of ours.

    Parameters
    ----------
    bus
        Where frames go.
    timeout
        s for an SDO answer.

    Attributes
    ----------
    arrived, latest
        The earliest and the latest moment at which the frame can have come that is being taken in
        (monotonic, s).
    """

    def __init__(self, bus: CanBus, timeout: float) -> None:
        self.arrived = self.latest = 0.0
        self._feed = _Feed(bus)
        self._expedited = Expedited(bus)
        self._timeout = timeout
        self._subscribed: dict[int, Callable[[bytes], None]] = {}
        self._sdo: dict[int, Any] = {}
        """SDO clients, which canopen leaves without types."""
        self._doubtful: set[int] = set()
        """Nodes from which a late answer may come."""

    def add(self, number: int, on_emergency: Callable[[int, int, str], None]) -> None:
        """Make a node known.

        Parameters
        ----------
        number
            Its id.
        on_emergency
            Called with error code, error register and what the code means.
        """
        dictionary: Any = canopen.ObjectDictionary
        node = canopen.RemoteNode(number, dictionary())
        self._sdo[number] = node.sdo
        node.sdo.RESPONSE_TIMEOUT = self._timeout
        self._feed.add_node(node)
        node.emcy.add_callback(
            lambda message: on_emergency(message.code, message.register, message.get_desc())
        )

    def subscribe(self, can_id: int, callback: Callable[[bytes], None]) -> None:
        """Have a function called with the data of every frame of an id; one per id."""
        self._subscribed[can_id] = callback

    def listen(self, can_id: int, callback: Callable[[bytes], None]) -> None:
        """Have a function called beside what canopen itself does with that id."""
        self._feed.subscribe(can_id, lambda _, data, __: callback(bytes(data)))

    def notify(self, message: can.Message, arrived: float, latest: float) -> None:
        """Take a frame in, from the event loop."""
        self.arrived, self.latest = arrived, latest
        can_id = message.arbitration_id
        if (callback := self._subscribed.get(can_id)) is not None:
            callback(bytes(message.data))
        # canopen would keep answers that it did not ask for
        elif not self._expedited.take(can_id, message.data):
            self._feed.notify(can_id, message.data, message.timestamp)

    async def ask(self, asked: Sequence[Ask], until: float = math.inf) -> list[LinkError | bytes]:
        """Read or write short objects of several nodes at once, from the event loop.

        Parameters
        ----------
        asked
            At most one for each node.
        until
            Monotonic time in s after which they are not sent.

        Returns
        -------
        What was read (or written), or why it was not: `TooLongError`, `SdoAbortError`,
        `LinkTimeoutError`, `TooLateError`.

        Raises
        ------
        LinkDownError
            When the bus is gone.
        """
        doubtful = [Ask(one.number, DEVICE_TYPE, 0) for one in asked if self._doubts(one)]
        if doubtful:
            await self._ask(doubtful)
        certain = [one for one in asked if not self._doubts(one)]
        if time.monotonic() > until:
            late = TooLateError("too old before it could be sent, so not sent")
            return [late for _ in asked]
        if certain:
            await self._ask(certain)
        return [self._result(one) for one in asked]

    def fail(self, error: Exception) -> None:
        """End a wait with an error."""
        self._expedited.fail(error)

    def _doubts(self, one: Ask) -> bool:
        return one.number in self._doubtful

    async def _ask(self, asked: Sequence[Ask]) -> None:
        numbers = {one.number for one in asked}
        # whatever ends the wait, also a cancellation: who has not answered may still do so
        self._doubtful |= numbers
        try:
            await self._expedited.ask(asked, self._timeout)
        finally:
            self._doubtful -= {one.number for one in asked if one.done}

    def _result(self, one: Ask) -> LinkError | bytes:
        what = f"{one.index:04X}h:{one.subindex:02X} of node {one.number}"
        if one.answer is not None:
            return one.answer
        if one.too_long:
            return TooLongError(f"{what}: longer than four bytes")
        if one.aborted is not None:
            error = canopen.SdoAbortedError(one.aborted)
            return SdoAbortError(f"{what}: refused, {error}", one.aborted)
        return LinkTimeoutError(f"{what}: no answer in {self._timeout:g} s")

    # From threads, one at a time for each node

    def upload(self, number: int, index: int, subindex: int) -> bytes:
        """Read an object.

        Raises
        ------
        SdoAbortError
            When the node refuses.
        LinkTimeoutError
            When it does not answer.
        LinkDownError
            When the interface is gone.
        """
        with self._errors(number, index, subindex):
            self._resynchronise(number)
            try:
                return bytes(self._sdo[number].upload(index, subindex))
            except canopen.SdoCommunicationError as error:
                if "No SDO response" in str(error):
                    raise
            # it answers something older, or is amid a transfer of somebody who has gone
            self._doubtful.add(number)
            self._resynchronise(number)
            return bytes(self._sdo[number].upload(index, subindex))

    def download(self, number: int, index: int, subindex: int, data: bytes) -> None:
        """Write an object; raises as `upload`. After a time-out it may or may not be written."""
        with self._errors(number, index, subindex):
            self._resynchronise(number)
            self._sdo[number].download(index, subindex, data)

    def upload_block(
        self, number: int, index: int, subindex: int, progress: Done | None = None
    ) -> bytes:
        """Read a long object by block transfer, or in segments where the node has none.

        Parameters
        ----------
        number, index, subindex
            Which.
        progress
            Called now and then with how many bytes are here, in this thread.

        Raises
        ------
        SdoAbortError, LinkTimeoutError, LinkDownError
            As `upload`; the node was told to abort.
        """
        with self._errors(number, index, subindex):
            self._resynchronise(number)
            sdo = self._sdo[number]
            try:
                stream = sdo.open(index, subindex, "rb", buffering=0, block_transfer=True)
            except canopen.SdoAbortedError as error:
                if error.code != _NO_SUCH_COMMAND:
                    raise
                return bytes(sdo.upload(index, subindex))
            return receive_block(sdo, stream, progress)

    def download_block(
        self,
        number: int,
        index: int,
        subindex: int,
        data: bytes,
        progress: Done | None = None,
    ) -> bool:
        """Write a long object by block transfer, checked by its CRC.

        Parameters
        ----------
        number, index, subindex, data
            Where, and what.
        progress
            Called now and then with how many bytes were sent, in this thread.

        Returns
        -------
        Whether the node can: where it refuses block transfers, it was sent in segments.

        Raises
        ------
        SdoAbortError, LinkTimeoutError, LinkDownError
            As `upload`; the node was told to abort.
        """
        with self._errors(number, index, subindex):
            self._resynchronise(number)
            try:
                send_block(self._sdo[number], index, subindex, data, progress)
            except canopen.SdoAbortedError as error:
                if error.code != _NO_SUCH_COMMAND:
                    raise
            else:
                return True
            self._sdo[number].download(index, subindex, data, force_segment=True)
            return False

    def _resynchronise(self, number: int) -> None:
        """Make sure that no transfer is under way and no answer of an earlier request comes."""
        if number not in self._doubtful:
            return
        for _ in range(_PROBES):
            self._sdo[number].abort(_ABORT_GENERAL)
            try:
                self._sdo[number].upload(DEVICE_TYPE, 0)
            except canopen.SdoCommunicationError as error:
                if "No SDO response" in str(error):
                    raise
                continue
            self._doubtful.discard(number)
            return
        raise canopen.SdoCommunicationError("it answers something else")

    @contextlib.contextmanager
    def _errors(self, number: int, index: int, subindex: int) -> Iterator[None]:
        """Tell canopen's and python-can's errors in ours."""
        what = f"{index:04X}h:{subindex:02X} of node {number}"
        try:
            yield
        except canopen.SdoAbortedError as error:
            raise SdoAbortError(f"{what}: refused, {error}", error.code) from error
        except canopen.SdoCommunicationError as error:
            self._doubtful.add(number)
            if "No SDO response" in str(error):
                why = f"no answer in {self._timeout:g} s"
            else:
                why = str(error)
            raise LinkTimeoutError(f"{what}: {why}") from error
        except (RuntimeError, struct.error) as error:
            self._doubtful.add(number)
            raise LinkTimeoutError(f"{what}: segments were lost ({error})") from error
        except can.CanError as error:
            raise LinkDownError(f"cannot send: {error}") from error
