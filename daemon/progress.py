"""A progress bar on standard error for whatever takes longer than two seconds, with time left."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

PATIENCE = 2.0
"""Seconds before a bar appears."""

_ALMOST = 0.95
"""Part of a stage that counts as done while it lasts longer than expected."""

Stages = Sequence[tuple[str, float]]
"""In order: how a stage's text begins, and seconds that it is expected to take."""


class TimeLeft:
    """How long stages will still take, from how long they took so far.

    Parameters
    ----------
    stages
        What is expected; only the ratios count once a stage is over.
    clock
        Monotonic, s.
    """

    def __init__(self, stages: Stages, clock: Callable[[], float] = time.monotonic) -> None:
        self._stages, self._clock = stages, clock
        self._at = 0
        self._start = self._began = clock()

    def begin(self, text: str) -> None:
        """A stage begins; one that was not expected counts as a part of the present one."""
        for i in range(self._at + 1, len(self._stages)):
            if text.startswith(self._stages[i][0]):
                self._at, self._began = i, self._clock()
                return

    @property
    def _pace(self) -> float:
        """Seconds that an expected second takes."""
        expected = sum(seconds for _, seconds in self._stages[: self._at])
        return (self._began - self._start) / expected if expected > 0.0 else 1.0

    @property
    def done(self) -> float:
        """Part of the work that is done, 0 … 1."""
        total = sum(seconds for _, seconds in self._stages)
        before = sum(seconds for _, seconds in self._stages[: self._at])
        return (before + self._present()) / total if total > 0.0 else 0.0

    @property
    def left(self) -> float:
        """Seconds left."""
        total = sum(seconds for _, seconds in self._stages[self._at :])
        return (total - self._present()) * self._pace

    def _present(self) -> float:
        """Expected seconds of the present stage that are over."""
        if not self._stages:
            return 0.0
        own = self._stages[self._at][1]
        spent = (self._clock() - self._began) / max(self._pace, 1e-9)
        return min(spent, _ALMOST * own)


@contextmanager
def shown(first: str, stages: Stages = ()) -> Iterator[Callable[[str], None]]:
    """Show what is being done, with the time it takes; yields a function that tells the next step.

    Nothing is shown before `PATIENCE` has passed, or where standard error is not a terminal. With
    the `stages` that are expected, the first of which is under way, also how long it will take.
    """
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
    from rich.progress import TimeElapsedColumn as Elapsed
    from rich.text import Text

    expected = TimeLeft(stages)

    class Left(ProgressColumn):
        """Time left, m:ss."""

        max_refresh = 0.5

        def render(self, task: Task) -> Text:
            task.completed = expected.done
            minutes, seconds = divmod(round(expected.left), 60)
            return Text(f"about {minutes}:{seconds:02} left")

    columns = [TextColumn("{task.description}"), BarColumn(), Elapsed()]
    bar = Progress(
        *columns, *([Left()] if stages else []), console=Console(stderr=True), transient=True
    )
    task = bar.add_task(first, total=1.0 if stages else None)
    timer = threading.Timer(PATIENCE, bar.start)
    timer.daemon = True
    timer.start()

    def tell(text: str) -> None:
        expected.begin(text)
        bar.update(task, description=text)

    try:
        yield tell
    finally:
        timer.cancel()
        timer.join()
        bar.stop()
