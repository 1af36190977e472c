"""The cycle: the stages one after the other, at the configured pace, until asked to end."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Mapping, Sequence

from abbe.daemon.config import Configuration
from abbe.daemon.guard import Correction, Guard
from abbe.daemon.pipeline.compensate import LiveCompensator, direction_index
from abbe.daemon.pipeline.doubts import Doubts
from abbe.daemon.pipeline.observe import Observer
from abbe.daemon.pipeline.pace import IDLE, CyclePace
from abbe.daemon.pipeline.plan import keep_together, make_plan
from abbe.daemon.pipeline.reading.convert import (
    PositionConverter,
    SignalConverter,
    SignalReading,
    ToolConverter,
)
from abbe.daemon.pipeline.reading.datum import Datum
from abbe.daemon.pipeline.reading.directions import StatedDirections
from abbe.daemon.pipeline.reading.expected import Expected
from abbe.daemon.pipeline.reading.plausible import Plausible
from abbe.daemon.pipeline.reading.poll import Batch, Poll
from abbe.daemon.pipeline.record import CycleRecord, Listener
from abbe.daemon.pipeline.writing.ending import Ending
from abbe.daemon.pipeline.writing.write_back import WriteBack, WriteOutcome
from abbe.daemon.status_word import fault_bits, status_word
from abbe.drivers.link import Link

logger = logging.getLogger("abbe.pipeline")

LAST_WORD = 2.0
"""s for which it is tried to tell the controller that Abbe has ended."""
_SETTLES = 5.0
"""s that a link which has come back is given at most, until what it carries is sound."""


class Pipeline:
    """Poll → convert → compensate → guard → write back, over and over.

    Parameters
    ----------
    configuration
        What was checked.
    links
        Its links; opened and closed by the caller.

    Attributes
    ----------
    listeners
        Receive every cycle; may be added to before the run.
    axes
        Names, in the order of a record's positions.
    corrected_axes
        Those that are written back, or all linear ones where nothing is written; linear ones first.
    directions
        The order of a correction: X, Y, Z and the rotary axes that are corrected.
    reads
        Link → channels that are read in every cycle.
    links
        As given.
    ending
        Says the last word.
    """

    def __init__(self, configuration: Configuration, links: Mapping[str, Link]) -> None:
        file = configuration.file
        self.links = self._links = links
        self.listeners: list[Listener] = []
        self._compensation = LiveCompensator(configuration.model, configuration.limits.turning)
        self.directions = self._compensation.directions
        self._compensation.set_tool(file.tool.offset)
        self.axes = self._compensation.axes
        self._turns = self._compensation.uses_directions
        plan = self._plan = make_plan(configuration, self.axes, links, with_directions=self._turns)
        self._nowhere = None if any(plan.reference) else (math.nan,) * len(self.axes)
        self.reads = plan.fast
        self._poll = Poll(links, plan.fast)
        self._slow_polls = [(name, Poll(links, {name: names})) for name, names in plan.slow.items()]
        self._slow: Batch = {}
        self._stale_after = file.guard.stale_after
        keep_together(plan, links)
        expected = plan.expected
        self._positions = PositionConverter(
            plan.positions,
            file.guard.stale_after,
            plan.watch,
            expected.positions,
            [source for source, _ in plan.echo],
        )
        self._signals = SignalConverter(
            plan.signals,
            file.guard.signals_stale_after,
            Plausible(expected.signals, expected.similar),
            {n: s.entered_for for n, s in file.signals.items() if s.entered_for is not None},
        )
        self._tool = ToolConverter(plan.tool, file.guard.signals_stale_after, expected.tool)
        self._approach = StatedDirections(
            self.axes, [file.axes[axis].turns_after(axis) for axis in self.axes], plan.directions
        )
        self._guard = Guard(configuration.limits)
        self._write_back = WriteBack(
            links, plan.targets, plan.echo, plan.status, plan.heartbeat, expected.beats
        )
        self.ending = Ending(
            links, self._write_back, plan.status, plan.targets, LAST_WORD + file.cycle.period
        )
        machine = configuration.model.machine
        written = tuple(t.axis for t in plan.targets)
        self.corrected_axes = written or tuple(a for a in self.axes if not machine.axes[a].rotary)
        self._corrected = tuple(
            (self.axes.index(axis), direction_index(axis, self.directions))
            for axis in self.corrected_axes
        )
        self._writes = bool(written)
        self._doubts = Doubts(self.axes, plan, links, self._write_back, file)
        self._pace = CyclePace(file.cycle.period, [links[name].status for name in plan.fast])
        self._signals_every = file.cycle.signals_every
        self._signals_due = -math.inf
        self._observer = Observer(
            links,
            plan,
            self.directions,
            writes=self._writes,
            lead_back=2.0 * file.guard.ramp,
            settles=min(_SETTLES, max(1.0, file.controller.heartbeat_within)),
        )
        self._signal_fault = False
        self._outcome = WriteOutcome(True)
        self._not_held = 0
        self._internal = ""
        self._ending = False
        self._number = 0
        self.began = time.monotonic()

    @property
    def tool(self) -> tuple[float, float, float]:
        """The tool's present offset, mm."""
        return self._compensation.tool

    @property
    def shut(self) -> frozenset[str]:
        """Links over which nothing is written for now, because somebody else may."""
        return frozenset(self._write_back.shut | self._write_back.others)

    @property
    def missed(self) -> int:
        """Periods that were left out, because a cycle took longer."""
        return self._pace.missed

    def change_model(
        self, configuration: Configuration, compensation: LiveCompensator, expected: Expected
    ) -> None:
        """Go on with another model and other limits; wires and machine are the same.

        The correction is led from the old to the new one by the guard, within its rates; lags go on
        from where they are.

        Parameters
        ----------
        configuration
            Checked; see `abbe.daemon.reload` for what may differ.
        compensation
            Made from its model, not yet used.
        expected
            What is believed of its signals.
        """
        now = time.monotonic()
        compensation.continue_from(self._compensation, now, self._signals.readings)
        read = bool(self._plan.tool)
        compensation.set_tool(self._compensation.tool if read else configuration.file.tool.offset)
        self._compensation = compensation
        self._signals.judge(Plausible(expected.signals, expected.similar))
        self._guard.allow(configuration.limits)
        self._guard.change()
        self._signals_due = now

    def enter(self, signal: str, value: float, seconds: float | None) -> float:
        """Take a value that a person has read; the s for which it counts.

        The step that it makes in the correction is let go as a ramp.

        Raises
        ------
        InputError
            For a signal that is not typed in, a value that cannot be, or too long a time.
        """
        good_for = self._signals.enter(signal, value, seconds, time.monotonic())
        self._guard.change()
        self._signals_due = -math.inf
        return good_for

    @property
    def entered(self) -> Mapping[str, SignalReading]:
        """Signals that a person types in, as they were last read."""
        return {name: self._signals.readings[name] for name in self._signals.typed}

    @property
    def datums(self) -> Mapping[str, Datum]:
        """Axis → the datum of its encoder, which is not absolute."""
        return self._plan.datums

    def _watch_datums(self) -> None:
        """A device that was away may have begun to count anew: its axes have no datum then."""
        for axis, datum in self._plan.datums.items():
            link = self._plan.positions[self.axes.index(axis)].channel[0]
            datum.see(self._links[link].status.reconnects)

    @property
    def longest_end(self) -> float:
        """Time after `stop` within which the correction is at zero, and may be said to be, s."""
        return max(self._guard.longest_release, self._doubts.longest_doubt)

    async def run(self, stop: asyncio.Event, at_once: asyncio.Event | None = None) -> None:
        """Run until `stop` is set, then ramp the correction to zero and say so to the controller.

        `at_once`, when set, ends without the ramp; the controller is informed in either case.

        Never raises for anything that a device, a sensor or a model does.
        """
        slow = [asyncio.create_task(self._poll_slowly(*item)) for item in self._slow_polls]
        try:
            await self._cycles(stop, at_once or asyncio.Event())
        finally:
            for task in slow:
                task.cancel()
            await asyncio.gather(*slow, return_exceptions=True)

    async def _cycles(self, stop: asyncio.Event, at_once: asyncio.Event) -> None:
        self._pace.start()
        deadline, heard, began = math.inf, math.inf, -math.inf
        while True:
            if stop.is_set() and not self._ending:
                self._ending = True
                self._guard.release()
                now = time.monotonic()
                deadline = now + self._guard.longest_release
                heard = now + self._doubts.longest_doubt
            # a busy computer may have had no cycle towards the end of the ramp: one is needed there
            down = self._guard.released or began > deadline
            # the last word is a write too: who has only come hears out first whether he is alone
            doubtful = self._doubts.undecided and began < heard
            if at_once.is_set() or (self._ending and down and not doubtful):
                break
            began = time.monotonic()
            try:
                await self.cycle()
                self._internal = ""
            except Exception as error:
                if not self._internal:
                    logger.exception("a cycle failed; the next one begins anew")
                self._internal = f"{type(error).__name__}: {error}"
                await asyncio.sleep(IDLE)
            await self._pace.wait(None if self._ending else stop)
        await self.ending.tell(LAST_WORD)

    async def cycle(self) -> CycleRecord:
        """One cycle; its record is handed to the listeners too."""
        began = time.monotonic()
        if self._doubts.due(began):
            await self._doubts.look(began)
        batch = await self._poll()
        now = time.monotonic()
        if self._plan.datums:
            self._watch_datums()
        positions, faults = self._positions(batch, now)
        taken_at = self._positions.taken_at
        self._doubts.step(positions, faults, taken_at, now)
        computed = self._computed(positions, batch, faults)
        foreign = self._doubts.foreign
        lost = self._tool.fault or foreign
        faulty = self._guard.every if lost else self._compensation.faulty
        decision = self._guard.step(now, computed, faulty)
        correction = decision.correction
        corrected = [positions[i] + correction[k] for i, k in self._corrected]
        wrong = self._fault_bits(faults, foreign)
        pose = self._compensation.pose
        oriented = pose is None or not (pose.damped or pose.limited)
        word = status_word(decision, wrong, self._not_held, oriented=oriented)
        if self._writes or self._plan.status or self._plan.heartbeat:
            await self._answer(corrected, batch, word, min(taken_at, now))
        ended = time.monotonic()
        if now >= self._signals_due:
            self._signals_due = now + self._signals_every
            self._take_signals(batch, now)
        outcome = self._outcome
        present = self._faults_present(faults, foreign, wrong, outcome)
        self._observer.log(
            decision, present, now, self._ending, oriented=oriented, taken=not self._not_held
        )
        self._number += 1
        record = CycleRecord(
            self._number,
            now - self.began,
            tuple(positions),
            tuple(corrected),
            decision,
            word,
            self._signals.readings,
            present,
            self._reference(batch),
            ended - began,
            outcome.written and self._writes,
            max(0.0, now - taken_at),
            self._doubts.speeds,
            self.directions,
            pose,
            None if faults else self._compensation.shown,
            self._writes,
        )
        self._hand_out(record)
        return record

    def _computed(
        self, positions: Sequence[float], batch: Batch, faults: dict[str, str]
    ) -> Correction | None:
        """The correction, mm and rad; None with a fault: a bad direction adds one to `faults`."""
        directions: Sequence[float] = ()
        if self._turns and not faults:
            directions = self._approach(positions, batch, faults)
        return None if faults else self._compensation.step(positions, directions)

    def _fault_bits(self, faults: Mapping[str, str], foreign: object) -> int:
        """What is wrong as the status word says it; 0 where nothing is."""
        internal = bool(self._compensation.fault or self._internal)
        signal = self._signal_fault or bool(self._tool.fault)
        refused = bool(self._outcome.problem)
        if not (faults or signal or internal or self._ending or refused or foreign):
            return 0
        return fault_bits(
            position=bool(faults),
            signal=signal,
            internal=internal,
            ending=self._ending,
            write=refused,
            foreign=bool(foreign),
        )

    def _faults_present(
        self, faults: Mapping[str, str], foreign: str, wrong: int, outcome: WriteOutcome
    ) -> Mapping[str, str]:
        """Every fault in words; what stands in the status word, and how the write ended since."""
        if not (wrong or outcome.problem or not self._observer.all_up):
            return {}
        return self._observer.faults(
            axes=faults,
            readings=self._signals.readings,
            tool=self._tool.fault,
            compensator=self._compensation.fault,
            write_back=outcome.problem,
            foreign=foreign,
        )

    def _hand_out(self, record: CycleRecord) -> None:
        for listener in tuple(self.listeners):
            try:
                listener(record)
            except Exception:
                # whoever looks on must not disturb the machine
                self.listeners.remove(listener)
                logger.exception("%s failed and receives no more cycles", listener)

    async def _answer(
        self,
        corrected: Sequence[float],
        batch: Batch,
        word: int,
        taken_at: float,
    ) -> None:
        """Write one cycle's answer, and have the guard know what became of it."""
        answer: Sequence[float] = ()
        if self._writes:
            answer = self._doubts.withhold(corrected)
        self._doubts.shut_late(time.monotonic())
        outcome = await self._write_back(answer, batch, word, taken_at + self._stale_after)
        self._guard.taken(time.monotonic())
        self._outcome, self._not_held = outcome, 0
        if self._writes:
            if outcome.untouched or outcome.unknown:
                untouched = self._directions_of(outcome.untouched)
                unknown = self._directions_of(outcome.unknown)
                self._guard.not_taken(untouched, unknown)
                self._not_held = untouched | unknown
            self._doubts.wrote(answer, outcome)

    def _directions_of(self, targets: int) -> int:
        """The mask of directions for a mask of targets."""
        mask = 0
        for place, (_, k) in enumerate(self._corrected):
            mask |= (targets >> place & 1) << k
        return mask

    def _reference(self, batch: Batch) -> tuple[float, ...]:
        if self._nowhere is not None:
            return self._nowhere
        return tuple(math.nan if s is None else s.take(batch).value for s in self._plan.reference)

    def _take_signals(self, batch: Batch, now: float) -> None:
        everything = batch if not self._slow else {**batch, **self._slow}
        readings = self._signals(everything, now)
        self._signal_fault = any(reading.fault for reading in readings.values())
        offset = self._tool(everything, now)
        if offset is not None:
            self._compensation.set_tool(offset)
        self._compensation.update(now, readings)

    async def _poll_slowly(self, name: str, poll: Poll) -> None:
        while True:
            answer = await poll()
            self._slow = {**self._slow, **answer}
            await asyncio.sleep(max(self._signals_every, IDLE))
