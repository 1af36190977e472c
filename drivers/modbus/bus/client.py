"""Adapter of pymodbus: one connection, one request at a time, every answer checked.

With `abbe.drivers.modbus.bus.framing` the only file of the drivers that imports pymodbus, besides
the simulated server; both are written for the pinned version and reach into its transaction context
where the public interface has no way to do what is needed. What pymodbus 3.16.1 does by itself, and
what is done about it here:

- Its RTU client takes any frame of the right unit for the answer: a reply that comes late is
  handed to the next request, a wrong position without an error. `StrictRtuFramer` lets through
  only a frame that can answer the request in flight; `abbe.drivers.modbus.bus.units` has the other
  half.
- On TCP it accepts transaction id 0 for any request, and it drops the first half of a late reply
  that arrives in two pieces, so that the second half is parsed as a header. `StrictTcpFramer`
  refuses id 0; a connection with half a frame in its buffer is closed.
- It checks neither the function code nor the number of registers of an answer, nor the echo of
  a write. `ModbusClient` does.
- It raises some errors and returns others. `ModbusClient` raises, and only `LinkError`.
- Its defaults (time-out 3 s, 3 retries, reconnecting up to 300 s apart, a dead connection
  dropped after eight failed calls) block for seconds to minutes. All are set here; retries and
  reconnecting are `abbe.drivers.modbus.bus.bus`'s.
- It lets a request wait for its time-out when the connection is lost meanwhile. Here it fails
  at once.
"""

from __future__ import annotations

import asyncio
import logging
import math
import termios
import time
from collections.abc import Callable, Sequence

from pymodbus import FramerType
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.bit_message import (
    ReadCoilsRequest,
    ReadDiscreteInputsRequest,
    WriteMultipleCoilsRequest,
    WriteSingleCoilRequest,
)
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteSingleRegisterRequest,
)
from pymodbus.transaction import TransactionManager

from abbe.compcore.units import in_digits
from abbe.drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkTimeoutError,
    TooLateError,
)
from abbe.drivers.modbus.bus.buffers import cut_off, give_up_after, unsent
from abbe.drivers.modbus.bus.framing import (
    Answer,
    Confirmed,
    RegistersRequest,
    StrictRtuFramer,
    StrictTcpFramer,
    decoder,
)
from abbe.drivers.modbus.bus.refusals import refusal
from abbe.drivers.modbus.config import ModbusConfig, Table
from abbe.drivers.modbus.plan import Span
from abbe.drivers.wait_limit import WaitLimit

_Client = AsyncModbusTcpClient | AsyncModbusSerialClient

_READ: dict[Table, Callable[..., ModbusPDU]] = {
    "coil": ReadCoilsRequest,
    "discrete": ReadDiscreteInputsRequest,
    "holding": ReadHoldingRegistersRequest,
    "input": ReadInputRegistersRequest,
}

_NEVER = 1 << 30
_CONNECT_TIMEOUT = 1.0
"""Least time in s for a TCP connection; nobody waits for it but the first `connect`."""
_RTU_EXTRA = 13
"""Characters of a request and its answer beside function code and data: two units, two CRCs, two
silences of 3.5 characters."""

# pymodbus logs every lost request at error level; here an outage is logged once, by the bus.
# Whoever wants its frames sets this logger's level before importing.
_pymodbus_logger = logging.getLogger("pymodbus.logging")
if _pymodbus_logger.level == logging.NOTSET:
    _pymodbus_logger.setLevel(logging.CRITICAL)


