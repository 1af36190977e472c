"""Outages of a serial line: unplugged and plugged in, silent, late, cut off, one dead of three."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os
import socket
import threading
import time
import tty
from collections.abc import Iterator

import pytest
import serial
import serial.rfc2217

from abbe.drivers.link import LinkDownError, LinkProtocolError, LinkState, LinkTimeoutError, Quality
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.opening import until
from tests.support.drivers.serial.links import (
    DRO,
    NUMBER,
    ONE_BY_ONE,
    PRESET,
    ROOM,
    TIMEOUT,
    linked,
)

pytestmark = pytest.mark.integration


@pytest.fixture
def dro() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("serial", "dro", "--speed", "0.01") as process:
        yield process


async def test_unplugged_and_plugged_in_again(
    dro: SimulatedProcess, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, logger="abbe.drivers")
    port = dro.ready["device"]
    parts = DRO | {"channels": DRO["channels"] | PRESET}
    async with linked(port, parts) as link:
        assert (await link.read(("x",)))["x"].good
        dro.order("unplug")
        # nobody reads meanwhile: the hang-up itself is noticed
        await until(lambda: link.status.state is LinkState.DOWN)
        began = time.monotonic()
        for _ in range(20):
            sample = (await link.read(("x",)))["x"]
            assert sample.quality is Quality.UNAVAILABLE
        assert time.monotonic() - began < ROOM
        with pytest.raises(LinkDownError, match="not written: preset_X: link bench"):
            await link.write({"preset_X": 1.0})
        await until(lambda: "no such device" in link.status.detail)
        dro.order("plug")
        await until(lambda: link.status.state is LinkState.UP, limit=0.2 + 5 * ROOM)
        assert (await link.read(("x",)))["x"].good
        assert link.status.reconnects == 1
    said = [r.getMessage() for r in caplog.records if hasattr(r, "event")]
    assert [text.split("(")[0] + text.split(")", 1)[1][:5] for text in said] == [
        "link bench  lost",
        "link bench  back",
    ]
    assert "hung up" in said[0]


async def test_a_query_in_flight_fails_at_once_when_the_port_vanishes(
    dro: SimulatedProcess,
) -> None:
    async with linked(dro.ready["device"], DRO, timeout=30.0) as link:
        dro.order("silent", seconds=60)
        call = asyncio.create_task(link.read(("x",)))
        await asyncio.sleep(0.05)
        dro.order("unplug")
        sample = (await asyncio.wait_for(call, 5.0))["x"]
        assert sample.quality is Quality.UNAVAILABLE
        assert "hung up" in sample.reason


async def test_a_killed_simulator_is_a_hang_up_too(dro: SimulatedProcess) -> None:
    async with linked(dro.ready["device"], DRO) as link:
        dro.kill()
        await until(lambda: link.status.state is LinkState.DOWN)


async def test_a_port_that_appears_after_open_is_found(dro: SimulatedProcess) -> None:
    dro.order("unplug")
    async with linked(dro.ready["device"], DRO) as link:
        assert link.status.state is LinkState.DOWN
        dro.order("plug")
        await until(lambda: link.status.state is LinkState.UP)


async def test_an_open_port_with_nobody_behind_it_is_down(dro: SimulatedProcess) -> None:
    dro.order("silent", seconds=1.0)
    async with linked(dro.ready["device"], DRO) as link:
        assert link.status.state is LinkState.DOWN
        assert "the port is open, and no query is answered" in link.status.detail
        await until(lambda: link.status.state is LinkState.UP)


async def test_one_lost_answer_costs_one_reading_and_silence_the_link(
    dro: SimulatedProcess,
) -> None:
    async with linked(dro.ready["device"], DRO, late_reply_max=0.05) as link:
        dro.order("fault", cut=1)
        began = time.monotonic()
        sample = (await link.read(("x",)))["x"]
        took = time.monotonic() - began
        assert sample.quality is Quality.UNAVAILABLE
        assert "X" in sample.reason  # what came of it
        assert TIMEOUT <= took < TIMEOUT + 0.2 + ROOM  # on top: the time on the wire
        assert (await link.read(("x",)))["x"].good
        assert link.status.state is LinkState.UP
        dro.order("silent", seconds=3.0)
        while link.status.state is LinkState.UP:
            await link.read(("x",))
        assert "no query answers" in link.status.detail


def consistent(x: float, y: float, z: float) -> bool:
    """Whether three positions can belong to one angle of the simulated circles.

    sin(a) + sin(a + 4) = 2 cos(2) sin(a + 2) for any a; at 0.01 turns/s an axis moves by 6.3 mm in
    the longest second between two answers, and 75 mm or more are between them at first.
    """
    return abs(x + z - 2.0 * math.cos(2.0) * y) < 20.0


async def test_a_late_answer_is_never_taken_for_the_next_one(dro: SimulatedProcess) -> None:
    """The axes are asked one by one and answer alike: a late X must not become Y's position."""
    # late_reply_max: how late an answer may be; a busy machine adds its own to `lateness`
    waits = {"quarantine_after": 100, "late_reply_max": 5.0}
    async with linked(dro.ready["device"], ONE_BY_ONE, **waits) as link:
        for late in ("x", "y", "z"):
            dro.order("fault", late=1, lateness=TIMEOUT + 0.4)
            sample = (await link.read((late,)))[late]
            assert sample.quality is Quality.UNAVAILABLE
            good = 0
            while good < 5:
                samples = await link.read(("x", "y", "z"))
                if all(s.good for s in samples.values()):
                    good += 1
                    assert consistent(*(s.value for s in samples.values()))
                await asyncio.sleep(0.02)


