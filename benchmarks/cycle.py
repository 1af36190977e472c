"""The live cycle against a bare pymodbus loop that does the same reads and writes.

Three axes and six thermistors are read, corrected, guarded, and three positions written back, over
Modbus TCP on the loopback, from a simulated machine in its own process. The bare loop makes the
very same two requests and does nothing with the answer. Both run in turns, some dozens of cycles
each, against the same server; the bare loop writes what Abbe wrote last, because Abbe stands down
where somebody else writes. ``docs/performance.md`` gets the figures.

    python benchmarks/cycle.py [ROUNDS]
"""

from __future__ import annotations

import asyncio
import gc
import statistics
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path

from pymodbus.client import AsyncModbusTcpClient

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from abbe.daemon.config import load_config
from abbe.daemon.demo.configuration import demo_configuration
from abbe.daemon.demo.simulator import simulated_bridge
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.drivers.simulated.bridge.registers import REGISTERS, UNIT_ID, WRITE_BACK
from benchmarks.report import machine, write_section

MODEL = Path(__file__).resolve().parent.parent / "examples" / "bridge-cmm" / "model.toml"
CYCLES = 50
"""In one turn."""
TARGET = 1.2
"""What the ratio of the medians may be."""

Cycle = Callable[[], Awaitable[object]]


@dataclass
class Side:
    """One side's times.

    Attributes
    ----------
    durations
        Of all cycles, s.
    cpu, wall
        Processor and elapsed time of all turns, s.
    """

    durations: list[float] = field(default_factory=list)
    cpu: float = 0.0
    wall: float = 0.0

    async def turn(self, cycle: Cycle, count: int) -> None:
        """Run `count` cycles one after the other."""
        cpu, began = time.process_time(), time.perf_counter()
        for _ in range(count):
            start = time.perf_counter()
            await cycle()
            self.durations.append(time.perf_counter() - start)
        self.cpu += time.process_time() - cpu
        self.wall += time.perf_counter() - began

    def us(self, share: float) -> float:
        """A quantile, µs."""
        ordered = sorted(self.durations)
        return 1e6 * ordered[min(len(ordered) - 1, int(share * len(ordered)))]


async def measure(rounds: int) -> tuple[Side, Side, list[float], int, int]:
    """Both sides' times, the ratio of medians of each round, and the registers read and written."""
    with simulated_bridge(1, 1.0) as machine, tempfile.TemporaryDirectory() as folder:
        text = demo_configuration(machine.ready, str(MODEL), period=0.0)
        # the demo reads the simulated truth and the air's thermometer besides; a machine has none
        text = (
            text[: text.index("# Where the machine really is")] + text[text.index("[links.cmm]") :]
        )
        start = text.index("[signals.T_amb]")
        text = text[:start] + text[text.index("[output]") :]
        config = Path(folder) / "config.toml"
        config.write_text(text.replace("signals_every = 0.1 ", "signals_every = 0.25 "))
        configuration = load_config(config)
        links = configuration.make_links()
        link = links["cmm"]
        pipeline = Pipeline(configuration, links)
        await link.open()
        client = AsyncModbusTcpClient(machine.host, port=machine.port)
        await client.connect()

        read = [REGISTERS[name] for name in pipeline.reads["cmm"]]
        to_read, to_write = max(r.address + r.size for r in read), WRITE_BACK.size
        words = [0] * to_write

        async def repeat_what_is_held() -> None:
            answer = await client.read_holding_registers(
                WRITE_BACK.start, count=to_write, device_id=UNIT_ID
            )
            words[:] = answer.registers

        async def bare() -> None:
            answer = await client.read_input_registers(0, count=to_read, device_id=UNIT_ID)
            if answer.isError() or len(answer.registers) != to_read:
                raise RuntimeError(f"bare loop: {answer}")
            answer = await client.write_registers(WRITE_BACK.start, words, device_id=UNIT_ID)
            if answer.isError():
                raise RuntimeError(f"bare loop: {answer}")

        try:
            for _ in range(CYCLES):
                await bare()
            while not (await pipeline.cycle()).decision.compensating:
                await repeat_what_is_held()
                await bare()
            # as the service does before its first cycle
            gc.collect()
            gc.freeze()
            before = link.status.requests
            abbe, plain = Side(), Side()
            ratios = []
            for number in range(rounds):
                sides: list[tuple[Side, Cycle]] = [(abbe, pipeline.cycle), (plain, bare)]
                for side, cycle in sides if number % 2 else reversed(sides):
                    await repeat_what_is_held()
                    await side.turn(cycle, CYCLES)
                medians = [statistics.median(s.durations[-CYCLES:]) for s in (abbe, plain)]
                ratios.append(medians[0] / medians[1])
            requests = link.status.requests - before
            # now and then what was written is read back, to notice another writer
            if not 0 <= requests - 2 * rounds * CYCLES <= rounds * CYCLES / 100:
                raise RuntimeError(f"{requests} requests in {rounds * CYCLES} cycles: not alike")
        finally:
            client.close()
            await link.close()
    return abbe, plain, ratios, to_read, to_write


def main() -> int:
    """Measure, print, write the section; status 1 when the ratio is above the target."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 160
    abbe, plain, ratios, to_read, to_write = asyncio.run(measure(rounds))
    ratio = abbe.us(0.5) / plain.us(0.5)
    rows = "\n".join(
        f"| {name} | {side.us(0.5):.0f} | {side.us(0.99):.0f} | {side.us(0.999):.0f} | "
        f"{100 * side.cpu / side.wall:.0f} % | {1e6 * side.cpu / len(side.durations):.0f} |"
        for name, side in (("Abbe", abbe), ("bare pymodbus loop", plain))
    )
    text = f"""
## The live cycle

`benchmarks/cycle.py`: three axes and six thermistors read ({to_read} registers in one request),
converted, corrected with 21 error motions and three thermal expansions, guarded, and three
corrected positions, echo, status word and heartbeat written back ({to_write} registers in one
request), as fast as the server answers. The bare loop makes the same two requests with pymodbus's
own asynchronous client and does nothing with the answers. {rounds} turns of {CYCLES} cycles each,
alternating, one server process, loopback.

| | median µs | 99 % µs | 99.9 % µs | CPU share | CPU µs per cycle |
| --- | --- | --- | --- | --- | --- |
{rows}

Ratio of the medians: **{ratio:.2f}** (target: at most {TARGET}; turn by turn
{min(ratios):.2f} to {max(ratios):.2f}). At a cycle of 20 ms, Abbe's CPU time per cycle is
{100 * abbe.cpu / len(abbe.durations) / 0.02:.1f} % of a core.

{machine()}.
"""
    write_section("cycle", text)
    print(text)
    return 0 if ratio <= TARGET else 1


if __name__ == "__main__":
    sys.exit(main())
