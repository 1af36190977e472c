"""What is doubted in the live path: what is old, far gone, our own, or somebody else's."""

from __future__ import annotations

import asyncio
import math
import time
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Signal
from abbe.daemon.config import Configuration, load_config
from abbe.daemon.config.sections.readings import SignalSection
from abbe.daemon.guard import GuardState
from abbe.daemon.pipeline.reading.controller_watch import Beat, DeviceClock
from abbe.daemon.pipeline.reading.expected import bounds_of, expected_of
from abbe.daemon.pipeline.reading.motion import SampleSpeeds
from abbe.daemon.pipeline.reading.plausible import Plausible, PlausibleBounds, SimilarSensors
from abbe.daemon.pipeline.writing.own_writes import Follow
from abbe.daemon.status_word import Status
from abbe.drivers.link import ChannelInfo, LinkError, Sample, WirePlace
from abbe.drivers.transducers import SteinhartHartConfig, make_transducer
from tests.daemon.pipeline.test_pipeline import AT, EXAMPLE, OHMS, QUICK, VALUES, Run, configured
from tests.support.daemon.memory_link import MemoryLink

THERMISTOR = make_transducer(SteinhartHartConfig(a=1.032e-3, b=2.387e-4, c=1.580e-7))


@pytest.fixture
def configuration(tmp_path: Path) -> Configuration:
    return configured(tmp_path, QUICK)


@pytest.fixture
def link() -> MemoryLink:
    return MemoryLink("cmm", VALUES)


class LateLink(MemoryLink):
    """Its answers are as old as `late`, s: they were taken when the question left."""

    late = 0.0

    async def read(self, channels):
        samples = await super().read(channels)
        return {n: s._replace(time=s.time - self.late) for n, s in samples.items()}


async def test_an_answer_that_comes_late_is_an_old_position(configuration: Configuration) -> None:
    link = LateLink("cmm", VALUES)
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: r.decision.compensating)
        link.late = 1.5
        record = await run.until(lambda r: bool(r.status & Status.POSITION_FAULT))
        assert "stale: 1.5 s old" in record.faults["axis X"]
        first = len(link.written)
        await asyncio.sleep(0.1)
        assert all("corrected_X" not in batch for batch in link.written[first:])

    await run.during(story)


async def test_what_is_written_has_an_end(configuration: Configuration) -> None:
    ends = []

    class Watching(LateLink):
        async def write(self, values, *, until=math.inf):
            if "corrected_X" in values:
                ends.append(until - time.monotonic())
            await super().write(values, until=until)

    run = Run(configuration, Watching("cmm", VALUES))
    await run.during(lambda: run.until(lambda r: r.decision.compensating))
    assert ends
    assert max(ends) <= configuration.limits.longest_step


async def test_refused_writes_are_a_fault_and_no_step(
    configuration: Configuration, link: MemoryLink
) -> None:
    run = Run(configuration, link)

    def held() -> float:
        return next(b["corrected_X"] for b in reversed(link.written) if "corrected_X" in b)

    async def story() -> None:
        await run.until(lambda r: r.decision.compensating)
        before = held()
        refused = LinkError("exception 2").leaving(untouched=VALUES)
        link.write_error = refused
        record = await run.until(lambda r: bool(r.status & Status.WRITE_FAULT))
        assert not record.status & (Status.COMPENSATING | Status.X_ACTIVE)
        # the machine warms up meanwhile: the correction changes by far more than a step may
        link.values.update({f"R_T_{n}": THERMISTOR.inverse(25.0) for n in ("x1", "x2")})
        await asyncio.sleep(0.5)
        count = len(link.written)
        link.write_error = None
        while len(link.written) == count:  # noqa: ASYNC110
            await asyncio.sleep(0.001)
        first = link.written[count]["corrected_X"]
        limits = configuration.limits
        assert abs(first - before) <= limits.max_rate * limits.longest_step + 1e-9

    await run.during(story)


