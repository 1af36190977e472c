"""How old a value is that an I++ DME server gave: as its question, or as the last one before it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import pytest

from abbe.drivers.ipp.config import IppConfig
from abbe.drivers.ipp.link import IppLink
from abbe.drivers.link import LinkConfigError, LinkError
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.ipp_links import AXES, PART, SCALES, linked, read_until
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration


@pytest.fixture
def cmm() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("ipp") as process:
        yield process


async def test_an_answer_is_as_old_as_its_question(cmm: SimulatedProcess) -> None:
    async with linked(cmm, AXES | PART, coordinates="any") as link:
        cmm.order("fault", late=2, lateness=0.6)
        began = time.monotonic()
        samples = await link.read(("x", "T_part"))
        ended = time.monotonic()
        x, part = samples["x"], samples["T_part"]
        assert x.good, x.reason
        assert began <= x.time <= ended - 1.2
        assert x.time + 0.6 <= part.time <= ended - 0.6


class SlowServer:
    """Reports X every 20 ms; on its way everything takes `lag` s.

    Attributes
    ----------
    made
        Value → when it was that (monotonic, s).
    """

    def __init__(self, lag: float) -> None:
        self.lag = lag
        self.port = 0
        self.made: dict[int, float] = {}
        self._tasks: list[asyncio.Task[None]] = []

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        try:
            yield
        finally:
            for task in self._tasks:
                task.cancel()
            server.close()
            await server.wait_closed()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        loop = asyncio.get_running_loop()

        def say(text: str) -> None:
            loop.call_later(self.lag, _write, writer, text.encode())

        while line := (await reader.readline()).decode().strip():
            tag, command = line.split(" ", 1)
            data = f"{tag} # CoordSystem(MachineCsy)\r\n" if "Coord" in command else ""
            say(f"{tag} &\r\n{data}{tag} %\r\n")
            if command.startswith("OnMoveReportE"):
                self._tasks.append(loop.create_task(self._report(tag, say)))
        writer.close()

    async def _report(self, tag: str, say: object) -> None:
        while True:
            number = len(self.made) + 1
            self.made[number] = time.monotonic()
            say(f"{tag} # X({number})\r\n")  # type: ignore[operator]
            await asyncio.sleep(0.02)


def _write(writer: asyncio.StreamWriter, data: bytes) -> None:
    if not writer.is_closing():
        writer.write(data)


@pytest.mark.parametrize("coordinates", ["MachineCsy", "any"])
async def test_a_report_is_no_younger_than_what_was_answered_before_it(coordinates: str) -> None:
    server = SlowServer(0.5)
    async with server.running():
        settings = {
            "host": "127.0.0.1", "port": server.port, "timeout": 30.0, "coordinates": coordinates,
            "move_report": {"time": 0.1, "distance": 0.05, "within": 30.0},
            "channels": {"x": {"axis": "X"}},
        }  # fmt: skip
        link = IppLink("bench", IppConfig.model_validate(settings))
        await link.open()
        try:
            ages = []
            for _ in range(150):
                sample = (await link.read(("x",)))["x"]
                assert sample.good, sample.reason
                assert sample.time <= server.made[round(sample.value)]
                ages.append(sample.age())
                await asyncio.sleep(0.01)
            # on the way for half a second: nothing is younger
            assert min(ages) >= 0.5
            server.lag = 0.0

            async def is_fresh() -> bool:
                return (await link.read(("x",)))["x"].age() < 0.3

            await until(is_fresh)
        finally:
            await link.close()


async def test_positions_whose_coordinates_are_not_stated_any_more(cmm: SimulatedProcess) -> None:
    reported = {"move_report": {"time": 0.1, "distance": 0.05, "within": 60.0}}
    settings = {"timeout": 0.3, "coordinates_every": 0.1, "quarantine_after": 100}
    async with linked(cmm, AXES, **reported, **settings) as link:
        await read_until(link, ("x",), lambda sample: sample.good)
        # every answer is cut off; the reports go on
        cmm.order("fault", incomplete=10_000)
        samples = await read_until(link, ("x",), lambda sample: "has not stated" in sample.reason)
        assert not samples["x"].good


async def test_where_channels_sit_and_what_belongs_together(cmm: SimulatedProcess) -> None:
    channels = AXES | SCALES | PART
    async with linked(cmm, channels) as link:
        assert link.owns == (f"tcp 127.0.0.1:{cmm.ready['port']}",)
        (x,), (y,) = link.places("x"), link.places("y")
        assert not x.overlaps(y)
        assert x.overlaps(link.places("x")[0])
        link.keep_together(("x", "y", "z"), one_sample=True)
        link.keep_together(("x", "T_part"))
        with pytest.raises(LinkConfigError, match=r"x, T_part must be of one answer.*Get\(X\(\)"):
            link.keep_together(("x", "T_part"), one_sample=True)
        with pytest.raises(LinkError) as refused:
            await link.write({"x": 1.0})
        assert refused.value.untouched == {"x"}
