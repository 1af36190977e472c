"""What a measurement by touching needs, and what each kind of artefact does with it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from abbe.compcore.files.growing_campaign import Row
from abbe.compcore.machine.machine import Machine
from abbe.compcore.planning.envelope import WorkingSpace
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.daemon.config.sections.probing import ProbingSection
from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.kept_rows import KeptRows
from abbe.daemon.measure.machine_view import SeenMachine
from abbe.daemon.measure.news import MeasureNews
from abbe.daemon.measure.probing.guarded_tip import GuardedTip
from abbe.daemon.measure.probing.surroundings import Surroundings
from abbe.daemon.measure.rows import TOUCH_SPEED, part_name, read_back, rows_of, written


@dataclass(frozen=True, eq=False)
class TouchingWork:
    """A measurement by touching: what every artefact shares.

    Attributes
    ----------
    section
        How it is touched.
    machine, space
        What moves, and where it may.
    course, news, eyes
        How far it is; who is told; what is read meanwhile.
    kept
        The rows on their way to the disk.
    clock
        s to be added to a monotonic time for the campaign's own.
    """

    section: ProbingSection
    machine: Machine
    space: WorkingSpace
    course: MeasureCourse
    news: MeasureNews
    eyes: Surroundings
    kept: KeptRows
    clock: float

    def warm(self, seen: SeenMachine) -> float | None:
        """The artefact's temperature, °C; None: it counts as 20 °C."""
        name = self.section.plate_temperature
        return None if name is None else float(seen.signals[name].value)

    def take(
        self,
        setup: PlannedSetup,
        visit: int,
        place: Mapping[str, float],
        values: Sequence[float],
        sds: Sequence[float],
        seen: SeenMachine,
        *,
        directions: Mapping[str, float] | None = None,
        more: Sequence[Mapping[str, str | float]] = (),
    ) -> None:
        """Take the rows of a visit, one for each direction that was read.

        Parameters
        ----------
        place
            Axis → where it stood, mm or rad.
        values, sds
            Errors and their standard uncertainties, mm.
        directions
            Axis → from which side it came, where that is known.
        more
            What each row has besides.
        """
        course = self.course
        target = int(course.here.order[visit])
        # as the file will say it, so that who reads the file comes to the same visit
        place = {a: read_back(a, str(written(a, q))) for a, q in place.items()}
        part = course.parts[course.current]
        came = dict.fromkeys(place, 0.0) | dict(directions or {})
        signals = {name: seen.signals[name].value for name in self.eyes.signal_names}
        time = self.clock + seen.time
        rows: list[Row] = list(
            rows_of(
                setup, part, target, place, values, came, time, sds, signals,
                {TOUCH_SPEED: self.section.touch_speed},
            )
        )  # fmt: skip
        rows = [{**row, **(more[k] if more else {})} for k, row in enumerate(rows)]
        course.here.take(visit)
        course.took(seen.time)

        def on_disk() -> None:
            self.news.row(setup, visit, part, rows, repeated=False)

        self.kept.add(rows, part_name(setup.name, part), setup.free, on_disk, seen.time)
        self.news.disk(self.kept.problem)
        if course.here.left:
            self.news.next()


class TouchedArtefact(ABC):
    """One kind of artefact as it is touched, set-up after set-up."""

    @abstractmethod
    def look(self, tip: GuardedTip, setup: PlannedSetup) -> None:
        """Look at all places that the tip will come to.

        Raises
        ------
        InputError
            When one of them is not free.
        """

    @abstractmethod
    async def measure(self, tip: GuardedTip, setup: PlannedSetup) -> None:
        """Find it, and touch all that is left of the set-up.

        Raises
        ------
        AbbeError
            When something is not where it is expected.
        LinkError
            When the machine does not do what it is told.
        """
