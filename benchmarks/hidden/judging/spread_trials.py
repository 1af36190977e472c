"""Trials as tasks that can be spread over processes here, or a Dask scheduler's workers."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial

from abbe.daemon.spreading.spread_work import SpreadTask
from benchmarks.alternatives import black_box, sparse
from benchmarks.hidden.judging.outcome import as_line
from benchmarks.hidden.judging.trial import Learner, run
from benchmarks.hidden.scenario import Scenario

LEARNERS: dict[str, Learner] = {
    "process": black_box.gaussian_process,
    "boosting": black_box.boosting,
    "lasso": sparse.lasso,
}
_FUNCTION = "benchmarks.hidden.judging.spread_trials:trial"


def trial_tasks(
    scenarios: Sequence[Scenario], learners: Sequence[str]
) -> list[Callable[[], SpreadTask]]:
    """A task a scenario."""
    asked = [json.dumps({"scenario": asdict(s), "learners": list(learners)}) for s in scenarios]
    return [partial(SpreadTask, _FUNCTION, argument, {}, argument) for argument in asked]


def trial(_: Mapping[str, bytes], argument: str) -> bytes:
    """Run a trial; what a worker does."""
    asked = json.loads(argument)
    scenario = asked["scenario"] | {"causes": tuple(asked["scenario"]["causes"])}
    learners = {name: LEARNERS[name] for name in asked["learners"]}
    return as_line(run(Scenario(**scenario), learners)).encode()
