"""Tasks spread over an engine: answers in their order, kept on disk, gone on with."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import AbbeError
from abbe.daemon.progress import PATIENCE
from abbe.daemon.spreading.engine import Engine, InThisProcess, WorkLostError
from abbe.daemon.spreading.kept_answers import KeptAnswers
from abbe.daemon.spreading.spread_work import SpreadTask

Lazily = Callable[[], SpreadTask]
"""Makes a task when its turn has come: files of a fleet are not all in memory."""


@dataclass(frozen=True)
class SpreadPlace:
    """Where work is spread, and where answers are kept.

    Attributes
    ----------
    engine
        What carries it out.
    keep
        The file of answers; None: they are not kept.
    lasting
        Whether the file stays when everything has been answered.
    """

    engine: Engine
    keep: Path | None = None
    lasting: bool = True


HERE = SpreadPlace(InThisProcess())
"""In this process, kept nowhere."""


def spread(
    tasks: Sequence[Lazily], place: SpreadPlace = HERE, title: str = "working"
) -> Iterator[tuple[int, bytes]]:
    """Carry tasks out: number and answer of each, once, as they come.

    Raises
    ------
    AbbeError
        When a task cannot be answered; says which and why.
    WorkLostError
        When the engine is lost; says how much is done and how to go on.
    """
    kept = None if place.keep is None else KeptAnswers(place.keep)
    course = _AnswerCourse(tasks, kept)
    try:
        with _shown(title, len(tasks)) as advance:
            for answer in course.answers(place.engine):
                advance()
                yield answer
        if kept is not None and not place.lasting:
            kept.forget(course.answered)
    except WorkLostError as error:
        done = f"after {len(course.answered)} of {len(tasks)} tasks"
        where = "" if kept is None else f", kept in {kept.path}: the same command goes on with them"
        raise WorkLostError(f"{error} {done}{where}") from None
    finally:
        if kept is not None:
            kept.close()


class _AnswerCourse:
    """What of some tasks is answered."""

    def __init__(self, tasks: Sequence[Lazily], kept: KeptAnswers | None) -> None:
        self.answered: list[str] = []
        self._tasks, self._kept = tasks, kept
        self._called: dict[int, tuple[str, str]] = {}
        self._ready: list[tuple[int, bytes]] = []

    def answers(self, engine: Engine) -> Iterator[tuple[int, bytes]]:
        """Those that were kept, and those that an engine gives."""
        for number, answer in engine.carry_out(self._wanted()):
            yield from self._taken()
            identity, called = self._called.pop(number)
            if answer.problem:
                raise AbbeError(f"{called}: {answer.problem}" if called else answer.problem)
            if self._kept is not None:
                self._kept.keep(identity, answer.body, answer.seconds)
            self.answered.append(identity)
            yield number, answer.body
        yield from self._taken()

    def _taken(self) -> Iterator[tuple[int, bytes]]:
        ready, self._ready = self._ready, []
        yield from ready

    def _wanted(self) -> Iterator[tuple[int, SpreadTask]]:
        for number, make in enumerate(self._tasks):
            task = make()
            before = None if self._kept is None else self._kept.answer(task.identity)
            if before is None:
                self._called[number] = (task.identity, task.title)
                yield number, task
            else:
                self.answered.append(task.identity)
                self._ready.append((number, before))


def in_order(answers: Iterator[tuple[int, bytes]], count: int) -> list[bytes]:
    """All answers, in the order of their tasks."""
    found: dict[int, bytes] = dict(answers)
    return [found[i] for i in range(count)]


@contextmanager
def _shown(title: str, total: int) -> Iterator[Callable[[], None]]:
    """A bar with the time left on standard error, from two seconds on, where that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda: None
        return
    import threading

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeElapsedColumn as Elapsed
    from rich.progress import TimeRemainingColumn as Left

    columns = [TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Elapsed()]
    bar = Progress(
        *columns, TextColumn("about"), Left(), TextColumn("left"),
        console=Console(stderr=True), transient=True,
    )  # fmt: skip
    task = bar.add_task(title, total=total)
    timer = threading.Timer(PATIENCE, bar.start)
    timer.daemon = True
    timer.start()
    try:
        yield lambda: bar.advance(task)
    finally:
        timer.cancel()
        timer.join()
        bar.stop()
