"""An I++ DME server: sessions, tags, the error state, move reports, and faults on order.

Written from the standard's text (1.4.3) and apart from `abbe.drivers.ipp`, so that one checks the
other.
Commands are carried out one after another; those whose names end in E overtake the rest and are
carried out in the error state, too.
"""

from __future__ import annotations

import asyncio
import math
import re
import time
from collections import deque
from collections.abc import Callable, Sequence

from abbe.drivers.simulated.ipp.carrier import ProbeCarrier
from abbe.drivers.simulated.ipp.machine import IppMachine, ScaleSensorError, UnknownError
from abbe.drivers.simulated.ipp.wire import (
    IppCommandError,
    IppFaults,
    error_line,
    named_arguments,
    shown,
)

_LINE = re.compile(r"(\d{5}|E\d{4}) ([A-Za-z]\w*)\((.*)\)\s*")
_MOTIONS = ("GoTo", "PtMeas")
_PACE = 0.005
"""s between two looks whether a move is to be reported."""
_LEAST_TIME = 0.1
"""s: shorter pauses between reports are refused."""


class IppConnection(asyncio.Protocol):
    """One client."""

    def __init__(self, server: IppServer) -> None:
        self._server = server
        self._transport: asyncio.Transport | None = None
        self._held = b""
        self._session = False
        self._stopped = False
        self._behind: deque[str] = deque()
        """Commands that wait for the machine to come where it is sent."""
        self._motion: asyncio.Task[None] | None = None
        self._reports: dict[str, asyncio.Task[None]] = {}

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a client, or turn it away."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101
        self._transport = transport
        if len(self._server.connections) >= self._server.seats:
            self._server.turned_away += 1
            transport.abort()
            return
        self._server.connections.append(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """End its reports, and stop the machine where it is on the way for this client."""
        if self in self._server.connections:
            self._server.connections.remove(self)
        self._end_reports()
        self._abort()

    def data_received(self, data: bytes) -> None:
        """Carry out the commands that the bytes complete."""
        *lines, self._held = (self._held + data).split(b"\r\n")
        for line in lines:
            self._carry_out(line.decode("latin-1"))

    def say(self, text: str) -> None:
        """Send text as it is."""
        if self._transport is None or time.monotonic() < self._server.faults.silent_until:
            return
        data = text.encode("latin-1")
        if not self._server.faults.split:
            self._transport.write(data)
            return
        for i in range(len(data)):
            asyncio.get_running_loop().call_later(1e-4 * i, self._transport.write, data[i : i + 1])

    def stop(self) -> None:
        """Enter the error state."""
        self._stopped = True

    def clear(self) -> None:
        """Leave the error state, as when somebody cleared it at the machine."""
        self._stopped = False

    def drop(self) -> None:
        """Close the connection at once."""
        if self._transport is not None:
            self._transport.abort()

    def _carry_out(self, line: str) -> None:
        server, faults = self._server, self._server.faults
        found = _LINE.fullmatch(line)
        if found is None:
            tag = line[:5] if re.fullmatch(r"\d{5}|E\d{4}", line[:5]) else "E0000"
            self.say(f'{tag} ! Error(2, 0001, "", "Illegal tag")\r\n{tag} %\r\n')
            return
        tag, method, arguments = found.groups()
        if self._motion is not None and not method.endswith("E"):
            self._behind.append(line)
            return
        server.commands.append(f"{method}({arguments})")
        if method in _MOTIONS and self._session and not self._stopped:
            self.say(f"{tag} &\r\n")
            self._motion = asyncio.ensure_future(self._move(tag, method, arguments))
            return
        answer = [] if faults.untaken > 0 else [f"{tag} &"]
        faults.untaken = max(0, faults.untaken - 1)
        try:
            data = self._result(tag, method, arguments)
            if faults.bare > 0:
                faults.bare -= 1
            else:
                answer += [f"{tag} # {text}" for text in data]
        except IppCommandError as error:
            self._stopped = self._stopped or error.severity >= 2
            answer.append(error_line(tag, error.severity, error.number, method, error.text))
        if faults.incomplete > 0:
            faults.incomplete -= 1
        else:
            answer.append(f"{tag} %")
        text = faults.garbage + "".join(f"{part}\r\n" for part in answer)
        if faults.late > 0:
            faults.late -= 1
            asyncio.get_running_loop().call_later(faults.lateness, self.say, text)
        else:
            self.say(text)

    async def _move(self, tag: str, method: str, arguments: str) -> None:
        """Carry out a command that takes the machine somewhere, then what waits behind it."""
        try:
            text = await self._server.carrier.carry_out(method, arguments)
            answer = "" if text is None else f"{tag} # {text}\r\n"
        except IppCommandError as error:
            self._stopped = self._stopped or error.severity >= 2
            answer = error_line(tag, error.severity, error.number, method, error.text) + "\r\n"
        except asyncio.CancelledError:
            self._stopped = True
            answer = error_line(tag, 2, 6, method, "Transaction aborted") + "\r\n"
        self._motion = None
        self.say(f"{answer}{tag} %\r\n")
        while self._behind and self._motion is None:
            self._carry_out(self._behind.popleft())

    def _abort(self) -> None:
        self._server.carrier.halt()
        if self._motion is not None:
            self._motion.cancel()

    def _result(self, tag: str, method: str, arguments: str) -> list[str]:
        """The texts of data of a command, mostly one or none."""
        faults = self._server.faults
        handler: Callable[[str, str], list[str]] | None = getattr(self, f"_do_{method}", None)
        if handler is None:
            raise IppCommandError(3, 501, "Unsupported command")
        if method in ("StartSession", "EndSession", "ClearAllErrors"):
            return handler(tag, arguments)
        if not self._session:
            raise IppCommandError(3, 8, "Protocol error")
        if self._stopped and not method.endswith("E"):
            raise IppCommandError(2, 514, "Use ClearAllErrors to continue")
        if faults.errors:
            severity, number, text = faults.errors.pop(0)
            if severity >= 2:
                raise IppCommandError(severity, number, text)
            self.say(error_line(tag, severity, number, method, text) + "\r\n")
        return handler(tag, arguments)

    def _do_StartSession(self, tag: str, arguments: str) -> list[str]:
        if self._session:
            raise IppCommandError(3, 8, "Protocol error")
        self._session, self._stopped = True, False
        return []

    def _do_EndSession(self, tag: str, arguments: str) -> list[str]:
        self._session = False
        self._end_reports()
        return []

    def _do_ClearAllErrors(self, tag: str, arguments: str) -> list[str]:
        self._stopped = False
        return []

    def _do_AbortE(self, tag: str, arguments: str) -> list[str]:
        self._abort()
        return []

    def _do_OnPtMeasReport(self, tag: str, arguments: str) -> list[str]:
        if [name for name, _ in named_arguments(arguments)] != ["X", "Y", "Z"]:
            raise IppCommandError(3, 509, "Bad argument")
        return []

    def _do_SetProp(self, tag: str, arguments: str) -> list[str]:
        for name, value in named_arguments(arguments):
            self._server.carrier.set_property(name, value)
        return []

    def _do_GetDMEVersion(self, tag: str, arguments: str) -> list[str]:
        return ['DMEVersion("1.4")']

    def _do_GetErrStatusE(self, tag: str, arguments: str) -> list[str]:
        return [f"ErrStatus({int(self._stopped)})"]

    def _do_GetCoordSystem(self, tag: str, arguments: str) -> list[str]:
        return [f"CoordSystem({self._server.machine.coordinates})"]

    def _do_Get(self, tag: str, arguments: str) -> list[str]:
        return [self._positions([name for name, _ in named_arguments(arguments)])]

    def _do_GetProp(self, tag: str, arguments: str) -> list[str]:
        names = [name for name, _ in named_arguments(arguments)]
        try:
            values = {name: self._server.machine.property(name) for name in names}
        except UnknownError:
            raise IppCommandError(3, 510, "Bad property") from None
        return [", ".join(f"{name}({', '.join(map(shown, v))})" for name, v in values.items())]

    def _do_GetScaleTemperatures(self, tag: str, arguments: str) -> list[str]:
        names = [name for name, _ in named_arguments(arguments)]
        try:
            values = self._server.machine.scale_temperatures(names)
        except UnknownError:
            raise IppCommandError(9, 1002, "Axis does not exist") from None
        except ScaleSensorError:
            raise IppCommandError(1, 1500, "No scale temperature") from None
        return [", ".join(f"{name}({value})" for name, value in values.items())]

    def _do_OnMoveReportE(self, tag: str, arguments: str) -> list[str]:
        if not tag.startswith("E") or tag == "E0000":
            raise IppCommandError(3, 502, "Incorrect arguments")
        if self._reports:
            raise IppCommandError(2, 515, "Daemon already exists")
        given = dict(named_arguments(arguments))
        try:
            pause, distance = float(given.pop("Time")), float(given.pop("Dis"))
        except (KeyError, ValueError):
            raise IppCommandError(3, 509, "Bad argument") from None
        if pause < _LEAST_TIME or distance <= 0.0:
            raise IppCommandError(3, 509, "Bad argument")
        self._positions(list(given))
        self._reports[tag] = asyncio.ensure_future(self._report(tag, pause, distance, list(given)))
        return []

    def _do_StopDaemon(self, tag: str, arguments: str) -> list[str]:
        report = self._reports.pop(arguments.strip(), None)
        if report is None:
            raise IppCommandError(2, 513, "Daemon does not exist")
        report.cancel()
        return []

    async def _report(self, tag: str, pause: float, distance: float, names: Sequence[str]) -> None:
        """Send positions after some motion, or after some time."""
        machine = self._server.machine
        reported: tuple[float, ...] | None = None
        reported_at = 0.0
        while True:
            now = time.monotonic()
            place = tuple(machine.axes(("X", "Y", "Z")).values())
            moved = math.inf if reported is None else math.dist(place, reported)
            if moved >= distance or now - reported_at >= pause:
                reported, reported_at = place, now
                if not self._server.faults.mute_reports:
                    self.say(f"{tag} # {self._positions(names)}\r\n")
            await asyncio.sleep(_PACE)

    def _positions(self, names: Sequence[str]) -> str:
        try:
            values = self._server.machine.axes(names)
        except UnknownError:
            raise IppCommandError(9, 1002, "Axis does not exist") from None
        return ", ".join(f"{name}({value})" for name, value in values.items())

    def _end_reports(self) -> None:
        for report in self._reports.values():
            report.cancel()
        self._reports.clear()


class IppServer:
    """A listening server.

    Parameters
    ----------
    machine
        What it speaks for.
    seats
        Clients that it takes at the same time; further ones are turned away.
    carrier
        What moves and touches.

    Attributes
    ----------
    commands
        What clients sent, without tags.
    """

    def __init__(
        self, machine: IppMachine, seats: int = 1, carrier: ProbeCarrier | None = None
    ) -> None:
        self.machine = machine
        self.carrier = carrier or ProbeCarrier(machine.plant)
        self.seats = seats
        self.faults = IppFaults()
        self.connections: list[IppConnection] = []
        self.commands: list[str] = []
        self.turned_away = 0
        self._server: asyncio.Server | None = None
        self._where: tuple[str, int] = ("", 0)

    async def start(self, host: str, port: int) -> int:
        """Listen (port 0: any free one); returns the port.

        Raises
        ------
        OSError
            When the port cannot be had.
        """
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: IppConnection(self), host, port)
        bound: int = self._server.sockets[0].getsockname()[1]
        self._where = (host, bound)
        return bound

    async def restart(self) -> None:
        """Listen again where it listened."""
        if self._server is None:
            await self.start(*self._where)

    def go(self) -> None:
        """Listen no more, and drop all clients."""
        if self._server is not None:
            self._server.close()
            self._server = None
        for connection in list(self.connections):
            connection.drop()
