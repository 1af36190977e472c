"""Check points while a correction runs: noticed, recorded, judged, and said in the journal.

The triggers are looked at in the event loop; a reading is recorded and judged in a process of its
own. The cycle waits for nothing, and whatever happens here the correction goes on.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from abbe.daemon.checks.triggers import MeasuredPoint, NotTakenError, Trigger
from abbe.daemon.config import Configuration
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.status.live_checks import LiveChecksState
from abbe.drivers.link import Link

if TYPE_CHECKING:  # what judges is imported only where there are check points
    from abbe.daemon.checks.job import CheckOutcome, CheckRequest, NewReading

logger = logging.getLogger("abbe.checks")

_JUDGED_WITHIN = 600.0
"""s for recording and judging: ten years of checks."""
_GRACE = 3.0
"""s that a reading is given to be recorded and judged when the run ends."""
_ENDED = 5.0
"""s that the judging process is given to be gone."""
_LAST = 12.0
"""s that recording it in this process may take then."""
_OLD = 5.0
"""s that a cycle is waited for."""
_SHOWN = 3
"""Series of a check that the journal names."""

Keep = Callable[[str, str, float], None]
"""Takes (name, unit, value) for the records."""


class LiveChecks:
    """The check points of a running correction.

    Parameters
    ----------
    configuration
        What runs now: asked again at each check, as a reload may change it.
    links
        All links.
    pipeline
        What runs.

    Attributes
    ----------
    state
        What is known; replaced as a whole.
    keep
        Where values for the records go; None: nowhere.
    """

    def __init__(
        self,
        configuration: Callable[[], Configuration],
        links: Mapping[str, Link],
        pipeline: Pipeline,
    ) -> None:
        self._configuration, self._pipeline = configuration, pipeline
        self._points = configuration().file.checks.points
        self._triggers = [Trigger(n, s, links) for n, s in self._points.items()]
        self._links = links
        self._record: CycleRecord | None = None
        self._new: list[NewReading] = []
        self._wake, self._came = asyncio.Event(), asyncio.Event()
        self._blind = False
        self.state = LiveChecksState()
        self.keep: Keep | None = None

    @property
    def wanted(self) -> bool:
        """Whether there are check points."""
        return bool(self._points)

    @property
    def idle(self) -> bool:
        """Whether nothing waits to be recorded."""
        return not self._new

    def __call__(self, record: CycleRecord) -> None:
        """Keep a cycle's record."""
        self._record = record
        self._came.set()

    def judge_anew(self) -> None:
        """Judge once more: the model has changed."""
        self._wake.set()

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Look on while the context lasts; what was measured by its end is recorded."""
        if not self.wanted:
            yield
            return
        self._pipeline.listeners.append(self)
        looking = asyncio.create_task(self._look())
        judging = asyncio.create_task(self._judge())
        try:
            yield
        finally:
            looking.cancel()
            if self in self._pipeline.listeners:
                self._pipeline.listeners.remove(self)
            if self._new:
                self._wake.set()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(_GRACE):
                        await self._recorded()
            judging.cancel()
            await asyncio.wait({looking, judging}, timeout=_ENDED)
            await self._record_the_rest()
            for new in self._new:
                logger.warning("check %s: not recorded: the run ended", new.typed.name)

    async def _recorded(self) -> None:
        while self._new:  # noqa: ASYNC110
            await asyncio.sleep(0.05)

    async def _record_the_rest(self) -> None:
        """Record here what the judging process has not come to, on a busy computer."""
        new = tuple(self._new)
        if not new:
            return
        from abbe.daemon.checks.last import record_in_time

        outcome = await record_in_time(self._request(new), _LAST)
        if outcome is None:
            return
        self._new.clear()
        for name, why in outcome.refused.items():
            self._refuse(name, why)
        for name in outcome.recorded:
            logger.info("check %s: recorded, not judged: the run ended", name)

    async def _look(self) -> None:
        while True:
            await asyncio.sleep(self._configuration().file.checks.look_every)
            for trigger in self._triggers:
                try:
                    measured = await trigger.look(time.monotonic())
                    if measured is not None:
                        await self._take(measured)
                except NotTakenError as error:
                    self._refuse(trigger.name, str(error))
                except Exception:
                    if not self._blind:
                        self._blind = True
                        logger.exception("check %s: cannot be looked at", trigger.name)

    async def _take(self, measured: MeasuredPoint) -> None:
        """Put a measurement in line, with the machine's state at this moment.

        Raises
        ------
        NotTakenError
            When that is not known.
        """
        from abbe.daemon.checks.job import NewReading
        from abbe.daemon.checks.readings import reading_of

        record = await self._cycle_since(measured.name, time.monotonic())
        section, configuration = self._points[measured.name], self._configuration()
        unit = ""
        if section.value is not None:
            link, _, channel = section.value.partition(".")
            unit = self._links[link].info(channel).unit
        when = time.time()
        machine = configuration.model.machine
        state = record, self._pipeline.axes, machine, self._pipeline.tool, when
        typed, signals = reading_of(measured, section, unit, *state)
        self._new.append(NewReading(typed, signals, when, section.corrected))
        self._wake.set()

    async def _cycle_since(self, name: str, moment: float) -> CycleRecord:
        """The first cycle that was asked for after a moment (monotonic, s).

        An earlier one, which a busy computer hands on late, knows the machine as it was before the
        controller measured: another place, another reference.
        """
        try:
            async with asyncio.timeout(_OLD):
                while True:
                    self._came.clear()
                    await self._came.wait()
                    record = self._record
                    if record is None:
                        continue
                    if self._pipeline.began + record.time - record.age >= moment:
                        return record
        except TimeoutError:
            raise NotTakenError("the machine's state then is not known: no cycle") from None
        except asyncio.CancelledError:
            self._refuse(name, "the run ended before the machine's state was known")
            raise

    def _refuse(self, name: str, why: str) -> None:
        logger.warning("check %s: not recorded: %s", name, why, extra={"event": "check refused"})
        self.state = replace(self.state, refused={**self.state.refused, name: why})

    async def _judge(self) -> None:
        """Record what is in line, and judge; the first time what was recorded before."""
        from abbe.daemon.checks.job import CheckOutcome
        from abbe.daemon.checks.judging import judged

        while True:
            self._wake.clear()
            new = tuple(self._new)
            try:
                outcome = await judged(self._request(new), _JUDGED_WITHIN)
            except Exception as error:  # noqa: BLE001  (whoever looks on must not end the run)
                why = str(error) or f"it took longer than {_JUDGED_WITHIN:g} s"
                outcome = CheckOutcome(refused={n.typed.name: why for n in new}, problem=why)
            del self._new[: len(new)]
            self._take_over(outcome, new)
            await self._wake.wait()

    def _request(self, new: tuple[NewReading, ...]) -> CheckRequest:
        from abbe.compcore.monitoring.charts import ChartDesign
        from abbe.daemon.answers.measurements import check_point
        from abbe.daemon.checks.job import CheckRequest

        running = self._configuration()
        path, model = running.path.resolve(), running.model_path.resolve()
        changed = running.checks_path.resolve().with_name("changed.csv")
        return CheckRequest(
            running.model,
            running.checks_path,
            new,
            ChartDesign(running.file.checks.false_alarm_every),
            check_point.diagnosing(path, model, None, "", changed),
        )

    def _take_over(self, outcome: CheckOutcome, new: tuple[NewReading, ...]) -> None:
        before = self.state
        last, refused = dict(before.last), dict(before.refused)
        for one in new:
            if one.typed.name in outcome.recorded:
                last[one.typed.name] = one.when
                refused.pop(one.typed.name, None)
        answer = before.answer if outcome.problem else outcome.answer
        self.state = LiveChecksState(answer, outcome.problem, last, refused)
        for name, why in outcome.refused.items():
            self._refuse(name, why)
        for name in outcome.recorded:
            self._say(name)
        self._say_verdict(before)

    def _say(self, name: str) -> None:
        """One check in the journal and in the records."""
        if self.state.answer is None:
            return
        rows = [s for s in self.state.answer["series"] if _is_of(s["name"], name)]
        known = [s for s in rows if s["surprise"] is not None]
        words = [
            f"{s['name']} {s['surprise']:+.2f} ± {2.0 * s['sd']:.2f} "
            f"{'µrad' if s['unit'] == 'urad' else 'µm'}"
            for s in sorted(known, key=_fullness, reverse=True)[:_SHOWN]
        ]
        full = max(map(_fullness, rows), default=0.0)
        logger.info(
            "check %s: %s beyond what was expected, its charts at most %.0f %% full",
            name,
            ", ".join(words) or "recorded",
            100.0 * full,
            extra={"event": "check recorded", "about": {"CHECK": name}},
        )
        for s in known:
            if self.keep is not None:
                self.keep(f"check_{s['name']}", s["unit"], s["surprise"])

    def _say_verdict(self, before: LiveChecksState) -> None:
        state = self.state
        if state.problem and state.problem != before.problem:
            logger.warning("checks: cannot be judged: %s", state.problem)
        if state.answer is None or state.changed == before.changed:
            return
        if not state.changed:
            logger.info("%s", state.answer["words"][0], extra={"event": "machine sound"})
            return
        alarm = state.answer["alarm"]
        patterns = alarm["patterns"]
        about = {
            "SERIES": alarm["series"],
            "CHART": alarm["chart"],
            "LAST_SOUND": alarm["last_sound"],
            "FIRST_CHANGED": alarm["first_changed"],
            "COMPONENT": [p["component"] for p in patterns],
            "ALONG": [p["along"] for p in patterns if p["along"]],
        }
        logger.warning(
            "%s next: %s",
            state.answer["words"][0],
            state.answer["diagnose"],
            extra={"event": "machine changed", "about": about},
        )


def _fullness(series: Mapping[str, Any]) -> float:
    return float(max(abs(series["ewma"]), series["cusum"]))


def _is_of(series: str, name: str) -> bool:
    """Whether a series is of a check point: its own name, or with the direction or place."""
    return series == name or series.startswith((f"{name}_", f"{name} "))
