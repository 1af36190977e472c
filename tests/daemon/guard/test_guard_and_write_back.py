"""Guard and write-back together: what the *controller has* keeps the guard's promises.

Once with X, Y, Z, once with a rotary table and a head that are corrected too.

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
from typing import ClassVar

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from abbe.daemon.config import Configuration, load_config
from abbe.daemon.guard import Decision
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.daemon.status_word import Status
from abbe.drivers.link import ChannelInfo, Link, LinkConfig, LinkError, LinkState, Quality, Sample

RATE, LONGEST, MOST, NORM = 0.06, 0.2, 0.08, 0.1
TURN_RATE, MOST_TURN = math.radians(0.01), math.radians(0.015)
TINY = 1e-9
ROTARY = "BC"


def unit(axis: str) -> str:
    return "rad" if axis in ROTARY else "mm"


def model_text(structure: str, effects: Mapping[tuple[str, str], float]) -> str:
    """A model of scales (mm/mm), and of angles about X, Y or Z that grow evenly (rad)."""
    axes = [a for a in structure.replace("'", "").split() if a not in "wbt"]
    travels = {a: [-180, 180] if a in ROTARY else [0, 600] for a in axes}
    return (
        f"""format = "abbe-model/1"
[machine]
name = "Machine of numbers"
structure = "{structure}"
reference_temperature = 20.0
[machine.axes]
"""
        + "".join(f"{a} = {{ travel = {t} }}\n" for a, t in travels.items())
        + "".join(
            f'[[effects]]\nkind = "scale"\naxis = "{axis}"\n'
            f'[effects.parameters.k]\nvalue = {slope}\nsd = 1e-7\nunit = "1"\n'
            if motion == "scale"
            else f'[[effects]]\nkind = "angular"\naxis = "{axis}"\nabout = "{motion}"\n'
            f'shape = "polynomial:1"\n'
            f'[effects.parameters.c0]\nvalue = {0.5 * slope}\nsd = 1e-9\nunit = "rad"\n'
            f'[effects.parameters.c1]\nvalue = {slope}\nsd = 1e-9\nunit = "rad"\n'
            for (axis, motion), slope in effects.items()
        )
    )


def config_text(axes: Sequence[str]) -> str:
    turned = [a for a in axes if a in ROTARY]
    limits = "max_turn = 0.015\nmax_turn_rate = 0.01\n" if turned else ""
    return (
        f"""format = "abbe-config/1"
