"""The live cycle against a bare pymodbus loop that does the same reads and writes.

Three axes and six thermistors are read, corrected, guarded, and three positions written back, over
Modbus TCP on the loopback, from a simulated machine in its own process. The bare loop makes the
very same two requests and does nothing with the answer. Both run in turns, some dozens of cycles
each, against the same server; the bare loop writes what Abbe wrote last, because Abbe stands down
where somebody else writes. Abbe is the service as ``abbe run`` has it, with its HTTP process beside
it: for some turns nobody asks that, for the next some 20 clients read, 5 never do and one sends
rubbish. ``docs/performance.md`` gets the figures.

    python benchmarks/cycle.py [ROUNDS]
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import statistics
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from pymodbus.client import AsyncModbusTcpClient

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from abbe.daemon.config import load_config
from abbe.daemon.control.controls import Controls
from abbe.daemon.demo.configuration import demo_configuration
from abbe.daemon.demo.simulator import simulated_bridge
from abbe.daemon.http.supervisor import HttpProcess
from abbe.daemon.service import Service
from abbe.drivers.simulated.bridge.registers import REGISTERS, UNIT_ID, WRITE_BACK
from abbe.drivers.simulated.soak.client_process import HttpClients
from abbe.drivers.simulated.soak.http_clients import ClientCounts
from benchmarks.measuring.report import machine, write_section
from benchmarks.measuring.turns import Cycle, Pair, Side

MODEL = Path(__file__).resolve().parent.parent / "examples" / "bridge-cmm" / "model.toml"
CYCLES = 50
"""In one turn."""
BLOCK = 10
"""Turns of each side after which clients begin to ask, or end."""
STREAMED_EVERY = 0.02
"""s between two cycles of the fastest streams: every one of a machine's usual cycle."""
COME_AND_GO = 1.5
"""s in which clients connect, or let go, and nothing is measured."""
TARGET = 1.2
"""What the ratio of the medians may be."""


@dataclass
class Measured:
    """What was measured.

    Attributes
    ----------
    alone, asked
        While nobody asks the HTTP process, and while all clients do.
    met
        What the clients met.
    to_read, to_write
        Registers of the two requests.
    """

    alone: Pair
    asked: Pair
    met: ClientCounts
    to_read: int
    to_write: int


class Bench:
    """A service and a bare loop at one simulated machine.

    Parameters
    ----------
    service
        With its links open.
    client
        The bare loop's, connected.
    """

    def __init__(self, service: Service, client: AsyncModbusTcpClient) -> None:
        self.service, self._client = service, client
        read = [REGISTERS[name] for name in service.pipeline.reads["cmm"]]
        self.to_read = max(r.address + r.size for r in read)
        self.to_write = WRITE_BACK.size
        self._words = [0] * self.to_write

    async def repeat_what_is_held(self) -> None:
        """Have the bare loop write what the machine holds."""
        answer = await self._client.read_holding_registers(
            WRITE_BACK.start, count=self.to_write, device_id=UNIT_ID
        )
        self._words[:] = answer.registers

    async def bare(self) -> None:
        """One cycle of the bare loop."""
        answer = await self._client.read_input_registers(0, count=self.to_read, device_id=UNIT_ID)
        if answer.isError() or len(answer.registers) != self.to_read:
            raise RuntimeError(f"bare loop: {answer}")
        answer = await self._client.write_registers(
            WRITE_BACK.start, self._words, device_id=UNIT_ID
        )
        if answer.isError():
            raise RuntimeError(f"bare loop: {answer}")

    async def settle(self) -> None:
        """Until Abbe corrects in full."""
        for _ in range(CYCLES):
            await self.bare()
        while not (await self.service.pipeline.cycle()).decision.compensating:
            await self.repeat_what_is_held()
            await self.bare()

    async def turns(self, pair: Pair, number: int) -> None:
        """One turn of each side."""
        sides: list[tuple[Side, Cycle]] = [
            (pair.abbe, self.service.pipeline.cycle),
            (pair.bare, self.bare),
        ]
        for side, cycle in sides if number % 2 else reversed(sides):
            await self.repeat_what_is_held()
            await side.turn(cycle, CYCLES)
        medians = [statistics.median(s.durations[-CYCLES:]) for s in (pair.abbe, pair.bare)]
        pair.ratios.append(medians[0] / medians[1])

    async def unmeasured(self, seconds: float) -> None:
        """Go on as before, for clients to come or go."""
        until = time.perf_counter() + seconds
        for number in range(10**9):
            if time.perf_counter() > until:
                return
            await self.turns(Pair(), number)


