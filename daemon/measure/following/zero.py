"""The zero from which an instrument counts in a set-up, and its being another one."""

from __future__ import annotations

from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.news import MeasureNews


class InstrumentZero:
    """The zero of the present set-up; each new one begins a part of it in the campaign.

    Parameters
    ----------
    course
        How far the measurement is; its parts are counted here.
    news
        Is told of readings that have jumped.

    Attributes
    ----------
    renew
        Whether the next reading counts from another zero.
    """

    def __init__(self, course: MeasureCourse, news: MeasureNews) -> None:
        self._course = course
        self._news = news
        self._zero: tuple[float, ...] = ()
        self._before: tuple[float, ...] = ()
        self.renew = False

    def forget(self) -> None:
        """Turn to another set-up."""
        self._zero = self._before = ()
        self.renew = False

    def less(self, instrument: Instrument, values: tuple[float, ...]) -> list[float]:
        """Readings less the zero, which is looked at first."""
        self._look_for_jump(instrument, values)
        if self.renew:
            self.renew = False
            self._zero = ()
        self._before = values
        if not self._zero:
            self._begin_part(instrument, values)
        return [v - z for v, z in zip(values, self._zero, strict=True)]

    def _look_for_jump(self, instrument: Instrument, values: tuple[float, ...]) -> None:
        """A reading that has jumped counts from another zero, whoever reset it."""
        if not (self._zero and self._before and instrument.section.loses_zero) or self.renew:
            return
        scale = 1e6 if instrument.angle else 1e3
        way = max(abs(v - b) for v, b in zip(values, self._before, strict=True)) * scale
        if way > instrument.section.jump:
            unit = "µrad" if instrument.angle else "µm"
            self.renew = True
            self._news.event(
                "new zero",
                f"{instrument.name} has jumped by {way:.0f} {unit}: it was reset; what follows "
                "is a set-up of its own",
            )

    def _begin_part(self, instrument: Instrument, values: tuple[float, ...]) -> None:
        course = self._course
        counts = instrument.section.reads == "length"
        goes_on = course.parts[course.current] and not instrument.section.loses_zero
        if not goes_on:
            course.parts[course.current] += 1
        self._zero = values if counts else (0.0,) * len(values)