class ModbusClient:
    """One connection to one bus.

    Parameters
    ----------
    config
        The link's section.
    on_lost
        Called with the reason when the connection is lost, whether or not a request is in flight;
        not when it is closed by `close`.
    """

    def __init__(self, config: ModbusConfig, on_lost: Callable[[str], None]) -> None:
        self._config = config
        self._on_lost = on_lost
        self._pymodbus: _Client | None = None
        self._rtu_framer: StrictRtuFramer | None = None
        self._tcp_framer: StrictTcpFramer | None = None
        self._answer: asyncio.Future[ModbusPDU] | None = None
        self._wait_limit = WaitLimit(_expire)
        # the request of the last read: a live cycle asks for the same again and again
        self._asked: Span | None = None
        self._question = ModbusPDU()
        self.asked_at = time.monotonic()
        """`time.monotonic()` in s just before the last request was sent."""
        self.answered_at = time.monotonic()
        """`time.monotonic()` in s of the last frame received or given up."""
        self.round_trip = float("nan")
        """s from sending the last request to its answer."""

    async def connect(self) -> None:
        """Open the connection, an old one is closed.

        Raises
        ------
        LinkDownError
            With the operating system's reason.
        """
        self.close()
        config = self._config
        client: _Client
        if config.transport == "tcp":
            client = AsyncModbusTcpClient(
                str(config.host),
                port=int(config.port),
                timeout=config.timeout,
                retries=0,
                reconnect_delay=0,
                trace_connect=self._on_connect,
            )
            client.ctx.framer = self._tcp_framer = StrictTcpFramer(decoder())
            received = self._receiver(client.ctx, self._tcp_framer)
            client.ctx.data_received = received  # type: ignore[assignment,method-assign]
        else:
            client = AsyncModbusSerialClient(
                str(config.port),
                framer=FramerType.RTU,
                baudrate=config.baudrate,
                bytesize=config.bytesize,
                parity=config.parity,
                stopbits=config.stopbits,
                handle_local_echo=config.local_echo,
                timeout=config.timeout,
                retries=0,
                reconnect_delay=0,
                trace_connect=self._on_connect,
            )
            self._rtu_framer = StrictRtuFramer(decoder())
            client.ctx.framer = self._rtu_framer
            client.ctx.max_buffer_size = StrictRtuFramer.MAX_SIZE
        client.set_max_no_responses(_NEVER)
        try:
            # pymodbus's connect() does this, and keeps the reason of a failure to itself.
            client.ctx.transport, _ = await asyncio.wait_for(
                client.ctx.call_create(), max(config.timeout, _CONNECT_TIMEOUT)
            )
        except TimeoutError as exc:
            raise LinkDownError(f"{config.where} accepts no connection") from exc
        except (OSError, ValueError, termios.error) as exc:
            raise LinkDownError(f"cannot open {config.where}: {exc}") from exc
        self._pymodbus = client
        if config.transport == "tcp":
            give_up_after(client, config.timeout)

    def close(self, *, at_once: bool = False) -> None:
        """Close the connection; a request in flight fails at once.

        `at_once`: also what is still in the operating system's buffer is given up.
        """
        client, self._pymodbus = self._pymodbus, None
        if client is not None:
            if at_once:
                cut_off(client)
            client.close()
            self._fail_request()

    async def read(self, span: Span) -> bytes:
        """Read registers (two bytes each, high byte first) or bits (eight to a byte, low first).

        Raises
        ------
        LinkDownError, LinkTimeoutError, LinkProtocolError
            As in `abbe.drivers.link`; `GatewayError` and `RefusedError` among them.
        """
        if span is not self._asked:
            self._asked = span
            self._question = _READ[span.table](
                address=span.address, count=span.count, dev_id=span.unit
            )
        head, request = span.answer, self._question
        answer = await self._execute(request, span, head, 2 + head[1])
        if type(answer) is Confirmed:
            return answer.payload
        payload: bytes = answer.payload if isinstance(answer, Answer) else b""
        if len(payload) != head[1]:
            raise LinkProtocolError(
                f"{span}: {len(payload)} bytes came in answer, {head[1]} were asked"
            )
        return payload

    async def write(self, span: Span, values: Sequence[int], until: float = math.inf) -> None:
        """Write registers (holding) or bits (coil); one goes by function 6 or 5, more by 16 or 15.

        Nothing leaves after `until` (monotonic, s), also not from the operating system's buffers:
        a TCP connection that has not passed all of an unanswered write on is cut off.

        Raises
        ------
        LinkDownError, LinkTimeoutError, LinkProtocolError
            As in `read`. After a `LinkTimeoutError` it is unknown whether the device took it.
        TooLateError
            When it is later than `until` before anything is sent.
        """
        request: ModbusPDU
        at, unit = span.address, span.unit
        if span.table == "coil":
            bits = [bool(value) for value in values]
            request = (
                WriteSingleCoilRequest(address=at, bits=bits, dev_id=unit)
                if span.count == 1
                else WriteMultipleCoilsRequest(address=at, bits=bits, dev_id=unit)
            )
        elif span.count == 1:
            request = WriteSingleRegisterRequest(address=at, registers=values, dev_id=unit)
        else:
            request = RegistersRequest(address=at, registers=values, dev_id=unit)
        head = span.confirmation
        echo = b""
        if span.count == 1:
            word = 0xFF00 * bool(values[0]) if span.table == "coil" else int(values[0])
            echo = word.to_bytes(2, "big")
        reply = await self._execute(request, span, head, 5, echo, until)
        if type(reply) is Confirmed:
            return
        if span.count > 1:
            stated, expected = (reply.address, reply.count), (at, span.count)
        elif span.table == "coil":
            stated, expected = (reply.address, int(reply.bits[0])), (at, int(values[0]))
        else:
            stated, expected = (reply.address, reply.registers[0]), (at, values[0])
        if stated != expected:
            raise LinkProtocolError(f"write {span}: confirmed {stated}, expected {expected}")

    async def _execute(
        self,
        request: ModbusPDU,
        span: Span,
        head: bytes,
        size: int,
        echo: bytes = b"",
        until: float = math.inf,
    ) -> ModbusPDU:
        """Send and wait; the answer begins with `head` (function first), is of `size` bytes.

        `echo`: how a good answer goes on.
        """
        config = self._config
        limit = config.timeout
        if self._rtu_framer is not None:
            wait = self.answered_at + config.silence - time.monotonic()
            if wait > 0:
                await asyncio.sleep(wait)
        client = self._pymodbus
        if client is None or not client.connected:
            raise LinkDownError("the connection is closed")
        context = client.ctx
        if self._rtu_framer is not None:
            self._rtu_framer.expect(span.unit, head, size)
            sent = len(request.encode()) + 1
            limit += (sent + size + _RTU_EXTRA) * config.character_time
        elif context.recv_buffer:
            raise self._out_of_step(client)
        request.transaction_id = context.getNextTID()
        if self._tcp_framer is not None:
            self._tcp_framer.expect(request.transaction_id, span.unit, head + echo, size)
        self.asked_at = began = time.monotonic()
        if began > until:
            raise TooLateError("too old before it could be sent, so not sent")
        try:
            # in place of pymodbus's execute, which goes round the event loop once more for its
            # time-out, has the retries, and does not notice the loss of the connection
            answer: asyncio.Future[ModbusPDU] = asyncio.get_running_loop().create_future()
            context.response_future = self._answer = answer
            self._wait_limit.begin(answer, limit)
            context.pdu_send(request)
            reply = await answer
        except LinkDownError:
            raise
        except TimeoutError as exc:
            raise self._no_answer(client, span, limit) from exc
        except OSError as exc:
            raise LinkDownError(f"cannot send on {config.where}: {exc}") from exc
        finally:
            self._wait_limit.end()
            self.answered_at = time.monotonic()
        self.round_trip = self.answered_at - began
        if type(reply) is Confirmed:
            return reply
        if reply.isError():
            raise refusal(str(span), reply.exception_code)
        if reply.function_code != request.function_code:
            raise LinkProtocolError(
                f"{span}: function {reply.function_code} answered, "
                f"function {request.function_code} was asked"
            )
        return reply

    def _no_answer(self, client: _Client, span: Span, limit: float) -> LinkError:
        """The error of a request not answered in `limit` s; a connection out of step is closed."""
        strange = len(client.ctx.recv_buffer)
        if strange and self._rtu_framer is None:
            return self._out_of_step(client)
        if unsent(client):
            # what is still in the buffer would be delivered whenever the network comes back
            self.close(at_once=True)
            return LinkDownError(
                f"the request did not reach {self._config.where} in {in_digits(limit)} s"
            )
        more = f" ({strange} bytes came that answer something else)" if strange else ""
        return LinkTimeoutError(f"no answer from unit {span.unit} in {in_digits(limit)} s{more}")

    def _receiver(
        self, context: TransactionManager, framer: StrictTcpFramer
    ) -> Callable[[bytes], None]:
        """What takes a TCP connection's bytes: the expected answer at once, all else as pymodbus.

        Nearly every answer comes whole and alone; on pymodbus's way it is copied four times.
        """
        otherwise = context.data_received

        def received(data: bytes) -> None:
            answer = self._answer
            if not context.recv_buffer and answer is not None and not answer.done():
                found = framer.expected(data)
                if found is not None:
                    answer.set_result(found)
                    return
            otherwise(data)

        return received

    def _out_of_step(self, client: _Client) -> LinkDownError:
        """Close a connection whose byte stream cannot be followed any more; the error to raise."""
        count = len(client.ctx.recv_buffer)
        self.close()
        return LinkDownError(f"half a frame came ({count} bytes): out of step")

    def _on_connect(self, connected: bool) -> None:
        client = self._pymodbus
        if connected or client is None:
            return
        self._pymodbus = None
        self._fail_request()
        self._on_lost("the connection was closed by the other side")

    def _fail_request(self) -> None:
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(LinkDownError("the connection was lost"))


def _expire(answer: asyncio.Future[ModbusPDU]) -> None:
    answer.set_exception(TimeoutError())