@asynccontextmanager
async def bench() -> AsyncIterator[Bench]:
    """A machine, a service with its link open, the bare loop's client."""
    with simulated_bridge(1, 1.0) as machine, tempfile.TemporaryDirectory() as folder:
        text = demo_configuration(machine.ready, str(MODEL), period=0.0)
        # the demo reads the simulated truth and the air's thermometer besides; a machine has none
        text = (
            text[: text.index("# Where the machine really is")] + text[text.index("[links.cmm]") :]
        )
        start = text.index("[signals.T_amb]")
        text = text[:start] + text[text.index("[output]") :] + "\n[http]\n"
        config = Path(folder) / "config.toml"
        config.write_text(text.replace("signals_every = 0.1 ", "signals_every = 0.25 "))
        service = Service(load_config(config))
        link = service.links["cmm"]
        await link.open()
        client = AsyncModbusTcpClient(machine.host, port=machine.port)
        await client.connect()
        try:
            yield Bench(service, client)
        finally:
            client.close()
            await link.close()


@asynccontextmanager
async def http_clients(bench: Bench) -> AsyncIterator[HttpClients]:
    """The service's HTTP process, serving, and clients of it that rest."""
    service = bench.service
    setup = service.configuration.http
    if setup is None:
        raise RuntimeError("no [http]")
    showing = asyncio.create_task(HttpProcess(service, Controls(service), setup).run())
    clients = HttpClients(setup.socket, STREAMED_EVERY)
    try:
        while not setup.socket.exists():
            await bench.unmeasured(0.1)
        yield clients
    finally:
        await asyncio.to_thread(clients.close)
        showing.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await showing


async def measure(rounds: int) -> Measured:
    """Measure both sides, `rounds` turns alone and as many while clients ask."""
    async with bench() as made, http_clients(made) as clients:
        await made.settle()
        # as the service does before its first cycle
        gc.collect()
        gc.freeze()
        link = made.service.links["cmm"]
        alone, asked, met = Pair(), Pair(), ClientCounts()
        requests = cycles = 0
        for first in range(0, rounds, BLOCK):
            for pair in (alone, asked):
                if pair is asked:
                    clients.go()
                await made.unmeasured(COME_AND_GO)
                before = link.status.requests
                for number in range(first, min(first + BLOCK, rounds)):
                    await made.turns(pair, number)
                    cycles += CYCLES
                requests += link.status.requests - before
            met = await asyncio.to_thread(clients.rest)
        # now and then what was written is read back, to notice another writer
        if not 0 <= requests - 2 * cycles <= cycles / 100:
            raise RuntimeError(f"{requests} requests in {cycles} cycles: not alike")
        if met.wrong or not {"health", "metrics", "api", "page", "cycles"} <= set(met.answers):
            raise RuntimeError(f"clients were not answered as they should be: {met}")
        return Measured(alone, asked, met, made.to_read, made.to_write)


def main() -> int:
    """Measure, print, write the section; status 1 when a ratio is above the target."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 160
    found = asyncio.run(measure(rounds))
    alone, asked = found.alone, found.asked
    rows = "\n".join(
        f"| {name} | {side.us(0.5):.0f} | {side.us(0.99):.0f} | {side.us(0.999):.0f} | "
        f"{100 * side.cpu / side.wall:.0f} % | {1e6 * side.cpu / len(side.durations):.0f} |"
        for name, side in (
            ("Abbe", alone.abbe),
            ("bare pymodbus loop", alone.bare),
            ("Abbe, clients ask", asked.abbe),
            ("bare pymodbus loop meanwhile", asked.bare),
        )
    )
    answers = found.met.answers
    text = f"""
## The live cycle

`benchmarks/cycle.py`: three axes and six thermistors read ({found.to_read} registers in one
request), converted, corrected with 21 error motions and three thermal expansions, guarded, and
three corrected positions, echo, status word and heartbeat written back ({found.to_write} registers
in one request), as fast as the server answers, by the service as `abbe run` has it. The bare loop
makes the same two requests with pymodbus's own asynchronous client and does nothing with the
answers. {rounds} turns of {CYCLES} cycles each, alternating, one server process, loopback.

*Clients ask*: as many turns more, in blocks of {BLOCK} between the others, while 20 clients read
without end (health, metrics, the status and its parts, the page, streams of a cycle every 20 ms),
5 ask and never read, and one sends rubbish, all at the [HTTP process](status.md#over-http):
{sum(answers.values()) - answers["cycles"]:,} answers, {answers["cycles"]:,} streamed cycles.

| | median µs | 99 % µs | 99.9 % µs | CPU share | CPU µs per cycle |
| --- | --- | --- | --- | --- | --- |
{rows}

| | ratio of the medians | turn by turn |
| --- | --- | --- |
| nobody asks | **{alone.ratio:.2f}** | {min(alone.ratios):.2f} to {max(alone.ratios):.2f} |
| clients ask | **{asked.ratio:.2f}** | {min(asked.ratios):.2f} to {max(asked.ratios):.2f} |

Target: at most {TARGET}, and the second as the first. At a cycle of 20 ms, Abbe's CPU time per
cycle is {100 * alone.abbe.cpu / len(alone.abbe.durations) / 0.02:.1f} % of a core.

{machine()}.
"""
    write_section("cycle", text)
    print(text)
    return 0 if max(alone.ratio, asked.ratio) <= TARGET else 1


if __name__ == "__main__":
    sys.exit(main())
