"""One step of a calibration in a process of its own: what it says and asks as lines.

``python -m abbe.daemon.commands.calibration.step_child``: its standard input is one line of JSON
with what is wanted, then one line for each answer. A line of its standard output that is a JSON
object is a question (``ask``), an event of a measurement (``event``) or why it failed (``error``);
all others are the lines of the commands.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any


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
        _tell({"ask": question})
        return sys.stdin.readline().strip() == "y"

    try:
        request = CalibrationRequest(
            load_config(Path(task["config"])), Path(task["folder"]), task["time"],
            task["check_time"], tuple(task["tools"]), task["controller"], task["tables"],
            yes=False, by=task["by"], as_json=True,
        )  # fmt: skip
        calibrate(request, typer.echo, ask, step)
        done = any(now.step.name == step and now.at for now in steps_now(request))
    except AbbeError as error:
        _tell({"error": str(error)})
        sys.exit(1)
    except typer.Exit as ended:
        sys.exit(ended.exit_code)
    except KeyboardInterrupt:
        _tell({"error": "stopped; it goes on here"})
        sys.exit(1)
    sys.exit(0 if done else 1)


def _end_with(lifeline: int) -> None:
    """Stop as by Ctrl-C when nobody reads any more what is said here: its workbench is gone."""
    while os.read(lifeline, 1):
        pass
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    os.kill(os.getpid(), signal.SIGINT)


def _tell(found: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(found, ensure_ascii=False) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
