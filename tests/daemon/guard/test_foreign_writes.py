"""Who else writes: heard before the first write, told from what a controller itself does."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import pytest

from abbe.daemon.config import Configuration
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.daemon.status_word import STOPPED, Status
from abbe.drivers.link import ChannelInfo, LinkState
from tests.daemon.pipeline.test_pipeline import OUTPUTS, QUICK, VALUES, Run, configured
from tests.support.daemon.memory_link import MemoryLink

READABLE = {*OUTPUTS, "echo_sample"}
FULL = float(0x7003)


class Controller(MemoryLink):
    """Keeps what is written in registers that can be read again; `after` is called then."""

    def __init__(self, **values: float) -> None:
        super().__init__("cmm", {**VALUES, **dict.fromkeys(READABLE, 0.0), **values})
        self.beating: str | None = None

    def info(self, channel: str) -> ChannelInfo:
        return ChannelInfo(writable=True, read_back=channel in READABLE)

    async def read(self, channels):
        if self.beating is not None:
            self.values[self.beating] = (self.values[self.beating] or 0.0) + 1.0
        return await super().read(channels)

    async def write(self, values, *, until=math.inf):
        await super().write(values, until=until)
        self.values.update(values)
        self.clear()

    def clear(self) -> None:
        pass


@pytest.fixture
def configuration(tmp_path: Path) -> Configuration:
    return configured(tmp_path, {**QUICK, "[output]\n": "[output]\nread_back = 0.1\n"})


async def test_where_nobody_runs_it_is_written_at_once(configuration: Configuration) -> None:
    link = Controller(abbe_status=STOPPED, abbe_heartbeat=55.0, corrected_X=17.0)
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: r.written)
        assert run.records[0].written

    await run.during(story)


async def test_what_a_dead_one_left_is_listened_to_and_then_written_over(
    configuration: Configuration, caplog: pytest.LogCaptureFixture
) -> None:
    """Also where the controller itself shows its own positions in place of the dead one's."""
    link = Controller(abbe_status=FULL, abbe_heartbeat=55.0)
    link.beating = "corrected_X"
    run = Run(configuration, link)

    async def story() -> None:
        written = await run.until(lambda r: r.written)
        assert written.time > 0.2
        link.beating = None
        await run.until(lambda r: r.decision.compensating)

    await run.during(story)
    assert link.written[-1]["abbe_status"] == STOPPED


async def test_where_another_one_beats_nothing_is_ever_written(
    configuration: Configuration,
) -> None:
    link = Controller(abbe_status=FULL, abbe_heartbeat=55.0)
    link.beating = "abbe_heartbeat"
    run = Run(configuration, link)

    async def story() -> None:
        heard = await run.until(lambda r: "controller" in r.faults)
        assert "it writes cmm.abbe_heartbeat" in heard.faults["controller"]
        assert heard.status & Status.FOREIGN
        await run.until(lambda r: r.time > heard.time + 1.0)

    await run.during(story)
    assert link.written == []


@pytest.mark.parametrize("beating", [None, "abbe_heartbeat"])
async def test_ended_while_it_listens_it_hears_out_before_its_last_word(
    configuration: Configuration, beating: str | None
) -> None:
    """A dead one's word is taken back; one that is at work is not told that it has ended."""
    link = Controller(abbe_status=FULL, abbe_heartbeat=55.0)
    link.beating = beating
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: not r.written)

    await run.during(story)
    words = [values["abbe_status"] for values in link.written if "abbe_status" in values]
    assert words[-1:] == ([] if beating else [float(STOPPED)])
    assert len(words) < 20
    run.pipeline.ending.check()


async def test_ended_at_once_while_it_listens_it_says_nothing(
    configuration: Configuration,
) -> None:
    """Nothing was written from here: nothing has to be taken back."""
    link = Controller(abbe_status=FULL, abbe_heartbeat=55.0)
    pipeline = Pipeline(configuration, {"cmm": link})
    over = asyncio.Event()
    over.set()
    await pipeline.run(over, over)
    assert link.written == []
    pipeline.ending.check()


async def test_it_takes_over_when_the_other_one_has_ended(configuration: Configuration) -> None:
    link = Controller(abbe_status=FULL, abbe_heartbeat=55.0)
    link.beating = "abbe_heartbeat"
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: "controller" in r.faults)
        link.beating, link.values["abbe_status"] = None, float(STOPPED)
        full = await run.until(lambda r: r.decision.compensating)
        assert full.written
        assert not full.faults

    await run.during(story)


async def test_after_a_long_outage_it_listens_again(configuration: Configuration) -> None:
    link = Controller()
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: r.decision.compensating)
        link.status.become(LinkState.DOWN, "cable")
        gone = await run.until(lambda r: not r.written)
        await run.until(lambda r: r.time > gone.time + 0.5)
        count = len(link.written)
        # meanwhile another one came
        link.values |= {"abbe_status": FULL, "abbe_heartbeat": 9.0}
        link.beating = "abbe_heartbeat"
        link.status.become(LinkState.UP)
        heard = await run.until(lambda r: "controller" in r.faults)
        await run.until(lambda r: r.time > heard.time + 0.5)
        assert len(link.written) == count

    await run.during(story)
    # the word is the other one's: it is not told that Abbe has ended
    assert link.written[-1]["abbe_status"] != STOPPED
    run.pipeline.ending.check()


async def test_after_a_long_outage_of_its_own_it_goes_on_at_once(
    configuration: Configuration,
) -> None:
    link = Controller()
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: r.decision.compensating)
        link.status.become(LinkState.DOWN, "cable")
        gone = await run.until(lambda r: not r.written)
        await run.until(lambda r: r.time > gone.time + 0.5)
        since = len(run.records)
        link.status.become(LinkState.UP)
        await run.until(lambda r: r.written)
        # one cycle may have begun without the link, and ends with it
        up = [r for r in run.records[since:] if not r.faults]
        assert sum(not r.written for r in up) <= 1

    await run.during(story)


async def test_a_controller_that_clears_its_registers_is_not_somebody_else(
    configuration: Configuration,
) -> None:
    class Clearing(Controller):
        def clear(self) -> None:
            self.values |= {"abbe_status": 0.0, "abbe_heartbeat": 0.0, "echo_sample": 0.0}

    run = Run(configuration, Clearing())

    async def story() -> None:
        full = await run.until(lambda r: r.decision.compensating)
        await run.until(lambda r: r.time > full.time + 1.0)

    await run.during(story)
    assert not any(r.status & Status.FOREIGN for r in run.records)


async def test_a_program_that_writes_positions_only_has_it_ramp_out_and_say_so(
    configuration: Configuration,
) -> None:
    class Shared(Controller):
        def clear(self) -> None:
            self.values["corrected_Y"] = 12.0

    link = Shared()
    run = Run(configuration, link)

    async def story() -> None:
        noticed = await run.until(lambda r: "controller" in r.faults)
        assert "somebody else writes cmm.corrected_Y" in noticed.faults["controller"]
        off = await run.until(lambda r: not any(r.decision.correction))
        assert off.written  # the status word goes on saying why
        assert off.status & Status.FOREIGN

    await run.during(story)
    assert link.written[-1]["abbe_status"] == STOPPED


async def test_a_channel_that_is_refused_is_not_waited_for(configuration: Configuration) -> None:
    link = Controller(abbe_status=FULL)
    link.values |= dict.fromkeys(READABLE, None)
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: r.written)

    await run.during(story)