async def test_a_position_that_is_what_was_written_stops_and_says_so(
    configuration: Configuration,
) -> None:
    """The machine stands still; what is written comes back as its position."""

    class Mirror(MemoryLink):
        async def write(self, values, *, until=math.inf):
            await super().write(values, until=until)
            if "corrected_X" in values:
                self.values["count_X"] = round(values["corrected_X"] * 1e4)

    link = Mirror("cmm", VALUES)
    run = Run(configuration, link)

    async def story() -> None:
        record = await run.until(lambda r: bool(r.status & Status.FOREIGN))
        assert "is what Abbe writes" in record.faults["controller"]
        walked = link.values["count_X"]
        await run.until(lambda r: r.decision.states == (GuardState.OFF,) * 3)
        assert link.values["count_X"] == walked
        assert abs(walked / 1e4 - AT["X"]) < 0.05

    await run.during(story)


async def test_a_second_writer_is_noticed(configuration: Configuration) -> None:
    class Shared(MemoryLink):
        def info(self, channel: str) -> ChannelInfo:
            return ChannelInfo(writable=True, read_back=channel.startswith("corrected"))

        async def write(self, values, *, until=math.inf):
            await super().write(values, until=until)
            self.values.update(values)
            if self.values.get("other"):
                self.values["corrected_Y"] = values.get("corrected_Y", 0.0) + 0.0077

    at_first = {f"corrected_{axis}": AT[axis] for axis in AT}
    link = Shared("cmm", {**VALUES, **at_first, "other": 0.0})
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: r.decision.compensating)
        await asyncio.sleep(1.1)
        assert not run.records[-1].status & Status.FOREIGN
        link.values["other"] = 1.0
        record = await run.until(lambda r: bool(r.status & Status.FOREIGN))
        assert "somebody else writes cmm.corrected_Y" in record.faults["controller"]
        await run.until(lambda r: r.decision.states == (GuardState.OFF,) * 3)

    await run.during(story)


async def test_a_thermometer_that_jumps_is_a_fault(
    configuration: Configuration, link: MemoryLink
) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: r.decision.compensating)
        link.values["R_T_x1"] = THERMISTOR.inverse(60.0)
        record = await run.until(lambda r: bool(r.status & Status.SIGNAL_FAULT))
        assert "jumped from 21 to 60 degC" in record.faults["signal T_x1"]
        await run.until(lambda r: r.decision.states[0] is GuardState.OFF)
        link.values["R_T_x1"] = OHMS
        await run.until(lambda r: r.decision.compensating)

    await run.during(story)


@pytest.mark.parametrize("tool", [1e5, -701.0, 901.0])
async def test_a_tool_longer_than_the_machine_is_not_believed(
    configuration: Configuration, link: MemoryLink, tool: float
) -> None:
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: r.decision.compensating)
        link.values["tool_z"] = tool if abs(tool) > 900.0 else 1e3
        record = await run.until(lambda r: "tool" in r.faults)
        assert "mm is not -900 to 900 mm" in record.faults["tool"]

    await run.during(story)


def test_a_jump_is_believed_when_it_is_back_or_became_likely() -> None:
    plausible = Plausible({"T": PlausibleBounds(-30.0, 100.0, 0.5, "degC")})
    assert plausible.doubt("T", 20.0, 0.0) == ""
    assert plausible.doubt("T", 20.9, 0.25) == ""
    assert "jumped from 20.9 to 60" in plausible.doubt("T", 60.0, 0.5)
    assert plausible.doubt("T", 60.0, 600.0)
    assert plausible.doubt("T", 21.0, 601.0) == ""
    assert plausible.doubt("T", 30.0, 610.0)
    assert plausible.doubt("T", 30.0, 610.0 + 9.0 * 120.0) == ""
    assert "is not -30 to 100" in plausible.doubt("T", 101.0, 2000.0)


def test_a_long_silence_is_no_jump() -> None:
    plausible = Plausible({"T": PlausibleBounds(-30.0, 100.0, 0.5, "degC")})
    plausible.doubt("T", 20.0, 0.0)
    assert plausible.doubt("T", 28.0, 3600.0) == ""


