"""Thermal days as tasks that can be spread over processes here."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from functools import partial

from abbe.daemon.spreading.spread_work import SpreadTask
from benchmarks.thermal.outcome import Outcome, as_line, of_line
from benchmarks.thermal.scenario import EMPTY, SCENARIOS, Run
from benchmarks.thermal.trial import run, with_others

_FUNCTION = "benchmarks.thermal.spread_days:told"
_CALLED = {scenario.name: scenario for scenario in (*EMPTY, *SCENARIOS)}


def day_tasks(
    asked: Iterable[tuple[Run, Outcome | None]], *, others: bool
) -> list[Callable[[], SpreadTask]]:
    """A task a run; those of which there is an outcome already lack the black boxes only."""
    found = []
    for one, kept in asked:
        words = {
            "scenario": one.scenario.name,
            "seed": one.seed,
            "others": others,
            "kept": None if kept is None else asdict(kept),
        }
        title = f"{one.scenario.name}, seed {one.seed}"
        found.append(partial(SpreadTask, _FUNCTION, json.dumps(words), {}, title))
    return found


def told(_: Mapping[str, bytes], argument: str) -> bytes:
    """The outcome of a run as a line; what a worker does."""
    asked = json.loads(argument)
    one = Run(_CALLED[asked["scenario"]], asked["seed"])
    if asked["kept"] is None:
        return as_line(run(one, others=asked["others"])).encode()
    return as_line(with_others(one, of_line(json.dumps(asked["kept"])))).encode()
