"""What is done at a machine's controller: one thing at a time, in a thread, watched meanwhile."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.answers.tables.upload_words import named, naming
from abbe.daemon.config import Configuration
from abbe.daemon.upload.operator_port import OperatorPort
from abbe.daemon.workbench.fresh import FreshConfiguration

Act = Callable[[Configuration, OperatorPort], Awaitable[tuple[bool, list[str]]]]
"""Something done at the controller: whether it went well, and its last lines."""


@dataclass
class DeskWork:
    """What is done at the controller at present, or was done last.

    Attributes
    ----------
    kind
        ``status``, ``preflight``, ``write`` or ``recover``.
    change
        What it is about: ``upload``, ``rollback``, or empty.
    said
        Its lines for people.
    doing
        The step that is under way, and how much of it is done, 0 to 1.
    ended
        ``""`` while it is under way, ``good``, or ``bad``.
    """

    kind: str
    change: str = ""
    said: list[str] = field(default_factory=list)
    doing: str = "beginning"
    part: float = 0.0
    ended: str = ""


class ControllerWork:
    """The controller's only worker; may be asked from any thread.

    Parameters
    ----------
    fresh
        The configuration, read anew for whatever is done.
    """

    def __init__(self, fresh: FreshConfiguration) -> None:
        self._fresh = fresh
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self.last: DeskWork | None = None

    @property
    def busy(self) -> bool:
        """Whether something is under way."""
        return self.last is not None and not self.last.ended

    def start(self, work: DeskWork, act: Act) -> None:
        """Do something, in a thread.

        Raises
        ------
        InputError
            While something is under way.
        """
        with self._lock:
            if self.busy:
                raise InputError("something is under way at the controller", expected="its end")
            self.last = work
            self._thread = threading.Thread(target=self._run, args=(work, act), name="tables")
            self._thread.start()

    def close(self) -> None:
        """Wait until what is under way has ended: an upload is not cut off."""
        if self._thread is not None:
            self._thread.join()

    def _run(self, work: DeskWork, act: Act) -> None:
        good, lines = False, ["a mistake of Abbe's: the terminal says more; please report it"]

        async def nobody() -> bool:
            return False

        def tell(line: str) -> None:
            work.said.append(line)
            work.doing, work.part = line, 0.0

        def progress(part: float) -> None:
            work.part = part

        try:
            configuration = self._fresh.now()
            port = naming(OperatorPort(tell, progress, lambda _: True, nobody), configuration.path)

            async def acted() -> tuple[bool, list[str]]:
                return await act(configuration, port)

            good, lines = asyncio.run(acted())
        except AbbeError as error:
            lines = [error.sentence]
        except (OSError, MemoryError) as error:
            lines = [f"{type(error).__name__}: {error}"]
        finally:
            work.said += [named(line, self._fresh.path) for line in lines]
            work.ended = "good" if good else "bad"