async def test_a_client_that_takes_the_next_line_mixes_them_up(dro: SimulatedProcess) -> None:
    """What the link guards against does happen."""

    def mixed_up() -> bytes:
        with serial.Serial(dro.ready["device"], timeout=TIMEOUT) as port:
            dro.order("fault", late=1, lateness=TIMEOUT + 0.2)
            port.write(b"X\r\n")
            assert port.readline() == b""
            port.timeout = 5.0
            port.write(b"?\r\n")
            return bytes(port.readline())

    assert (await asyncio.to_thread(mixed_up))[:1] in b"+-"


async def test_a_cancelled_read_leaves_nothing_behind(dro: SimulatedProcess) -> None:
    async with linked(dro.ready["device"], ONE_BY_ONE, timeout=1.0) as link:
        dro.order("fault", late=1, lateness=0.2)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(link.read(("x",)), 0.05)
        sample = (await link.read(("y",)))["y"]
        assert sample.quality is Quality.UNAVAILABLE
        assert "may still be answered late" in sample.reason

        async def good() -> bool:
            return (await link.read(("y",)))["y"].good

        # as soon as the late answer has come, long before late_reply_max
        assert await until(good) < 0.2 + ROOM


async def test_one_dead_module_among_three_on_a_line() -> None:
    parts = {
        "messages": {
            f"module_{n}": {"query": f"#0{n}", "pattern": rf">(?P<T>{NUMBER}){NUMBER}"}
            for n in (1, 2, 3)
        },
        "channels": {
            f"T{n}": {"message": f"module_{n}", "field": "T", "unit": "degC"} for n in (1, 2, 3)
        },
    }
    with SimulatedProcess("serial", "thermometer") as modules:
        port = modules.ready["device"]
        async with linked(port, parts, late_reply_max=0.1, quarantine_max=0.5) as link:
            names = ("T1", "T2", "T3")
            assert all(s.good for s in (await link.read(names)).values())
            modules.order("dead", addresses=[2])
            before = modules.order("queries")["queries"]
            for _ in range(30):
                samples = await link.read(names)
                good = {n: s.value for n, s in samples.items() if s.good}
                assert "T2" not in good
                assert set(good.items()) <= {("T1", 21.0), ("T3", 23.0)}
                await asyncio.sleep(0.02)
            assert link.status.state is LinkState.DEGRADED
            assert list(link.status.quarantined) == ["message module_2"]
            assert modules.order("queries")["queries"] - before < 30 * 2 + 12
            modules.order("dead", addresses=[])

            async def back() -> bool:
                return all(s.good for s in (await link.read(names)).values())

            await until(back)
            assert link.status.state is LinkState.UP


