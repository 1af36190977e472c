"""A simulated device in a process of its own, started and ordered about from another."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from types import TracebackType
from typing import Any, Self

GRACE = 5.0
"""s for the process to end by itself before it is killed."""


def end(process: subprocess.Popen[str]) -> None:
    """End a simulated device: its input closed, else killed."""
    if process.stdin is not None:
        process.stdin.close()
    try:
        process.wait(GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()


class SimulatedProcess:
    """``python -m abbe.drivers.simulated …`` as a context; ends with it, and with this process.

    Parameters
    ----------
    arguments
        What follows ``abbe.drivers.simulated``, e.g. ``"serial", "dro"``.

    Attributes
    ----------
    ready
        What it said of itself when it was ready.
    """

    def __init__(self, *arguments: str) -> None:
        self._command = [
            sys.executable, "-m", "abbe.drivers.simulated", *arguments, "--die-with-stdin",
        ]  # fmt: skip
        self._process: subprocess.Popen[str] | None = None
        self._one_at_a_time = threading.Lock()
        self.ready: dict[str, Any] = {}

    def __enter__(self) -> Self:
        """Start it and wait until it is ready.

        Raises
        ------
        RuntimeError
            When it does not start.
        """
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
        self.ready = self._line()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End it: its input closed, else killed."""
        if self._process is not None:
            end(self._process)

    def order(self, do: str, **more: Any) -> dict[str, Any]:
        """Have something done, from any thread; hands back the answer once it is.

        Raises
        ------
        RuntimeError
            When it was not, or the process has ended.
        """
        assert self._process is not None and self._process.stdin is not None  # noqa: S101, PT018
        with self._one_at_a_time:
            self._process.stdin.write(json.dumps({"do": do} | more) + "\n")
            self._process.stdin.flush()
            answer = self._line()
        if answer.get("done") != do:
            raise RuntimeError(f"{do}: {answer}")
        return answer

    def kill(self) -> None:
        """Kill it, without a chance to clean up."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _line(self) -> dict[str, Any]:
        assert self._process is not None and self._process.stdout is not None  # noqa: S101, PT018
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(
                f"it ended (status {self._process.wait(GRACE)}); try by hand: "
                + " ".join(self._command)
            )
        answer: dict[str, Any] = json.loads(line)
        return answer
