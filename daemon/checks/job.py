"""Recording readings and judging the machine: done in a process of its own, beside the correction.

``python -m abbe.daemon.checks.job``, started by a run and by nobody else: a `CheckRequest` comes in
by its standard input, a `CheckOutcome` goes out by its standard output.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import resource
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.checks_file import add_checks, read_checks
from abbe.compcore.model.model import Model
from abbe.compcore.monitoring.charts import ChartDesign
from abbe.daemon.answers.measurements import check_point
from abbe.daemon.answers.measurements.check_rows import check_rows
from abbe.daemon.arguments.measurements.check_reading import TypedReading

_NICER = 10
"""By how much it steps back behind the correction."""
_MEMORY = 2_000_000_000
"""Bytes of its own data: it fails before the correction's computer does."""


@dataclass(frozen=True)
class NewReading:
    """One reading to be recorded.

    Attributes
    ----------
    typed
        As it was measured.
    signals
        At that time.
    when
        s since 1970.
    corrected
        Whether the model corrected the positions then.
    """

    typed: TypedReading
    signals: Mapping[str, float]
    when: float
    corrected: bool


@dataclass(frozen=True)
class CheckRequest:
    """What is to be recorded and judged.

    Attributes
    ----------
    model
        That runs, with its switches.
    checks
        The file of checks.
    readings
        New ones; may be none.
    design
        What the charts are made for.
    diagnosing
        The commands that hand the rows to a diagnosis.
    """

    model: Model
    checks: Path
    readings: tuple[NewReading, ...]
    design: ChartDesign
    diagnosing: str


@dataclass(frozen=True)
class CheckOutcome:
    """What became of it.

    Attributes
    ----------
    recorded
        Names of the readings that were recorded.
    refused
        Name → why it was not.
    answer
        As ``abbe check-point --json``; None where there is nothing to judge.
    problem
        Why not; empty where there is no check yet.
    """

    recorded: tuple[str, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    answer: Mapping[str, Any] | None = None
    problem: str = ""


def record(request: CheckRequest) -> CheckOutcome:
    """Record the readings; one that stands in the file already is not recorded twice."""
    model, path = request.model, request.checks
    recorded: list[str] = []
    refused: dict[str, str] = {}
    for new in request.readings:
        name = new.typed.name
        try:
            before = read_checks(path, model.machine) if path.exists() else None
            if before is None or not _stands_in(before, new):
                active = model if new.corrected else None
                rows = check_rows(new.typed, model, new.when, before, new.signals, active)
                add_checks(path, rows, model.machine)
        except InputError as error:
            refused[name] = str(error)
        else:
            recorded.append(name)
    return CheckOutcome(tuple(recorded), refused)


def _stands_in(before: Campaign, new: NewReading) -> bool:
    then = np.isclose(before.conditions.time, new.when, rtol=0.0, atol=1e-3)
    setups = np.asarray(before.conditions.setup)
    return bool(np.any(then & np.isin(setups, new.typed.setups)))


def done(request: CheckRequest) -> CheckOutcome:
    """Record and judge."""
    model, path = request.model, request.checks
    made = record(request)
    if not path.exists():
        return made
    try:
        answer = check_point.judged(
            model,
            read_checks(path, model.machine),
            request.design,
            check_point.calibrated(model),
            request.diagnosing,
        )
    except AbbeError as error:
        return replace(made, problem=str(error))
    return replace(made, answer=check_point.as_json(answer))


def main() -> None:
    """One request, one outcome."""
    with contextlib.suppress(OSError, AttributeError):
        os.nice(_NICER)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (_MEMORY, _MEMORY))
    request = pickle.load(sys.stdin.buffer)
    out, sys.stdout = sys.stdout, sys.stderr
    pickle.dump(done(request), out.buffer)
    out.flush()


if __name__ == "__main__":
    # what is pickled names its class by the module, not by __main__
    from abbe.daemon.checks.job import main as _main

    _main()
