"""What a session computes, one thing at a time, and a count of what has become different."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from abbe.compcore.errors import InputError
from abbe.daemon.progress import Stages
from abbe.daemon.workbench.session.task import Tell, WorkbenchTask


class SessionTasks:
    """At most one task is under way; pages ask how far it is.

    Parameters
    ----------
    unawaited
        A stage that nobody has to wait for: the next task may be ordered, and begins after it.
    """

    def __init__(self, unawaited: str) -> None:
        self.lock = threading.RLock()
        """Held while what pages see is changed."""
        self.changes = 0
        """So often something has become different."""
        self._unawaited = unawaited
        self._task: WorkbenchTask | None = None

    @property
    def idle(self) -> bool:
        """Whether nothing is under way."""
        return self._task is None or not self._task.running

    @property
    def error(self) -> str:
        """Why the last one failed; empty: it has not."""
        return "" if self._task is None else self._task.error

    def as_json(self) -> dict[str, Any] | None:
        """What a page shows of what is under way; None: nothing is."""
        task = self._task
        return task.as_json() if task is not None and task.running else None

    def require_idle(self) -> None:
        """Refuse while something is under way that has to be waited for.

        Raises
        ------
        InputError
            That says what.
        """
        if self._task is not None and self._task.running and self._task.stage != self._unawaited:
            raise InputError(
                "something is under way", found=self._task.as_json()["what"], expected="its end"
            )

    def start(self, what: str, stages: Stages, work: Callable[[Tell], None]) -> None:
        """Begin a task, as `WorkbenchTask` takes it.

        Raises
        ------
        InputError
            While another one is under way.
        """
        with self.lock:
            self.require_idle()
            before = self._task

            def after(tell: Tell) -> None:
                if before is not None:
                    before.wait()
                work(tell)

            self._task = WorkbenchTask(what, stages, after, self.changed)
            self.changes += 1
            self._task.start()

    def changed(self) -> None:
        """Count that something has become different."""
        with self.lock:
            self.changes += 1

    def stop(self) -> None:
        """End what is under way at its next stage."""
        if self._task is not None:
            self._task.stop()
