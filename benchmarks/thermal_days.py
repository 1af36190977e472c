"""Thermal days of an independent simulator: how well are later days foretold, and by what names?

``python -m benchmarks.thermal_days`` runs all and writes the section of docs/validation.md;
``--keep FILE`` writes every outcome to a file as it comes, and runs only what is not in it (of
what was kept ``--without-others`` the black boxes alone);
``--only WORDS`` runs the scenarios whose name holds the words, ``--seeds N``, ``--empty N`` so
many, and ``--without-others`` leaves the black boxes out; these write nothing. ``--write`` runs
nothing and writes the section from what is kept.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from abbe.daemon.spreading.process_pool import ProcessPool
from abbe.daemon.spreading.spread import SpreadPlace, spread
from benchmarks.measuring.report import write_section
from benchmarks.thermal import outcome, table
from benchmarks.thermal.scenario import Run, runs
from benchmarks.thermal.spread_days import day_tasks

VALIDATION = Path(__file__).parents[1] / "docs" / "validation.md"


def main() -> None:
    """Run the scenarios, print, write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--empty", type=int, default=100)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--without-others", action="store_true")
    parser.add_argument("--keep", type=Path, default=None)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    if options.write:
        kept = outcome.read(options.keep)
        kept.sort(key=lambda o: o.seed)
        write_section("thermal-days", table.section(kept), page=VALIDATION)
        return
    chosen = [r for r in runs(options.seeds, options.empty) if options.only in r.scenario.name]
    done = {(o.scenario, o.seed): o for o in outcome.read(options.keep)} if options.keep else {}

    def key(r: Run) -> tuple[str, int]:
        return r.scenario.name, r.seed

    def lacks(r: Run) -> bool:
        return r.scenario.warms and "process" not in done[key(r)].rms

    others = not options.without_others
    asked: list[tuple[Run, outcome.Outcome | None]]
    asked = [(r, None) for r in chosen if key(r) not in done]
    if others:
        asked += [(r, done[key(r)]) for r in chosen if key(r) in done and lacks(r)]
    tasks = day_tasks(asked, others=others)
    for _, body in spread(tasks, SpreadPlace(ProcessPool(options.workers)), "days"):
        found = outcome.of_line(body.decode())
        done[found.scenario, found.seed] = found
        if options.keep:
            outcome.write(options.keep, done.values())
        print(table.line(found), flush=True)
    outcomes = [done[key(r)] for r in chosen]
    print(table.summary(outcomes))
    print(table.table(outcomes))
    whole = {key(r) for r in runs()}
    if set(done) >= whole and others and {key(r) for r in chosen} == whole:
        write_section("thermal-days", table.section(outcomes), page=VALIDATION)


if __name__ == "__main__":
    main()
