"""Guard and write-back together: what the *controller has* keeps the guard's promises.

A Hypothesis state machine drives whole cycles of the pipeline against a controller that takes,
refuses, delays, drops and half-takes what is written, on a clock of its own. After each message
the correction that the controller then has (held position − position of the sample that it is for)
must be no larger than stated, and no further from the one before than its rate allows.
"""

from __future__ import annotations

import asyncio
import math
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from abbe.daemon.config import Configuration, load_config
from abbe.daemon.guard import Decision
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.daemon.status_word import Status
from abbe.drivers.link import ChannelInfo, Link, LinkConfig, LinkError, LinkState, Quality, Sample

AXES = ("X", "Y", "Z")
SLOPES = {"X": 1e-4, "Y": -1.5e-4, "Z": 8e-5}
RATE, LONGEST, MOST, NORM = 0.06, 0.2, 0.08, 0.1
TINY = 1e-9

MODEL = """format = "abbe-model/1"
[machine]
name = "Machine of numbers"
structure = "w b Y X Z t"
reference_temperature = 20.0
[machine.axes]
X = { travel = [0, 600] }
Y = { travel = [0, 600] }
Z = { travel = [0, 600] }
""" + "".join(
    f'[[effects]]\nkind = "scale"\naxis = "{axis}"\n'
    f'[effects.parameters.k]\nvalue = {slope}\nsd = 1e-7\nunit = "1"\n'
    for axis, slope in SLOPES.items()
)
CONFIG = f"""format = "abbe-config/1"
model = "model.toml"
[guard]
max_correction = {MOST}
max_norm = {NORM}
max_rate = {RATE}
stale_after = {LONGEST}
hold = 0.4
ramp = 2.0
[axes]
X = {{ source = "m.X" }}
Y = {{ source = "m.Y" }}
Z = {{ source = "m.Z" }}
[output]
status = "m.out_status"
heartbeat = "m.out_beat"
[output.axes]
X = {{ target = "m.out_X" }}
Y = {{ target = "m.out_Y" }}
Z = {{ target = "m.out_Z" }}
[links.m]
driver = "modbus"
host = "127.0.0.1"
[links.m.channels]
X = {{ table = "input", address = 0, type = "float64", unit = "mm" }}
Y = {{ table = "input", address = 4, type = "float64", unit = "mm" }}
Z = {{ table = "input", address = 8, type = "float64", unit = "mm" }}
out_status = {{ table = "holding", address = 100, type = "uint16", writable = true }}
out_beat = {{ table = "holding", address = 101, type = "uint16", writable = true }}
out_X = {{ table = "holding", address = 102, type = "float64", unit = "mm", writable = true }}
out_Y = {{ table = "holding", address = 106, type = "float64", unit = "mm", writable = true }}
out_Z = {{ table = "holding", address = 110, type = "float64", unit = "mm", writable = true }}
"""

FATES = ("taken", "refused", "taken unsaid", "lost unsaid", "not sent", "driver fails")
"""Of one message: what the controller does with it, and what the link can say of it."""


class Clock:
    """The time of everything in a test, s."""

    now = 1000.0

    def monotonic(self) -> float:
        return self.now


