"""Answers of ``abbe status``: the run of a configuration, or every run of this computer."""

from __future__ import annotations

from pathlib import Path

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.arguments.live.running import control_socket
from abbe.daemon.control.runs import found_runs, same_file, status_at
from abbe.daemon.status.run_status import RunStatus


def the_run(config: Path) -> RunStatus:
    """The status of the run that was made from a configuration.

    Raises
    ------
    AbbeError
        When nothing runs with it, or it may not be asked.
    """
    if not config.exists():
        raise InputError("no such file", file=config, expected="a configuration that runs")
    others = []
    for run in found_runs():
        if run.status is None:
            others.append(f"{run.peer}: {run.reason}")
        elif made_from(run.status, config):
            return run.status
    path = control_socket(config)
    if path is not None and path.exists():
        return status_at(path)
    more = f"; another run cannot be asked: {'; '.join(others)}" if others else ""
    raise AbbeError(f"no correction runs with {config} on this computer{more}")


def made_from(status: RunStatus, config: Path) -> bool:
    """Whether a run was made from a configuration."""
    return any(f.role == "configuration" and same_file(f.path, config) for f in status.files)


def every_run() -> tuple[list[RunStatus], list[str]]:
    """The status of every run, and a line for each that cannot be asked."""
    found = found_runs()
    runs = [run.status for run in found if run.status is not None]
    return runs, [f"{run.peer}: {run.reason}" for run in found if run.status is None]
