"""A step of a calibration that is under way: its process, what it says, what it asks."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from abbe.compcore.sentences import sentences_in

_MOST = 400
"""Lines that are kept, the newest."""
ANSWERS = {"yes": "y", "no": "n", "stands": "", "leave out": "s"}
"""What a person may answer → the line that the step is given."""


def step_json(
    step: str, lines: Sequence[str], sentences: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """What the page shows of a step that asks nothing and is not counted.

    `sentences` as `sentences_in` has them of the lines; None: found in them.
    """
    nothing: dict[str, Any] = {
        "question": "",
        "setup": "",
        "choices": [],
        "next": "",
        "done": None,
        "of": None,
        "left": None,
    }
    known = sentences_in(lines) if sentences is None else sentences
    return {"step": step, "lines": list(lines), "sentences": known, "ended": "", **nothing}


class StepProcess:
    """One step in a process of its own; may be asked from any thread.

    Parameters
    ----------
    module
        What does it: `abbe.daemon.commands.calibration.step_child`.
    task
        What that is given.
    """

    def __init__(self, module: str, task: Mapping[str, Any]) -> None:
        self.step = str(task["step"])
        self._lines: deque[str] = deque(maxlen=_MOST)
        self._sentences: dict[str, Any] = {}
        self._question = self._setup = ""
        self._choices: tuple[str, ...] = ()
        self._progress: Mapping[str, Any] = {}
        self._next = ""
        self._ended = ""
        # ends with this process however that ends: then the step ends in an orderly way, too
        begun, self._lifeline = os.pipe()
        # what it is sent before it can end in an orderly way waits until it can
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-u", "-m", module],
                pass_fds=(begun,),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                start_new_session=True,  # Ctrl-C is for the workbench, which then ends it
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        os.close(begun)
        self._write(json.dumps({**task, "lifeline": begun}))
        self._reader = threading.Thread(target=self._read, daemon=True, name="calibration")
        self._reader.start()

    @property
    def running(self) -> bool:
        """Whether it is under way."""
        return not self._ended

    def as_json(self) -> dict[str, Any]:
        """What the page shows of it; `left` in s."""
        return step_json(self.step, list(self._lines), dict(self._sentences)) | {
            "question": self._question,
            "setup": self._setup,
            "choices": list(self._choices),
            "next": self._next,
            "done": self._progress.get("done"),
            "of": self._progress.get("of"),
            "left": self._progress.get("left_s"),
            "ended": self._ended,
        }

    def answer(self, word: str) -> bool:
        """Answer what is asked; False where that is not asked."""
        if word not in self._choices:
            return False
        self._question, self._setup, self._choices = "", "", ()
        self._write(ANSWERS[word])
        return True

    def stop(self) -> None:
        """Have it end in an orderly way: rows that were measured are kept."""
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGINT)

    def close(self) -> None:
        """End it, and wait until it has."""
        if self.running:
            self.stop()
        self._reader.join()

    def _write(self, line: str) -> None:
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.write(line + "\n")
                self._process.stdin.flush()

    def _read(self) -> None:
        if self._process.stdout is not None:
            for line in self._process.stdout:
                self._take(line.rstrip("\n"))
            self._process.stdout.close()
        status = self._process.wait()
        self._question, self._setup, self._choices, self._next = "", "", (), ""
        self._ended = "good" if status == 0 else "bad"
        os.close(self._lifeline)
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()

    def _take(self, line: str) -> None:
        try:
            found = json.loads(line) if line.startswith("{") else None
        except ValueError:
            found = None
        if not isinstance(found, dict):
            self._lines.append(line)
            return
        self._sentences |= found.get("sentences", {})
        if "line" in found:
            self._lines.append(str(found["line"]))
        elif "ask" in found:
            self._question, self._choices = str(found["ask"]), ("yes", "no")
        elif "error" in found:
            self._lines.append(str(found["error"]))
        elif "event" in found:
            self._follow(found)

    def _follow(self, event: Mapping[str, Any]) -> None:
        """An event of a measurement."""
        text = str(event.get("text", ""))
        if "of" in event:
            self._progress = event
        if event["event"] == "next":
            self._next = text
            return
        if event["event"] == "set up":
            # what to press stands on the buttons
            text = text.partition("; Enter when")[0]
            self._setup = str(event.get("setup", ""))
            self._question, self._choices = text, ("stands", "leave out")
        self._lines.append(text)