class _Reading:
    def __init__(self, value: float, fault: str = "") -> None:
        self.value, self.fault = value, fault


def test_likes_are_compared() -> None:
    similar = SimilarSensors(("a", "b", "c"), 15.0, "scale", "degC")
    plausible = Plausible({}, (similar,))
    readings = {"a": _Reading(20.0), "b": _Reading(21.0), "c": _Reading(40.0)}
    assert set(plausible.compared(readings)) == {"c"}
    readings["b"] = _Reading(21.0, "broken wire")
    assert set(plausible.compared(readings)) == {"a", "c"}
    readings["c"] = _Reading(30.0)
    assert plausible.compared(readings) == {}


@given(st.floats(0.0005, 0.1), st.integers(0, 50), st.floats(-2.0, 2.0))
def test_an_axis_that_moves_by_its_correction_is_not_taken_for_our_own(
    correction: float, cycles: int, onward: float
) -> None:
    """It may be left unwritten for some cycles; when it then moves on, nothing is wrong."""
    follow = Follow([1e-4])
    position = 100.0
    for _ in range(cycles):
        if not follow.doubts([position]):
            follow.wrote([position], [position + correction])
        position += correction
    for _ in range(20):
        position += onward
        if not follow.doubts([position]):
            follow.wrote([position], [position + correction])
    if abs(onward) > 1e-3:
        assert follow.faults() == []


def test_speeds_follow_from_positions_and_their_times() -> None:
    motion = SampleSpeeds(2)
    for k in range(5):
        motion.step([20.0 * k, 1.0], 1.0 * k)
    assert motion.speeds == (20.0, 0.0)
    motion.step([math.nan, 1.0], 5.0)
    assert motion.speeds == (20.0, 0.0)
    motion.step([200.0, 1.0], 5.001)
    assert motion.speeds == (20.0, 0.0)


async def test_a_position_too_far_under_way_is_not_used(
    tmp_path: Path,
) -> None:
    """The example's machine with max_lag: X moves at 500 mm/s, its answers take 10 ms."""
    configuration = configured(tmp_path, {**QUICK, "hold = 0.1": "hold = 0.1\nmax_lag = 1.0"})

    class Moving(LateLink):
        speed = 0.0

        async def read(self, channels):
            moved = self.speed * 1e4 * (time.monotonic() - self.last)
            self.values["count_X"] += round(moved)
            self.last = time.monotonic()
            return await super().read(channels)

    link = Moving("cmm", VALUES)
    link.last, link.late = time.monotonic(), 0.01
    run = Run(configuration, link)

    async def story() -> None:
        await run.until(lambda r: r.decision.compensating)
        link.values["count_X"], link.speed = 0.0, 500.0
        record = await run.until(lambda r: bool(r.status & Status.POSITION_FAULT))
        assert "may have moved by" in record.faults["axis X"]

    await run.during(story)


def test_a_devices_clock_dates_its_samples() -> None:
    clock = DeviceClock()
    assert clock.moment(100.0, 1000.02) == pytest.approx(1000.02)
    assert clock.moment(101.0, 1001.01) == pytest.approx(1001.01)
    # sampled at 102, answered 1.5 s later
    assert clock.moment(102.0, 1003.51) == pytest.approx(1002.01)
    # begun anew
    assert clock.moment(0.5, 1010.0) == pytest.approx(1010.0)


def test_a_heartbeat_that_changed_unseen_may_have_changed_long_ago() -> None:
    """The controller froze while a cycle waited for 2 s: what it shows now is not of now."""
    beat = Beat()
    beat.take(1.0, 10.00)
    assert beat.since == 10.00
    beat.take(2.0, 10.02)
    assert beat.since == 10.00
    beat.take(2.0, 10.04)
    beat.take(3.0, 12.00)
    assert beat.since == 10.04
    beat.take(4.0, 12.02)
    assert beat.since == 12.00