class Controller(Link):
    """Serves positions and takes messages, each with a fate of its own."""

    Config = LinkConfig

    def __init__(self, clock: Clock, messages: Sequence[frozenset[str]]) -> None:
        super().__init__("m", LinkConfig())
        self._clock = clock
        self._messages = messages
        self.place = dict.fromkeys(AXES, 300.0)
        self.bad: frozenset[str] = frozenset()
        self.age = 0.0
        self.fates: list[str] = []
        self.slow = 0.0
        self.taken: list[dict[str, float]] = []
        self.status.become(LinkState.UP)

    @property
    def channels(self) -> Mapping[str, str]:
        return dict.fromkeys((*AXES, *(f"out_{a}" for a in AXES), "out_status", "out_beat"), "")

    def info(self, channel: str) -> ChannelInfo:
        return ChannelInfo(unit="mm", writable=channel.startswith("out_"))

    def goes_with(self, channel: str) -> frozenset[str]:
        return next((m for m in self._messages if channel in m), frozenset((channel,)))

    async def open(self) -> None:
        pass

    async def close(self) -> None:
        pass

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        taken_at = self._clock.now - self.age
        return {
            name: Sample(math.nan, taken_at, Quality.BAD, "exception 4")
            if name in self.bad
            else Sample(self.place[name], taken_at)
            for name in channels
        }

    async def write(self, values: Mapping[str, float], *, until: float = math.inf) -> None:
        left = dict(values)
        said: set[str] = set()
        unsaid: set[str] = set()
        problem = ""
        for message in (*self._messages, frozenset(values)):
            part = {name: left.pop(name) for name in list(left) if name in message}
            if not part:
                continue
            self._clock.now += self.slow
            fate = self.fates.pop(0) if self.fates else "taken"
            if self._clock.now > until:
                fate = "not sent"
            if fate in ("taken", "taken unsaid"):
                self.taken.append(part)
            if fate == "driver fails":
                raise RuntimeError("a driver's bug")
            if fate == "taken":
                said |= part.keys()
            elif fate in ("taken unsaid", "lost unsaid"):
                unsaid |= part.keys()
            problem = problem if fate == "taken" else fate
        if problem:
            untouched = values.keys() - said - unsaid
            raise LinkError(problem).leaving(untouched=untouched, written=said)


ALL = frozenset(f"out_{axis}" for axis in AXES)
STATE = frozenset(("out_status", "out_beat"))
PACKINGS = (
    (ALL | STATE,),
    (STATE, ALL),
    (STATE, frozenset(("out_X", "out_Y")), frozenset(("out_Z",))),
    (STATE, *(frozenset((f"out_{axis}",)) for axis in AXES)),
)
"""Which channels go out in one message."""


@pytest.fixture(scope="module", autouse=True)
def _configured() -> None:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "model.toml").write_text(MODEL, encoding="utf-8")
        (folder / "config.toml").write_text(CONFIG, encoding="utf-8")
        Machine.configuration = load_config(folder / "config.toml")