async def test_an_adapter_that_hears_what_it_sends(dro: SimulatedProcess) -> None:
    dro.order("fault", echo=True)
    async with linked(dro.ready["device"], DRO, local_echo=True) as link:
        assert all(s.good for s in (await link.read(("x", "y", "z"))).values())
    # Undeclared, it is passed over: it does not fit.
    async with linked(dro.ready["device"], DRO) as link:
        assert all(s.good for s in (await link.read(("x", "y", "z"))).values())


async def test_an_echo_that_runs_into_the_answer_is_named() -> None:
    """Ctrl-B asks without an end of line: the echo stands before the number, on the same line."""
    ours, theirs = os.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)

    def answer() -> None:
        with contextlib.suppress(OSError):
            while asked := os.read(ours, 1):
                os.write(ours, asked + b"+1.250\r\n")

    threading.Thread(target=answer, daemon=True).start()
    parts = {
        "query_terminator": "",
        "messages": {"x": {"query": "?", "pattern": r"(?P<x>[-+][\d.]+)"}},
        "channels": {"x": {"message": "x"}},
    }
    for echo, good in ((False, False), (True, True)):
        async with linked(os.ttyname(theirs), parts, local_echo=echo) as link:
            sample = (await link.read(("x",)))["x"]
            assert sample.good is good
            assert ("local_echo = true" in sample.reason) is not good
    os.close(theirs)


async def test_an_answer_after_noise_is_found_and_noise_alone_is_bad(dro: SimulatedProcess) -> None:
    async with linked(dro.ready["device"], DRO) as link:
        dro.order("fault", late=1, lateness=0.05)
        call = asyncio.create_task(link.read(("x",)))
        await asyncio.sleep(0.01)
        await asyncio.to_thread(dro.order, "say", text="#!?\r\n\r\n")
        assert (await call)["x"].good
        dro.order("fault", garbled=1)
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.BAD
        assert "does not fit" in sample.reason
        assert (await link.read(("x",)))["x"].good


async def test_a_refusal_is_reported_at_once(dro: SimulatedProcess) -> None:
    parts = {
        "messages": {"u": {"query": "U", "pattern": r"(?P<u>[-+][\d.]+)", "refused": r"\?"}},
        "channels": {
            "u": {"message": "u"},
            "preset_U": {"command": "PU{value:+.4f}", "acknowledge": "OK", "refused": r"\?"},
        },
    }
    async with linked(dro.ready["device"], parts, timeout=20.0) as link:
        began = time.monotonic()
        sample = (await link.read(("u",)))["u"]
        assert sample.quality is Quality.BAD
        assert "the device answers '?'" in sample.reason
        with pytest.raises(LinkProtocolError, match="not written: preset_U.* answers '?'"):
            await link.write({"preset_U": 1.0})
        assert time.monotonic() - began < 10.0


async def test_what_comes_unasked_is_no_answer(dro: SimulatedProcess) -> None:
    async with linked(dro.ready["device"], DRO) as link:
        old = "X+00999.0000 Y+00999.0000 Z+00999.0000\r\n"
        for _ in range(20):
            dro.order("say", text=old)
            sample = (await link.read(("x",)))["x"]
            assert sample.good
            assert sample.value != 999.0


