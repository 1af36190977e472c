"""The pipeline as a whole on channels in memory: no stage's failure ends another."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from abbe.compcore.effects import make_effect
from abbe.compcore.errors import AbbeError
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Term, Value
from abbe.daemon.config import Configuration, load_config
from abbe.daemon.guard import Guard, GuardState
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.pipeline.writing.ending import NotReportedError
from abbe.daemon.service import Service
from abbe.daemon.status_word import STOPPED, Status
from abbe.drivers.link import LinkDownError, LinkState
from abbe.drivers.transducers import SteinhartHartConfig, make_transducer
from tests.support.daemon.memory_link import MemoryLink

EXAMPLE = Path(__file__).parents[3] / "examples" / "bridge-cmm"
QUICK = {
    "period = 0.02": "period = 0.005",
    "signals_every = 0.25": "signals_every = 0.0",
    "hold = 1.0": "hold = 0.1",
    "ramp = 2.0": "ramp = 0.1",
    "max_rate = 0.5": "max_rate = 5.0",
    "heartbeat_within = 1.0": "heartbeat_within = 60.0",
    '"model.toml"': f'"{EXAMPLE / "model.toml"}"',
}
OHMS = make_transducer(SteinhartHartConfig(a=1.032e-3, b=2.387e-4, c=1.580e-7)).inverse(21.0)
AT = {"X": 350.0, "Y": 450.0, "Z": -180.0}
SENSORS = ("T_x1", "T_x2", "T_y1", "T_y2", "T_z1", "T_z2")
VALUES = {
    "status": 5.0,
    "heartbeat": 1.0,
    "sample": 4711.0,
    "count_X": 3_500_000.0,
    "count_Y": 12_345_678.0 - 4_500_000.0,
    "count_Z": -50_000.0 - 1_800_000.0,
    **{f"R_{name}": OHMS for name in SENSORS},
    "tool_x": 0.0,
    "tool_y": 0.0,
    "tool_z": -150.0,
    **dict.fromkeys(("direction_X", "direction_Y", "direction_Z"), 1.0),
}
OUTPUTS = ("abbe_status", "abbe_heartbeat", "corrected_X", "corrected_Y", "corrected_Z")


AIR = """
[links.air]
driver = "modbus"
host = "127.0.0.1"
[links.air.channels]
R_T_x1 = { table = "input", address = 0, type = "uint32", unit = "ohm" }
[links.floor]
driver = "modbus"
host = "127.0.0.2"
[links.floor.channels]
R_T_z1 = { table = "input", address = 0, type = "uint32", unit = "ohm" }
"""


@pytest.fixture
def configuration(tmp_path: Path) -> Configuration:
    return configured(tmp_path, QUICK)


def configured(tmp_path: Path, changes: dict[str, str], more: str = "") -> Configuration:
    text = (EXAMPLE / "config.toml").read_text(encoding="utf-8") + more
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "config.toml"
    path.write_text(text, encoding="utf-8")
    return load_config(path)


@pytest.fixture
def link() -> MemoryLink:
    return MemoryLink("cmm", VALUES)


class Run:
    """A pipeline that runs while a test does things to its link."""

    def __init__(self, configuration: Configuration, *links: MemoryLink) -> None:
        self.pipeline = Pipeline(configuration, {link.name: link for link in links})
        self.records: list[CycleRecord] = []
        self.pipeline.listeners.append(self.records.append)
        self.stop = asyncio.Event()

    async def during(self, story: Callable[[], Awaitable[None]]) -> None:
        task = asyncio.create_task(self.pipeline.run(self.stop))
        try:
            await story()
        finally:
            self.stop.set()
            await asyncio.wait_for(task, 20.0)

    async def until(self, what: Callable[[CycleRecord], bool]) -> CycleRecord:
        deadline = time.monotonic() + 20.0
        seen = len(self.records)
        while time.monotonic() < deadline:
            for record in self.records[seen:]:
                if what(record):
                    return record
            seen = len(self.records)
            await asyncio.sleep(0.002)
        raise AssertionError(f"not seen; the last cycle was {self.records[-1:]}")


async def seen(records: list[CycleRecord], count: int) -> None:
    deadline = time.monotonic() + 20.0
    while len(records) < count and time.monotonic() < deadline:  # noqa: ASYNC110
        await asyncio.sleep(0.01)
    assert len(records) >= count


def compensating(record: CycleRecord) -> bool:
    return record.decision.compensating


async def test_the_model_s_error_is_added_to_what_is_indicated(
    configuration: Configuration, link: MemoryLink
) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(compensating)
        await run.until(compensating)

    await run.during(story)
    record = next(r for r in run.records if r.decision.compensating)
    assert dict(zip(run.pipeline.axes, record.indicated, strict=True)) == pytest.approx(AT)
    at = Conditions.at(AT, tool=(0.0, 0.0, -150.0), signals=dict.fromkeys(SENSORS, 21.0))
    expected = configuration.model.axis_error(at)
    for axis, corrected in zip(run.pipeline.corrected_axes, record.corrected, strict=True):
        assert corrected - AT[axis] == pytest.approx(float(expected[axis][0]), abs=2e-5)
        assert abs(corrected - AT[axis]) > 1e-4
    written = link.written[record.number - 1]
    assert next(iter(written)) == "abbe_status"
    assert list(written)[-1] == "abbe_heartbeat"
    assert written["echo_sample"] == 4711.0
    names = [f"corrected_{axis}" for axis in run.pipeline.corrected_axes]
    assert [written[name] for name in names] == list(record.corrected)
    assert written["abbe_status"] == sum(
        (Status.RUNNING, Status.COMPENSATING, Status.X_ACTIVE, Status.Y_ACTIVE, Status.Z_ACTIVE)
    )
    beats = [w["abbe_heartbeat"] for w in link.written[:-1]]
    assert beats == [float((beats[0] + i) % (1 << 16)) for i in range(len(beats))]


async def test_the_end_is_a_ramp_and_a_word(configuration: Configuration, link: MemoryLink) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(compensating)

    await run.during(story)
    assert run.records[-1].decision.correction == (0.0, 0.0, 0.0)
    ramp = [r for r in run.records if r.status & Status.ENDING]
    assert len(ramp) > 3
    assert not any(r.status & Status.HOLDING for r in ramp)
    last = link.written[-1]
    assert last["abbe_status"] == STOPPED
    assert "corrected_X" not in last


async def test_a_missing_position_is_not_written_and_the_others_hold(
    configuration: Configuration, link: MemoryLink
) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        before = (await run.until(compensating)).decision.correction
        link.values["count_Y"] = None
        link.values["count_X"] = 3_600_000.0
        held = await run.until(lambda r: r.decision.states[0] is GuardState.HOLDING)
        assert held.decision.correction == before
        assert held.faults["axis Y"] == "no answer"
        written = link.written[held.number - 1]
        assert "corrected_Y" not in written
        assert "echo_sample" not in written
        assert written["corrected_X"] == pytest.approx(360.0 + before[0])
        assert int(written["abbe_status"]) & Status.POSITION_FAULT
        off = await run.until(lambda r: r.decision.states[2] is GuardState.OFF)
        assert off.corrected[run.pipeline.corrected_axes.index("X")] == pytest.approx(360.0)
        link.values["count_Y"] = VALUES["count_Y"]
        await run.until(compensating)

    await run.during(story)


@pytest.mark.parametrize("value", [2.0, 32767.0, 65535.0, 0.5])
async def test_a_direction_that_is_none_is_a_fault_of_its_axis(
    tmp_path: Path, link: MemoryLink, value: float
) -> None:
    model = load_model(EXAMPLE / "model.toml")
    play = make_effect("backlash", {"axis": "X"})
    values = {p.name: Value(0.001) for p in play.linear(model.machine)}
    with_play = replace(model, terms=(*model.terms, Term(play, values)), covariance=None)
    save_model(with_play, tmp_path / "play.toml")
    quick = {**QUICK, '"model.toml"': f'"{tmp_path / "play.toml"}"'}
    run = Run(configured(tmp_path, quick), link)

    async def story() -> None:
        before = (await run.until(compensating)).decision.correction
        link.values["direction_X"] = value
        held = await run.until(lambda r: r.decision.states[0] is GuardState.HOLDING)
        assert held.decision.correction == before
        assert held.faults["axis X"] == f"its direction reads {value:g}, which is none of 1, -1, 0"
        link.values["direction_X"] = -1.0
        await run.until(compensating)

    await run.during(story)


async def test_a_lost_thermistor_takes_its_own_axis_only(
    configuration: Configuration, link: MemoryLink
) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        before = await run.until(compensating)
        link.values["R_T_x1"] = 4.2e8
        off = await run.until(lambda r: r.decision.states[0] is GuardState.OFF)
        assert off.decision.correction[0] == 0.0
        assert off.decision.correction[1:] == before.decision.correction[1:]
        assert off.decision.states[1:] == (GuardState.ACTIVE, GuardState.ACTIVE)
        assert "broken wire" in off.faults["signal T_x1"]
        assert off.status & Status.SIGNAL_FAULT
        assert not off.status & (Status.X_ACTIVE | Status.COMPENSATING)
        assert off.status & Status.Y_ACTIVE
        link.values["R_T_x1"] = OHMS
        await run.until(compensating)

    await run.during(story)


async def test_nothing_is_corrected_for_an_unknown_tool(tmp_path: Path, link: MemoryLink) -> None:
    changes = {**QUICK, "signals_stale_after = 5.0": "signals_stale_after = 0.3"}
    link.values["tool_z"] = None
    run = Run(configured(tmp_path, changes), link)

    async def story() -> None:
        unknown = await run.until(lambda r: r.number > 20)
        assert unknown.decision.correction == (0.0, 0.0, 0.0)
        assert unknown.faults == {"tool": "no answer"}
        assert unknown.status & Status.SIGNAL_FAULT
        link.values["tool_z"] = -150.0
        await run.until(compensating)
        link.values["tool_z"] = None
        off = await run.until(lambda r: set(r.decision.states) == {GuardState.OFF})
        assert off.faults == {"tool": "no answer"}
        link.values["tool_z"] = -100.0
        await run.until(compensating)

    await run.during(story)


async def test_a_listener_that_fails_is_called_no_more_and_nothing_else_happens(
    configuration: Configuration, link: MemoryLink, caplog: pytest.LogCaptureFixture
) -> None:
    run = Run(configuration, link)
    records = []

    def broken(record: CycleRecord) -> None:
        records.append(record)
        raise ValueError("a bug in a screen")

    run.pipeline.listeners.insert(0, broken)

    async def story() -> None:
        await run.until(compensating)

    await run.during(story)
    assert len(records) == 1
    assert not any(r.status & Status.INTERNAL_FAULT for r in run.records)
    assert "a bug in a screen" in caplog.text


async def test_a_driver_that_raises_is_an_outage_not_an_end(
    configuration: Configuration, link: MemoryLink, caplog: pytest.LogCaptureFixture
) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(compensating)
        link.broken = RuntimeError("a bug in a driver")
        lost = await run.until(lambda r: r.decision.states[0] is GuardState.OFF)
        assert "a bug in a driver" in lost.faults["axis X"]
        assert set(link.written[-1]) == {"abbe_status", "abbe_heartbeat"}
        link.broken = None
        await run.until(compensating)

    with caplog.at_level(logging.INFO, "abbe"):
        await run.during(story)
    assert len([r for r in caplog.records if "its driver failed while reading" in r.message]) == 1


@pytest.mark.parametrize("error", [LinkDownError("pulled"), RuntimeError("a bug in a driver")])
async def test_a_write_that_fails_is_said_and_the_cycle_goes_on(
    configuration: Configuration, link: MemoryLink, error: Exception
) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(compensating)
        link.write_error = error
        failed = await run.until(lambda r: not r.written)
        assert str(error) in failed.faults["write-back"]
        assert failed.decision.compensating
        link.write_error = None
        assert (await run.until(lambda r: r.written)).decision.compensating

    await run.during(story)


async def test_a_link_that_is_down_is_not_written_to(
    configuration: Configuration, link: MemoryLink
) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(compensating)
        link.status.become(LinkState.DOWN, "cable pulled")
        down = await run.until(lambda r: "link cmm" in r.faults)
        assert down.faults == {"link cmm": "down: cable pulled"}
        count = len(link.written)
        await run.until(lambda r: r.number > down.number + 5)
        assert len(link.written) == count
        link.status.become(LinkState.UP)
        await run.until(lambda r: r.written)

    await run.during(story)


async def test_an_error_inside_a_cycle_stops_the_heartbeat_for_that_cycle_only(
    configuration: Configuration, link: MemoryLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(compensating)
        step = Guard.step
        with monkeypatch.context() as patch:
            patch.setattr(Guard, "step", lambda *_: 1 / 0)
            await asyncio.sleep(0.1)
            before = len(link.written)
            await asyncio.sleep(0.1)
            assert len(link.written) == before
        assert Guard.step is step
        internal = await run.until(lambda r: bool(r.status & Status.INTERNAL_FAULT))
        assert internal.written
        await run.until(compensating)

    await run.during(story)


async def test_every_transition_is_logged_once(
    configuration: Configuration, link: MemoryLink, caplog: pytest.LogCaptureFixture
) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(compensating)
        link.values["R_T_x1"] = 4.2e8
        await run.until(lambda r: r.decision.states[0] is GuardState.OFF)

    with caplog.at_level(logging.INFO, "abbe"):
        await run.during(story)
    lines = [r.message for r in caplog.records]
    assert len([line for line in lines if line.startswith("signal T_x1: broken wire")]) == 1
    logged = [line for line in lines if line.startswith("guard: ")]
    assert len(logged) == len(set(logged))
    assert logged[:3] == [
        "guard: X, Y, Z: correction ramped in",
        "guard: X, Y, Z: corrected in full",
        "guard: X: last good correction held",
    ]
    assert "guard: X: no correction" in logged
    assert logged[-1] == "guard: Y, Z: no correction"


async def test_a_slow_sensor_bus_does_not_slow_the_cycle_nor_does_a_hanging_one(
    tmp_path: Path, link: MemoryLink
) -> None:
    changes = {
        **QUICK,
        '"cmm.R_T_x1"': '"air.R_T_x1"',
        '"cmm.R_T_z1"': '"floor.R_T_z1"',
        "signals_stale_after = 5.0": "signals_stale_after = 0.3",
    }
    air, floor = MemoryLink("air", {"R_T_x1": OHMS}), MemoryLink("floor", {"R_T_z1": OHMS})
    floor.delay = 0.1
    run = Run(configured(tmp_path, changes, AIR), link, air, floor)
    assert run.pipeline.reads.keys() == {"cmm"}

    async def story() -> None:
        await run.until(compensating)
        air.hangs = True
        off = await run.until(lambda r: r.decision.states[0] is GuardState.OFF)
        assert off.decision.states[1:] == (GuardState.ACTIVE, GuardState.ACTIVE)
        assert "stale" in off.faults["signal T_x1"]
        count = len(run.records)
        await asyncio.sleep(0.2)
        assert len(run.records) > count + 5

    await run.during(story)


async def test_a_driver_that_hangs_cannot_keep_the_service_from_ending(
    configuration: Configuration, link: MemoryLink
) -> None:
    """Nor the controller from being told, where its own link still writes."""
    service = Service(configuration, {"cmm": link})
    records: list[CycleRecord] = []
    service.add([records.append])
    task = asyncio.create_task(service.run())
    await seen(records, 1)
    link.hangs = True
    await asyncio.sleep(0.05)
    service.stop()
    with pytest.raises(AbbeError, match="without ramping the correction down"):
        await asyncio.wait_for(task, 60.0)
    assert link.written[-1] == {"abbe_status": STOPPED}
    assert link.status.state is LinkState.CLOSED


class DeafLink(MemoryLink):
    """Its driver does not come back from a write when it `is_deaf`."""

    is_deaf = False

    async def write(self, values: Mapping[str, float], *, until: float = math.inf) -> None:
        if self.is_deaf:
            await asyncio.Event().wait()
        await super().write(values, until=until)


async def test_a_driver_that_hangs_while_it_writes_is_reported_with_what_the_controller_holds(
    configuration: Configuration,
) -> None:
    link = DeafLink("cmm", dict(VALUES) | dict.fromkeys(OUTPUTS, 0.0))
    service = Service(configuration, {"cmm": link})
    records: list[CycleRecord] = []
    service.add([records.append])
    task = asyncio.create_task(service.run())
    await seen(records, 100)
    assert compensating(records[-1])
    link.is_deaf = True
    service.stop()
    with pytest.raises(NotReportedError) as caught:
        await asyncio.wait_for(task, 60.0)
    message = str(caught.value)
    assert "link cmm does not come back" in message
    word, x = (link.written[-1][name] for name in ("abbe_status", "corrected_X"))
    assert f"status word {int(word):#06x} (RUNNING COMPENSATING" in message
    assert f"X {x:.10g} mm since" in message


async def test_the_word_goes_with_what_cannot_be_sent_apart_from_it(
    configuration: Configuration, link: MemoryLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Status and heartbeat are signals of one CAN message."""
    together = frozenset(("abbe_status", "abbe_heartbeat"))
    monkeypatch.setattr(
        link, "goes_with", lambda name: together if name in together else frozenset((name,))
    )
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(compensating)

    await run.during(story)
    before, last = link.written[-2:]
    assert last == {"abbe_status": STOPPED, "abbe_heartbeat": before["abbe_heartbeat"]}


async def test_a_second_stop_leaves_out_the_ramp_but_not_the_word(
    tmp_path: Path, link: MemoryLink
) -> None:
    slow = {**QUICK, "ramp = 2.0": "ramp = 60.0"}
    service = Service(configured(tmp_path, slow), {"cmm": link})
    records: list[CycleRecord] = []
    service.add([records.append])
    task = asyncio.create_task(service.run())
    await seen(records, 20)
    service.stop()
    await asyncio.sleep(0.05)
    assert not task.done()
    service.stop()
    await asyncio.wait_for(task, 30.0)
    assert link.written[-1]["abbe_status"] == STOPPED
    assert any(records[-1].decision.correction)