BAD_CONFIGURATIONS = {
    "a memory that may be the same": (
        'separate = ["tables"]',
        "separate = []",
        "cmm.corrected_X would overwrite what is read as cmm.sample: many devices",
    ),
    "status in a slow block": (
        'status = { table = "input", address = 0, type = "uint16" }',
        'status = { table = "input", address = 0, type = "uint16", block = "slow" }',
        "values of cmm.status come every 30 s",
    ),
    "heartbeat in a bit": (
        'abbe_heartbeat = { table = "holding", address = 1, type = "uint16"',
        'abbe_heartbeat = { table = "coil", address = 1, type = "bit"',
        "cannot hold 4",
    ),
    "a position that goes below zero in a uint32": (
        'corrected_Z = { table = "holding", address = 6, type = "int32"',
        'corrected_Z = { table = "holding", address = 6, type = "uint32"',
        "cannot hold -360.1 mm",
    ),
}


@pytest.mark.parametrize("case", BAD_CONFIGURATIONS)
def test_what_cannot_be_written_safely_is_refused(case: str, tmp_path: Path) -> None:
    old, new, said = BAD_CONFIGURATIONS[case]
    text = (EXAMPLE / "config.toml").read_text(encoding="utf-8")
    assert old in text, text
    text = text.replace(old, new).replace('"model.toml"', f'"{EXAMPLE / "model.toml"}"')
    slow = "[links.cmm.blocks]\nslow = { every = 30.0 }\n"
    text = text.replace("[links.cmm.channels]", f"{slow}[links.cmm.channels]")
    path = tmp_path / "config.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said):
        load_config(path)


def test_places_overlap_across_tables_and_units_unless_apart() -> None:
    def place(unit: str, table: str, apart: tuple[bool, bool]) -> WirePlace:
        return WirePlace("tcp 10.0.0.1:502 registers", 4, 6, (unit, table), apart)

    both = (False, False)
    here = place("unit 1", "holding", both)
    assert here.overlaps(place("unit 1", "input", both))
    assert here.overlaps(place("unit 2", "holding", both))
    tables = (False, True)
    here = place("unit 1", "holding", tables)
    assert not here.overlaps(place("unit 1", "input", tables))
    assert here.overlaps(place("unit 2", "holding", tables))
    assert here.overlaps(place("unit 1", "input", both))
    assert not here.overlaps(
        WirePlace("tcp 10.0.0.1:502 registers", 6, 8, ("unit 1", "holding"), tables)
    )


def test_a_sample_is_as_old_as_its_question() -> None:
    assert Sample(1.0, 10.0).age(10.5) == 0.5


def test_a_temperature_is_believed_near_where_it_was_measured() -> None:
    signal = Signal("T", "degC", "structure")
    assert bounds_of(signal, SignalSection(source="a.b")).high == 100.0
    near = bounds_of(signal, SignalSection(source="a.b"), (18.0, 24.0))
    assert (near.low, near.high) == (3.0, 39.0)
    bounds = bounds_of(signal, SignalSection(source="a.b", range=(0.0, 60.0)), (18.0, 24.0))
    assert (bounds.low, bounds.high) == (0.0, 60.0)
    load = bounds_of(Signal("m", "kg", "load"), SignalSection(source="a.b"), (0.0, 10.0))
    assert load.high == 1e6


def test_thermometers_of_one_role_may_be_as_far_apart_as_they_were(tmp_path: Path) -> None:
    configuration = configured(tmp_path, QUICK)
    links = configuration.make_links()
    scales = expected_of(configuration, ("X", "Y", "Z"), links).similar
    assert [similar.apart for similar in scales if similar.role == "scale"] == [30.0]
    names = [n for n, s in configuration.model.machine.signals.items() if s.role == "scale"]
    ranges = {name: [18.0 + i, 38.0 + i] for i, name in enumerate(names)}
    model = replace(configuration.model, fit={"measured": {"signals": ranges}})
    scales = expected_of(replace(configuration, model=model), ("X", "Y", "Z"), links).similar
    assert [similar.apart for similar in scales] == [20.0 + len(names) - 1]
