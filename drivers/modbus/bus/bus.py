"""The one owner of a Modbus bus: requests to its units, and how a connection begins.

Who has the turn may ask one request after another. A request that is cancelled or unanswered
leaves nothing behind that could pass for the next one's answer.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Sequence

from abbe.drivers.bus_lock import BusLock
from abbe.drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkStatus,
    LinkTimeoutError,
    TooLateError,
)
from abbe.drivers.modbus.bus.client import ModbusClient
from abbe.drivers.modbus.bus.refusals import GatewayError, ModbusExceptionError
from abbe.drivers.modbus.bus.units import Unit, units_of
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.plan import Span
from abbe.drivers.quarantine import MemberHealth
from abbe.drivers.reconnect import Reconnector

logger = logging.getLogger("abbe.drivers.modbus")


class Bus:
    """One Modbus bus; ``async with bus.bus_lock:`` reserves it.

    Parameters
    ----------
    name
        The link's name, for the log.
    config
        The link's section.
    status
        Kept up to date.
    """

    def __init__(self, name: str, config: ModbusConfig, status: LinkStatus) -> None:
        self._config = config
        self.status = status
        self.units = units_of(config)
        self.reconnector = Reconnector(
            f"link {name} ({config.where})",
            config,
            status,
            self._connect,
            lambda: self.client.close(),
            logger,
            lambda: self._health.renew(),
        )
        self.bus_lock = BusLock(self.reconnector, config.max_waiting)
        self.client = ModbusClient(config, self.reconnector.lost)
        self._health = MemberHealth(self.units.values(), config, self.reconnector, logger, "unit")

    # Requests, to be made in a turn

    async def read(self, span: Span) -> bytes:
        """Read registers or bits as bytes, making sure first that no late reply can pass for them.

        Raises
        ------
        LinkDownError, LinkTimeoutError, LinkProtocolError
            As in `abbe.drivers.modbus.bus.client.ModbusClient.read`.
        """
        unit = self.units[span.unit]
        if unit.pending:
            await self._resynchronise(unit)
        return await self._exchange(unit, span)

    async def write(self, span: Span, values: Sequence[int], until: float = math.inf) -> None:
        """Write registers or bits, unless it is later than `until` (monotonic, s) by then.

        Raises
        ------
        TooLateError
            When it was; nothing was sent.
        LinkDownError, LinkTimeoutError, LinkProtocolError
            As `read`.
        """
        unit = self.units[span.unit]
        if unit.pending:
            await self._resynchronise(unit)
        await self._exchange(unit, span, values, until)

    async def _exchange(
        self,
        unit: Unit,
        span: Span,
        values: Sequence[int] | None = None,
        until: float = math.inf,
    ) -> bytes:
        client, status = self.client, self.status
        status.requests += 1
        unit.asked = True
        answer = b""
        try:
            if values is None:
                answer = await client.read(span)
            else:
                await client.write(span, values, until)
        except TooLateError:
            raise
        except LinkProtocolError:
            status.failures += 1
            self._health.answered(unit)
            raise
        except LinkTimeoutError as exc:
            status.failures += 1
            self._expect_late(unit, span, write=values is not None)
            self._health.unanswered(unit, str(exc), bus_silent=not isinstance(exc, GatewayError))
            raise
        except LinkDownError as exc:
            status.failures += 1
            self.reconnector.lost(str(exc))
            raise
        except asyncio.CancelledError:
            self._expect_late(unit, span, write=values is not None)
            raise
        status.round_trip = client.round_trip
        self._health.silent_in_a_row = 0
        if unit.failures:
            self._health.answered(unit)
        return answer

    # Late replies (RTU)

    def _expect_late(self, unit: Unit, span: Span, *, write: bool) -> None:
        # TCP has transaction numbers; there a late reply is recognised by its own.
        if self._config.transport == "rtu":
            unit.expect_late(span.confirmation if write else span.answer, time.monotonic())

    async def _resynchronise(self, unit: Unit) -> None:
        """Ask what no late reply can pass for the answer to, or wait until none can come.

        Raises
        ------
        LinkTimeoutError
            When it is not certain yet; the unit is not to be believed.
        """
        late_max = self._config.late_reply_max
        unit.forget_late(time.monotonic(), late_max)
        if not unit.pending:
            return
        probe = unit.probe()
        if probe is not None:
            try:
                await self._exchange(unit, probe)
                unit.pending.clear()
                return
            except ModbusExceptionError:
                function = probe.answer[0]
                if all(reply[0] != function for reply in unit.pending):
                    unit.pending.clear()
                    return
                # The refusal may itself be the late one; then the probe's is still to come.
                self._expect_late(unit, probe, write=False)
        unit.failures = max(unit.failures, 1)
        unit.retry_at = unit.clear_at(late_max)
        unit.why = f"unit {unit.number} may still send a late reply"
        raise LinkTimeoutError(unit.why)

    # Connecting

    async def _connect(self) -> None:
        """Connect and get a first answer: a device that accepts and says nothing is not up.

        Raises
        ------
        LinkError
            When there is no connection or no unit answers on it.
        """
        async with self.bus_lock.lock:
            await self.client.connect()
            await self._first_answer()

    async def _first_answer(self) -> None:
        """Ask the units in turn, those that answered last first, until one answers."""
        error: LinkError = LinkTimeoutError("no unit answers")
        for unit in sorted(self.units.values(), key=lambda u: u.failures):
            probe = unit.probe()
            span = probe or unit.probes[0]
            try:
                await self._exchange(unit, span)
            except LinkTimeoutError as exc:
                error = exc
                continue
            except LinkProtocolError:
                probe = None
            if probe is not None:
                unit.pending.clear()
            elif unit.pending:
                # A late reply may have answered; then the true one is still to come.
                self._expect_late(unit, span, write=False)
            return
        raise LinkTimeoutError(f"connected, and no unit answers: {error}")