model = "model.toml"
[guard]
max_correction = {MOST}
max_norm = {NORM}
max_rate = {RATE}
{limits}stale_after = {LONGEST}
hold = 0.4
ramp = 2.0
[output]
status = "m.out_status"
heartbeat = "m.out_beat"
[links.m]
driver = "modbus"
host = "127.0.0.1"
[links.m.channels]
out_status = {{ table = "holding", address = 100, type = "uint16", writable = true }}
out_beat = {{ table = "holding", address = 101, type = "uint16", writable = true }}
"""
        + "".join(
            f'{a} = {{ table = "input", address = {4 * i}, type = "float64", '
            f'unit = "{unit(a)}" }}\n'
            f'out_{a} = {{ table = "holding", address = {102 + 4 * i}, type = "float64", '
            f'unit = "{unit(a)}", writable = true }}\n'
            for i, a in enumerate(axes)
        )
        + "".join(
            f'[axes.{a}]\nsource = "m.{a}"\n[output.axes.{a}]\ntarget = "m.out_{a}"\n' for a in axes
        )
    )


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

    def __init__(
        self, clock: Clock, messages: Sequence[frozenset[str]], axes: Sequence[str]
    ) -> None:
        super().__init__("m", LinkConfig())
        self._clock = clock
        self._messages = messages
        self._axes = tuple(axes)
        self.place = middle(axes)
        self.bad: frozenset[str] = frozenset()
        self.age = 0.0
        self.fates: list[str] = []
        self.slow = 0.0
        self.taken: list[dict[str, float]] = []
        self.status.become(LinkState.UP)

    @property
    def channels(self) -> Mapping[str, str]:
        written = (f"out_{a}" for a in self._axes)
        return dict.fromkeys((*self._axes, *written, "out_status", "out_beat"), "")

    def info(self, channel: str) -> ChannelInfo:
        return ChannelInfo(unit=unit(channel[-1]), writable=channel.startswith("out_"))

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


def middle(axes: Sequence[str], place: float = 300.0) -> dict[str, float]:
    """All linear axes at one place, the rotary ones where both are needed."""
    return {a: 0.6 if a in ROTARY else place for a in axes}


STATE = frozenset(("out_status", "out_beat"))


def packings(axes: Sequence[str]) -> tuple[tuple[frozenset[str], ...], ...]:
    """Which channels go out in one message."""
    every = frozenset(f"out_{a}" for a in axes)
    return (
        (every | STATE,),
        (STATE, every),
        (STATE, frozenset(("out_X", "out_Y")), every - {"out_X", "out_Y"}),
        (STATE, *(frozenset((f"out_{a}",)) for a in axes)),
    )


def configured(axes: Sequence[str], text: str) -> Configuration:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "model.toml").write_text(text, encoding="utf-8")
        (folder / "config.toml").write_text(config_text(axes), encoding="utf-8")
        return load_config(folder / "config.toml")


class Machine(RuleBasedStateMachine):
    """A controller, a pipeline, and what the controller has of it."""

    axes: ClassVar[tuple[str, ...]] = ("X", "Y", "Z")
    text = model_text(
        "w b Y X Z t", {("X", "scale"): 1e-4, ("Y", "scale"): -1.5e-4, ("Z", "scale"): 8e-5}
    )
    _configuration: ClassVar[Configuration | None] = None

    def __init__(self) -> None:
        super().__init__()
        self.clock = Clock()
        self.loop = asyncio.new_event_loop()
        self.monkeypatch = pytest.MonkeyPatch()
        self.monkeypatch.setattr(time, "monotonic", self.clock.monotonic)
        self.had = dict.fromkeys(self.axes, (0.0, self.clock.now))
        """Axis → correction that the controller has, mm or rad, and when it was worked out, s."""
        self.decision: Decision | None = None

    @initialize(packing=st.integers(0, 3))
    def begin(self, packing: int) -> None:
        kind = type(self)
        if kind._configuration is None:
            kind._configuration = configured(self.axes, self.text)
        self.link = Controller(self.clock, packings(self.axes)[packing], self.axes)
        self.pipeline = Pipeline(kind._configuration, {"m": self.link})
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
        rate = TURN_RATE if axis in ROTARY else RATE
        allowed = rate * min(now - since, LONGEST) + (1e-12 if axis in ROTARY else TINY)
        assert abs(correction - before) <= allowed, (
            f"{axis}: from {before:.9g} to {correction:.9g} in {now - since:.3f} s, "
            f"at most {allowed:.3g}"
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
        self.link.place = middle(self.axes, place)
        self.cycles(80, 0.05)
        if place <= 300.0:  # farther out the correction is too long
            assert self.decision is not None
            assert self.decision.compensating

    @rule(
        place=st.tuples(*[st.sampled_from((0.0, 80.0, 300.0, 520.0, 600.0))] * 3),
        count=st.sampled_from((1, 150)),
    )
    def moves(self, place: tuple[float, float, float], count: int) -> None:
        self.link.place.update(zip("XYZ", place, strict=True))
        self.cycles(count)

    @rule(axis=st.sampled_from("XYZ"), way=st.floats(-20.0, 20.0))
    def moves_a_little(self, axis: str, way: float) -> None:
        self.link.place[axis] = min(max(self.link.place[axis] + way, 0.0), 600.0)
        self.cycle(0.02)

    @rule(way=st.sampled_from((0.01, -0.01, 0.4, -3.0)), count=st.sampled_from((1, 80)))
    def turns(self, way: float, count: int) -> None:
        """Rotary axes, also through a pole; with X, Y, Z alone nothing happens."""
        for axis in self.axes[3:]:
            self.link.place[axis] = min(max(self.link.place[axis] + way, -3.1), 3.1)
        self.cycles(count)

    @rule(count=st.sampled_from((1, 20)))
    def is_changed_by_a_person(self, count: int) -> None:
        self.pipeline._guard.change()
        self.cycles(count)

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

    @rule(bad=st.frozensets(st.integers(0, 4), min_size=1), count=st.integers(1, 150))
    def loses_positions(self, bad: frozenset[int], count: int) -> None:
        self.link.bad = frozenset(self.axes[i % len(self.axes)] for i in bad)
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
        self.link.bad = frozenset(self.axes)
        self.cycles(count)
        self.link.status.become(LinkState.UP)
        self.link.bad = frozenset()

    @rule(seconds=st.sampled_from((0.5, 5.0, 3600.0)))
    def pauses(self, seconds: float) -> None:
        self.cycle(seconds)

    @invariant()
    def no_correction_is_too_large(self) -> None:
        for axis, (correction, _) in self.had.items():
            most = MOST_TURN if axis in ROTARY else MOST
            assert abs(correction) <= most + TINY, axis
        if self.link.goes_with("out_X") >= {f"out_{a}" for a in self.axes}:
            assert math.hypot(*(self.had[a][0] for a in "XYZ")) <= NORM + TINY


class FiveAxisMachine(Machine):
    """A table C and a head B, corrected too; errors that turn the tool by up to 0.1 mrad."""

    axes = ("X", "Y", "Z", "C", "B")
    text = model_text(
        "w Y' C' b X Z B t",
        {("X", "scale"): 1e-4, ("Y", "scale"): -1.5e-4, ("X", "X"): 5e-5, ("Z", "Y"): 7e-5},
    )


Machine.TestCase.settings = settings(max_examples=60, stateful_step_count=15)
TestGuardAndWriteBack = Machine.TestCase
FiveAxisMachine.TestCase.settings = settings(max_examples=25, stateful_step_count=12, deadline=None)
TestGuardAndWriteBackWithTurns = FiveAxisMachine.TestCase
