"""Does the diagnosis name hidden causes, and what do others make of them? One table.

``python -m benchmarks.diagnosis`` runs all scenarios and writes the section of docs/validation.md;
``--keep FILE`` writes every outcome to a file as it comes, and runs only what is not in it;
``--only NAME`` runs one cause, ``--quick`` a few, ``--without-others`` leaves the learners out;
these write nothing. ``--workers N`` processes here, or ``--scheduler tcp://…`` a Dask scheduler's
workers, with the project on their path.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from abbe.daemon.arguments.spread.options import SpreadOptions
from abbe.daemon.spreading.spread import spread
from benchmarks.alternatives import black_box, sparse
from benchmarks.hidden.judging import outcome, table
from benchmarks.hidden.judging.spread_trials import LEARNERS, trial_tasks
from benchmarks.hidden.scenario import MULTIPLES, Scenario, scenarios
from benchmarks.measuring.report import write_section

VALIDATION = Path(__file__).parents[1] / "docs" / "validation.md"
SETTINGS = f"{black_box.SETTINGS} {sparse.SETTINGS}"


def main() -> None:
    """Run the scenarios, print, write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", default=None)
    parser.add_argument("--empty", type=int, default=None)
    parser.add_argument("--sizes", type=int, nargs="*", default=list(MULTIPLES))
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--scheduler", default=None)
    parser.add_argument("--without-others", action="store_true")
    parser.add_argument("--keep", type=Path, default=None)
    options = parser.parse_args()
    chosen = _chosen(options)
    done = {o.scenario: o for o in outcome.read(options.keep)} if options.keep else {}
    left = [s for s in chosen if s not in done]
    tasks = trial_tasks(left, [] if options.without_others else list(LEARNERS))
    place = SpreadOptions(options.workers, options.scheduler).place(len(tasks))
    for _, body in spread(tasks, place, "trials"):
        found = outcome.of_line(body.decode())
        done[found.scenario] = found
        if options.keep:
            outcome.write(options.keep, done.values())
        print(table.line(found), flush=True)
    outcomes = [done[s] for s in chosen]
    print(table.summary(outcomes))
    if len(outcomes) == len(list(scenarios())) and not options.without_others:
        write_section("diagnosis", table.section(outcomes, SETTINGS), page=VALIDATION)


def _chosen(options: argparse.Namespace) -> list[Scenario]:
    chosen = [s for s in scenarios() if options.only is None or options.only in s.causes]
    chosen = [s for s in chosen if not s.causes or s.multiple in options.sizes]
    if options.empty is not None:
        empty = [s for s in chosen if not s.causes][: options.empty]
        chosen = [s for s in chosen if s.causes or s in empty]
    if options.quick:
        chosen = [s for s in chosen if s.multiple in (0, 6)][:: max(1, len(chosen) // 12)]
    return chosen


if __name__ == "__main__":
    main()