async def test_the_loop_is_never_blocked(dro: SimulatedProcess) -> None:
    """Whatever happens to the port, the event loop goes on."""
    longest, last, stop = 0.0, time.monotonic(), False

    async def tick() -> None:
        nonlocal longest, last
        while not stop:
            await asyncio.sleep(0.001)
            now = time.monotonic()
            longest, last = max(longest, now - last), now

    ticking = asyncio.create_task(tick())
    async with linked("socket://127.0.0.1:9", DRO), linked(dro.ready["device"], DRO) as link:
        dro.order("silent", seconds=0.5)
        for _ in range(5):
            await link.read(("x",))
        await asyncio.to_thread(dro.order, "unplug")
        await asyncio.sleep(0.3)
        await asyncio.to_thread(dro.order, "plug")
        await until(lambda: link.status.state is LinkState.UP)
    stop = True
    await ticking
    # pyserial's own closing of a socket sleeps 0.3 s, its opening up to 5 s
    assert longest < 0.25


async def test_a_write_that_is_not_answered_says_so(dro: SimulatedProcess) -> None:
    parts = {"messages": DRO["messages"], "channels": DRO["channels"] | PRESET}
    async with linked(dro.ready["device"], parts) as link:
        dro.order("silent", seconds=1.0)
        with pytest.raises(LinkTimeoutError, match="not written: preset_Y: command preset_Y"):
            await link.write({"preset_Y": 1.0})


async def test_a_port_without_a_file_descriptor_is_served_by_threads() -> None:
    """``loop://`` gives back what is sent: the query's second line is its own answer."""
    parts = {
        "messages": {"self": {"query": "Q\n+12.5", "pattern": rf"(?P<x>{NUMBER})"}},
        "channels": {"x": {"message": "self"}},
        "terminator": "\n",
    }
    async with linked("loop://", parts, baudrate=115200) as link:
        assert link.status.state is LinkState.UP, link.status.detail
        for _ in range(5):
            assert (await link.read(("x",)))["x"].value == 12.5


class _WithoutModemLines(serial.Serial):  # type: ignore[misc]
    """A pseudo-terminal has none, and says so by an error."""

    cts = dsr = ri = cd = True

    def _update_dtr_state(self) -> None: ...

    def _update_rts_state(self) -> None: ...


class Rfc2217Server:
    """A serial device server (RFC 2217) before a port, as pyserial's documentation has it."""

    def __init__(self, port: str) -> None:
        self._serial = _WithoutModemLines(port, timeout=0.02)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"rfc2217://127.0.0.1:{self._listener.getsockname()[1]}"
        self._connection: socket.socket | None = None
        self._threads = [threading.Thread(target=self._serve, daemon=True)]
        self._threads[0].start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            self._connection, _ = self._listener.accept()
            manager = serial.rfc2217.PortManager(self._serial, _Locked(self._connection))
            self._threads.append(threading.Thread(target=self._to_net, args=[manager], daemon=True))
            self._threads[-1].start()
            while data := self._connection.recv(1024):
                self._serial.write(b"".join(manager.filter(data)))

    def _to_net(self, manager: serial.rfc2217.PortManager) -> None:
        with contextlib.suppress(OSError, TypeError):
            while self._connection is not None and self._connection.fileno() >= 0:
                if data := self._serial.read(self._serial.in_waiting or 1):
                    self._connection.sendall(b"".join(manager.escape(data)))

    def close(self) -> None:
        self._listener.close()
        if self._connection is not None:
            with contextlib.suppress(OSError):
                self._connection.shutdown(socket.SHUT_RDWR)
            self._connection.close()
        for thread in self._threads:
            thread.join(5)
        self._serial.close()


class _Locked:
    """What `PortManager` writes its answers to."""

    def __init__(self, connection: socket.socket) -> None:
        self.write = connection.sendall


@pytest.mark.filterwarnings("ignore:set(Daemon|Name)")  # pyserial 3.5
async def test_a_serial_device_server_by_rfc2217(dro: SimulatedProcess) -> None:
    server = Rfc2217Server(dro.ready["device"])
    try:
        async with linked(server.url, DRO, timeout=1.0) as link:
            assert link.status.state is LinkState.UP, link.status.detail
            for _ in range(3):
                assert all(s.good for s in (await link.read(("x", "y", "z"))).values())
            await asyncio.to_thread(server.close)
            await until(lambda: link.status.state is LinkState.DOWN)
    finally:
        server.close()
