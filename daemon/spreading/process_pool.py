"""Processes of this computer that carry tasks out."""

from __future__ import annotations

import multiprocessing
import os
from collections import Counter, deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from abbe.daemon.spreading.engine import ATTEMPTS, Numbered, WorkLostError
from abbe.daemon.spreading.spread_work import TaskAnswer, TaskPayload, perform

_AHEAD = 2
"""Tasks for each process that are on their way at a time."""


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class ProcessPool:
    """A pool of processes; where one dies, a new pool does what it had not ended.

    Parameters
    ----------
    workers
        How many.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._failed: Counter[int] = Counter()

    def carry_out(self, tasks: Iterable[Numbered]) -> Iterator[tuple[int, TaskAnswer]]:
        """See `Engine`."""
        left = iter(tasks)
        again: deque[Numbered] = deque()
        while True:
            lost = yield from self._one_pool(left, again)
            if not lost:
                return
            for number, task in lost:
                self._failed[number] += 1
                if self._failed[number] >= ATTEMPTS:
                    raise WorkLostError(
                        f"the process that worked at {task.title or number} died "
                        f"{ATTEMPTS} times (out of memory?)"
                    )
            again.extend(lost)

    def _one_pool(
        self, left: Iterator[Numbered], again: deque[Numbered]
    ) -> Generator[tuple[int, TaskAnswer], None, list[Numbered]]:
        """Carry out until all is done, or a process dies: what then was on its way is returned."""
        pool = ProcessPoolExecutor(self.workers, multiprocessing.get_context("forkserver"))
        running: dict[Future[TaskAnswer], Numbered] = {}
        try:
            while True:
                broken = not _filled(pool, running, left, again, _AHEAD * self.workers)
                if not running and not broken:
                    return []
                ended, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in ended:
                    number, _task = running[future]
                    try:
                        answer = future.result()
                    except BrokenProcessPool:
                        broken = True
                        continue
                    del running[future]
                    yield number, answer
                if broken:
                    return list(running.values())
        finally:
            pool.shutdown(wait=not running, cancel_futures=True)


def _filled(
    pool: ProcessPoolExecutor,
    running: dict[Future[TaskAnswer], Numbered],
    left: Iterator[Numbered],
    again: deque[Numbered],
    most: int,
) -> bool:
    """Give the pool what it can take; whether it still takes something."""
    while len(running) < most:
        one = again.popleft() if again else next(left, None)
        if one is None:
            return True
        try:
            running[pool.submit(perform, TaskPayload.of(one[1]))] = one
        except BrokenProcessPool:
            again.appendleft(one)
            return False
    return True
