"""News of a measurement: what is new is said once, with how far it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.units import in_digits
from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.events import MeasureEvent, Tell, minutes, target_words, unit_of_kind
from abbe.daemon.measure.following.doubtful import size_words
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.following.target_watch import TargetChanged, TargetUnsteady
from abbe.daemon.measure.machine_view import SeenMachine
from abbe.daemon.measure.rows import part_name


class MeasureNews:
    """Tells what happens, each thing once.

    Parameters
    ----------
    course
        How far the measurement is.
    tell
        Is told.
    path
        The campaign.
    expected
        Set-up → uncertainty over the volume before and after it, mm.
    signals_held
        s for which the last value of a signal counts.
    """

    def __init__(
        self,
        course: MeasureCourse,
        tell: Tell,
        path: Path,
        expected: Mapping[str, tuple[float, float]],
        signals_held: float,
    ) -> None:
        self._course = course
        self._tell = tell
        self._path = path
        self._expected = expected
        self._signals_held = signals_held
        self._fault = ""
        self._missing_signals: frozenset[str] = frozenset()
        self._disk = ""

    def event(self, kind: str, text: str, **about: object) -> None:
        """Tell something, with the set-up and how far the measurement is."""
        course = self._course
        progress = {
            "setup": course.setup.name,
            "done": course.done,
            "of": course.total,
            "left_s": round(course.seconds_left, 1),
        }
        self._tell(MeasureEvent(kind, text, progress | about))

    def next_words(self) -> str:
        """What comes next."""
        visits = self._course.here
        wanted = visits.expected if visits.expected < visits.count else None
        if wanted is None or visits.taken(wanted):
            wanted = next(iter(visits.left), None)
        if wanted is None:
            return "nothing is left of this set-up"
        missed = " (it was missed)" if wanted < visits.expected else ""
        return f"target {target_words(visits, wanted)}{missed}"

    def next(self) -> None:
        """Tell what comes next."""
        self.event("next", f"next: {self.next_words()}")

    def row(
        self,
        setup: PlannedSetup,
        visit: int,
        part: int,
        rows: Sequence[Mapping[str, str | float | None]],
        *,
        repeated: bool,
    ) -> None:
        """Tell that a target's rows are on the disk."""
        unit, _ = unit_of_kind(setup.kind)
        form = "{:.5f} ± {:.5f}" if unit == "mm" else "{:+.2f} ± {:.2f}"
        found = ", ".join(
            "its reading is in the instrument's file"
            if row["value"] is None
            else f"{form.format(row['value'], row['sd'])}"
            for row in rows[: 1 if rows[0]["value"] is None else None]
        )
        unit = "" if rows[0]["value"] is None else f" {unit}"
        again = " again" if repeated else ""
        self.event(
            "repeated" if repeated else "row",
            f"{part_name(setup.name, part)} target {visit + 1}{again}: {found}{unit}",
            setup=setup.name,
            visit=visit + 1,
            rows=list(rows),
        )

    def setup_done(self, setup: PlannedSetup) -> None:
        """Tell that a set-up is complete."""
        then = self._expected.get(setup.name)
        sure = (
            f"; as planned ±{in_digits(then[1] * 1e3)} µm over the volume, were all that is not "
            "shown yet as large as is believable"
            if then
            else ""
        )
        left = minutes(self._course.seconds_left)
        words = "nothing is left" if self._course.complete else f"about {left} left"
        self.event("done", f"{setup.name} is complete: {words}{sure}", setup=setup.name)

    def unsteady(self, outcome: TargetUnsteady) -> None:
        """Tell why a target's readings do not count yet."""
        where = target_words(self._course.here, outcome.visit)
        if outcome.reading is None:
            text = f"waits at {where}: {outcome.why}"
        else:
            unit, scale = unit_of_kind(self._course.setup.kind)
            scale, unit = (1e3, "µm") if unit == "mm" else (scale, unit)
            by = outcome.reading.spreads if outcome.why == "spread" else outcome.reading.drifts
            worst = max(abs(x) for x in by) * scale
            what = {"spread": "readings scatter by", "drift": "readings drift by"}[outcome.why]
            text = f"not steady at {where}: {what} {worst:.2f} {unit}; measured again"
        self.event("unsteady", text, visit=outcome.visit + 1)

    def changed(self, outcome: TargetChanged, instrument: Instrument, *, withdrawn: bool) -> None:
        """Tell that a reading has changed after it was taken, and what comes of that."""
        where = target_words(self._course.here, outcome.visit)
        size = size_words(outcome.by, angle=instrument.angle)
        gone = "; what was kept of this target is withdrawn" if withdrawn else ""
        self.event(
            "withdrawn" if withdrawn else "unsteady",
            f"{instrument.name} still changed, by {size}, {outcome.after:.1f} s after the machine "
            f"stood at {where}: it is slow, or late{gone}. Read again, and from now on only after "
            f"{outcome.after:.1f} s: settle under [measure] has to be as long, and the program has "
            "to stand longer than that",
            visit=outcome.visit + 1,
        )

    def fault(self, seen: SeenMachine) -> None:
        """Tell that positions are missing, and that they are back."""
        if seen.fault and not self._fault:
            self.event("paused", f"no position: {seen.fault}")
        elif self._fault and not seen.fault:
            self.event("back", "positions are read again")
        self._fault = seen.fault

    def signals(self, seen: SeenMachine) -> None:
        """Tell which signals are missing, and which are back."""
        missing = frozenset(n for n, r in seen.signals.items() if r.fault)
        for name in sorted(missing - self._missing_signals):
            why = seen.signals[name].fault
            text = f"signal {name}: {why}; its last value counts for {self._signals_held:g} s"
            self.event("lost", text, signal=name)
        for name in sorted(self._missing_signals - missing):
            self.event("back", f"signal {name} is read again", signal=name)
        self._missing_signals = missing

    def disk(self, problem: str) -> None:
        """Tell that rows cannot be written, and that they are."""
        if problem and not self._disk:
            self.event(
                "disk",
                f"{self._path} cannot be written: {problem}; what is measured waits in memory and "
                "is written as soon as that is possible",
            )
        elif self._disk and not problem:
            self.event("back", f"{self._path} is written again")
        self._disk = problem