class Machine(RuleBasedStateMachine):
    """A controller, a pipeline, and what the controller has of it."""

    configuration: Configuration

    def __init__(self) -> None:
        super().__init__()
        self.clock = Clock()
        self.loop = asyncio.new_event_loop()
        self.monkeypatch = pytest.MonkeyPatch()
        self.monkeypatch.setattr(time, "monotonic", self.clock.monotonic)
        self.had = dict.fromkeys(AXES, (0.0, self.clock.now))
        """Axis → correction that the controller has, mm, and when it was worked out, s."""
        self.decision: Decision | None = None

    @initialize(packing=st.sampled_from(PACKINGS))
    def begin(self, packing: tuple[frozenset[str], ...]) -> None:
        self.link = Controller(self.clock, packing)
        self.pipeline = Pipeline(self.configuration, {"m": self.link})
        self.cycles(60, 0.04)

    def teardown(self) -> None:
        self.monkeypatch.undo()
        self.loop.close()

    def cycle(self, elapsed: float) -> None:
        self.clock.now += elapsed
        began = self.clock.now
        place = dict(self.link.place)
        record = self.loop.run_until_complete(self.pipeline.cycle())
        self.decision = record.decision
        for message in self.link.taken:
            for name, value in message.items():
                axis = name.removeprefix("out_")
                if axis in place:
                    assert axis not in self.link.bad, f"{axis} was written from a bad position"
                    self.have(axis, value - place[axis], began)
            word = Status(int(message.get("out_status", 0)))
            if Status.COMPENSATING in word:
                assert not self.link.bad
                assert self.link.age <= LONGEST
        self.link.taken.clear()

    def have(self, axis: str, correction: float, now: float) -> None:
        before, since = self.had[axis]
        allowed = RATE * min(now - since, LONGEST) + TINY
        assert abs(correction - before) <= allowed, (
            f"{axis}: from {1e3 * before:.3f} to {1e3 * correction:.3f} µm in {now - since:.3f} s, "
            f"at most {1e3 * allowed:.3f}"
        )
        self.had[axis] = correction, now

    def cycles(self, count: int, elapsed: float = 0.02) -> None:
        for _ in range(count):
            self.cycle(elapsed)

    @rule(count=st.integers(1, 60), elapsed=st.sampled_from((0.001, 0.02, 0.15)))
    def goes_on(self, count: int, elapsed: float) -> None:
        self.cycles(count, elapsed)

    @rule(place=st.sampled_from((100.0, 300.0, 500.0)))
    def recovers(self, place: float) -> None:
        """All is well until everything is corrected in full."""
        self.link.place = dict.fromkeys(AXES, place)
        self.cycles(80, 0.05)
        if place <= 300.0:  # farther out the correction is too long
            assert self.decision is not None
            assert self.decision.compensating

    @rule(
        place=st.tuples(*[st.sampled_from((0.0, 80.0, 300.0, 520.0, 600.0))] * 3),
        count=st.sampled_from((1, 150)),
    )
    def moves(self, place: tuple[float, float, float], count: int) -> None:
        self.link.place = dict(zip(AXES, place, strict=True))
        self.cycles(count)

    @rule(axis=st.sampled_from(AXES), way=st.floats(-20.0, 20.0))
    def moves_a_little(self, axis: str, way: float) -> None:
        self.link.place[axis] = min(max(self.link.place[axis] + way, 0.0), 600.0)
        self.cycle(0.02)

    @rule(fates=st.lists(st.sampled_from(FATES), min_size=1, max_size=4))
    def once(self, fates: list[str]) -> None:
        self.link.fates = list(fates)
        self.cycle(0.02)
        self.link.fates = []

    @rule(
        fate=st.sampled_from(FATES[1:]),
        count=st.sampled_from((150, 30, 3)),
        way=st.sampled_from((2.0, -2.0, 0.3, 20.0)),
        back_and_forth=st.booleans(),
        then=st.lists(st.sampled_from(FATES), max_size=3),
    )
    def for_long(
        self, fate: str, count: int, way: float, back_and_forth: bool, then: list[str]
    ) -> None:
        """From full correction on one fate for all messages, while X moves by `way` a cycle."""
        self.recovers(300.0)
        for k in range(1, count + 1):
            self.link.fates = [fate] * 5
            gone = (-1) ** k * way if back_and_forth else k * way
            self.link.place["X"] = min(max(300.0 + gone, 0.0), 600.0)
            self.cycle(0.02)
        self.link.fates = list(then)
        self.cycle(0.02)
        self.link.fates = []

    @rule(slow=st.sampled_from((0.03, 0.09, 0.3)), age=st.sampled_from((0.0, 0.1, 0.19)))
    def is_slow(self, slow: float, age: float) -> None:
        self.link.slow, self.link.age = slow, age
        self.cycles(3)
        self.link.slow = self.link.age = 0.0

    @rule(bad=st.frozensets(st.sampled_from(AXES), min_size=1), count=st.integers(1, 150))
    def loses_positions(self, bad: frozenset[str], count: int) -> None:
        self.link.bad = bad
        self.cycles(count)
        self.link.bad = frozenset()

    @rule(count=st.integers(1, 60), age=st.sampled_from((0.21, 1.5)))
    def answers_late(self, count: int, age: float) -> None:
        self.link.age = age
        self.cycles(count)
        self.link.age = 0.0

    @rule(count=st.integers(1, 150))
    def is_down(self, count: int) -> None:
        self.link.status.become(LinkState.DOWN)
        self.link.bad = frozenset(AXES)
        self.cycles(count)
        self.link.status.become(LinkState.UP)
        self.link.bad = frozenset()

    @rule(seconds=st.sampled_from((0.5, 5.0, 3600.0)))
    def pauses(self, seconds: float) -> None:
        self.cycle(seconds)

    @invariant()
    def no_correction_is_too_large(self) -> None:
        for axis, (correction, _) in self.had.items():
            assert abs(correction) <= MOST + TINY, axis
        if self.link.goes_with("out_X") >= ALL:
            assert math.hypot(*(c for c, _ in self.had.values())) <= NORM + TINY


Machine.TestCase.settings = settings(max_examples=60, stateful_step_count=15)
TestGuardAndWriteBack = Machine.TestCase
