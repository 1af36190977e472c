"""One step of a calibration in a process of its own: what it says and asks as lines.

``python -m abbe.daemon.commands.calibration.step_child``: its standard input is one line of JSON
with what is wanted, then one line for each answer. A line of its standard output that is a JSON
object is a question (``ask``), an event of a measurement (``event``), why it failed (``error``), or
a line of the commands with what its sentences were made of (``line``, ``sentences``); all others
are lines of the commands that are no sentences.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from collections.abc import Mapping
from io import TextIOBase
from pathlib import Path
from typing import TextIO, cast

from abbe.compcore.sentences import Sentence, as_it_stands, remembered, said, sentences_in


class SaidLines(TextIOBase):
    """Standard output on which each line that is a sentence says what it was made of.

    Parameters
    ----------
    out
        Where the lines go.
    made
        The sentences that were made, by their text.
    """

    def __init__(self, out: TextIO, made: Mapping[str, Sentence]) -> None:
        self._out, self._made = out, made
        self._begun = ""

    def write(self, text: str) -> int:
        """Take text; a line goes on when it is whole."""
        *lines, self._begun = (self._begun + text).split("\n")
        for line in lines:
            self._out.write(self._with_parts(line) + "\n")
        return len(text)

    def _with_parts(self, line: str) -> str:
        sentence = self._made.get(line) or self._made.get(line.strip())
        if sentence is None:
            return line
        return json.dumps({"line": line, "sentences": sentences_in(sentence)}, ensure_ascii=False)

    def fileno(self) -> int:
        """Of where the lines go."""
        return self._out.fileno()

    def flush(self) -> None:
        """Have what was written go on."""
        self._out.flush()


def main() -> None:
    """Do the step; the exit status says whether it is done."""
    import typer

    from abbe.compcore.errors import AbbeError
    from abbe.daemon.calibration.request import CalibrationRequest
    from abbe.daemon.commands.calibration.guide import calibrate, steps_now
    from abbe.daemon.config import load_config

    task = json.loads(sys.stdin.readline())
    step = task["step"]
    threading.Thread(target=_end_with, args=(task["lifeline"],), daemon=True).start()

    def ask(question: str, *, default: bool = True) -> bool:
        del default  # somebody is there
        if question.endswith("Go on?"):
            # agreed to by whoever started this step, and to no other one
            return f" {step}: " in question
        _tell("ask", as_it_stands(question))
        return sys.stdin.readline().strip() == "y"

    try:
        # the workbench began this process with it held back
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        with remembered() as made:
            sys.stdout = cast("TextIO", SaidLines(sys.stdout, made))
            request = CalibrationRequest(
                load_config(Path(task["config"])), Path(task["folder"]), task["time"],
                task["check_time"], tuple(task["tools"]), task["controller"], task["tables"],
                yes=False, by=task["by"], as_json=True, language=task.get("language", "en"),
            )  # fmt: skip
            calibrate(request, typer.echo, ask, step)
        done = any(now.step.name == step and now.at for now in steps_now(request))
    except AbbeError as error:
        _tell("error", error.sentence)
        sys.exit(1)
    except typer.Exit as ended:
        sys.exit(ended.exit_code)
    except KeyboardInterrupt:
        _tell("error", said("stopped; it goes on here"))
        sys.exit(1)
    sys.exit(0 if done else 1)


def _end_with(lifeline: int) -> None:
    """Stop as by Ctrl-C when nobody reads any more what is said here: its workbench is gone."""
    while os.read(lifeline, 1):
        pass
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    os.kill(os.getpid(), signal.SIGINT)


def _tell(kind: str, text: Sentence) -> None:
    found = {kind: text, "sentences": sentences_in(text)}
    sys.stdout.write(json.dumps(found, ensure_ascii=False) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
