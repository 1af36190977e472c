"""What the workbench computes beside answering: one thing at a time, with how far it is."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.daemon.progress import Stages, TimeLeft
from abbe.daemon.workbench.few_arenas import give_back

Tell = Callable[[str], None]
"""Takes what is being done, in a few words."""


class TaskEndedError(AbbeError):
    """The workbench ends: what is being computed is not wanted any more."""


class WorkbenchTask:
    """One computation in a thread of its own.

    Parameters
    ----------
    what
        For people: what will be there when it is done.
    stages
        What is expected, with seconds.
    work
        Does it; is told how to say what it is at.
    done
        Called in the same thread when it is over, however it ended.
    """

    def __init__(
        self, what: str, stages: Stages, work: Callable[[Tell], None], done: Callable[[], None]
    ) -> None:
        self._what = what
        self._work, self._done = work, done
        self._time = TimeLeft(stages)
        self._stage = stages[0][0] if stages else ""
        self._stop = False
        self._over = False
        self.error: str = ""
        """Why it failed; empty: it has not."""
        # a fit that is under way at the end must not keep the process
        self._thread = threading.Thread(target=self._run, daemon=True, name=f"workbench: {what}")

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End it at its next stage."""
        self._stop = True

    @property
    def running(self) -> bool:
        """Whether it is under way."""
        return not self._over

    @property
    def stage(self) -> str:
        """What it is at."""
        return self._stage

    def wait(self) -> None:
        """Until it is over."""
        self._thread.join()

    def as_json(self) -> dict[str, Any]:
        """What a page shows of it; `left` in s."""
        return {
            "what": self._what,
            "stage": self._stage,
            "done": round(min(1.0, self._time.done), 3),
            "left": round(self._time.left, 1),
        }

    def _run(self) -> None:
        failed: str = "a mistake of Abbe's: the terminal says more; please report it"
        try:
            self._work(self._tell)
            failed = ""
        except TaskEndedError:
            failed = ""
        except AbbeError as error:
            failed = error.sentence
        except (OSError, MemoryError) as error:
            failed = f"{type(error).__name__}: {error}"
        finally:
            self.error, self._over = failed, True
            self._done()
            # what a large campaign took while it was worked out would stay for as long as this runs
            give_back()

    def _tell(self, stage: str) -> None:
        if self._stop:
            raise TaskEndedError("the workbench ends")
        self._stage = stage
        self._time.begin(stage)
