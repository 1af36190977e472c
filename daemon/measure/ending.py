"""The end of a measurement: by signal or by its last target, and what is missing then."""

from __future__ import annotations

import asyncio
import signal

from abbe.compcore.errors import AbbeError
from abbe.compcore.sentences import counted
from abbe.daemon.measure.events import MeasureEvent, Tell, target_words
from abbe.daemon.measure.following.session import Measurement
from abbe.daemon.measure.probing.session import ProbedMeasurement

_SHOWN = 8


async def run_until_ended(measurement: Measurement | ProbedMeasurement) -> None:
    """Run until nothing is left, or SIGINT, SIGTERM or SIGHUP."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for number in numbers:
        loop.add_signal_handler(number, stop.set)
    try:
        await measurement.run(stop)
    finally:
        for number in numbers:
            loop.remove_signal_handler(number)


def missing_words(measurement: Measurement | ProbedMeasurement, tell: Tell, *, once: bool) -> None:
    """Say how it ended.

    Raises
    ------
    AbbeError
        When targets are missing, or were read and could not be written.
    """
    course = measurement.course
    about = {"done": course.done, "of": course.total, "left_s": round(course.seconds_left, 1)}
    if measurement.waiting:
        what, they = ("1 target was", "it has") if measurement.waiting == 1 else (
            f"{measurement.waiting} targets were", "they have",
        )  # fmt: skip
        raise AbbeError(
            f"{what} read and could not be written ({measurement.problem}): {they} to be measured "
            "again; the same command goes on"
        )
    if course.complete:
        tell(
            MeasureEvent(
                "ended",
                (
                    "the only target is measured"
                    if course.total == 1
                    else f"all {course.total} targets are measured"
                ),
                about,
            )
        )
        return
    lines = []
    for (setup, left), visits in zip(
        course.missing(), (v for v in course.visits if v.left), strict=True
    ):
        shown = "; ".join(target_words(visits, i) for i in left[:_SHOWN])
        more = f"; and {len(left) - _SHOWN} more" if len(left) > _SHOWN else ""
        lines.append(f"{setup.name}, {len(left)} missing: {shown}{more}")
    for line in lines:
        tell(MeasureEvent("missed", line, about))
    count = course.total - course.done
    because = f"{measurement.reason}; " if measurement.reason else ""
    of = counted(course.total, "1 target", "{n} targets")
    words = (
        f"{because}{count} of {of} {'is' if count == 1 else 'are'} not measured; the same command "
        "goes on"
    )
    if once and not measurement.reason:
        tell(MeasureEvent("ended", words, about))
        return
    raise AbbeError(words)
