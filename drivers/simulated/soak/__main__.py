"""``python -m abbe.drivers.simulated.soak``: soak a supervised ``abbe run``, tell what it broke."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from abbe.drivers.simulated.soak.faults import COMPUTER_FAULTS
from abbe.drivers.simulated.soak.memory import SETTLED, MemoryCurve
from abbe.drivers.simulated.soak.soak import Soak, SoakOutcome
from abbe.drivers.simulated.soak.supervisor import clock_library


def main(arguments: Sequence[str] | None = None) -> int:
    """Run; exit status 1 when a promise was not kept."""
    parser = argparse.ArgumentParser(
        prog="python -m abbe.drivers.simulated.soak", description=__doc__
    )
    parser.add_argument("--seconds", type=float, default=180.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--without", default="", help="kinds of fault left out, with commas")
    parser.add_argument("--folder", type=Path, help="for the wire's log, records and journal")
    asked = parser.parse_args(arguments)
    without = [*filter(None, asked.without.split(","))]
    if clock_library() is None:
        without.append("clock_jump")
        _say("libfaketime is not installed: the clock does not jump")
    with tempfile.TemporaryDirectory(prefix="soak-") as made:
        folder = (asked.folder or Path(made)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        soak = Soak(seed=asked.seed, seconds=asked.seconds, folder=folder, without=without)
        _say(f"{asked.seconds:g} s, seed {asked.seed} …")
        outcome = soak.run()
        for name, curve in (("memory", outcome.memory), ("memory-http", outcome.http_memory)):
            (folder / f"{name}.csv").write_text(curve.text(), encoding="utf-8")
    _report(outcome)
    curves = (outcome.memory, outcome.http_memory)
    grows = any(found is not None and found.shown for found in (c.growth for c in curves))
    return 1 if outcome.violations or outcome.http.wrong or grows else 0


def _report(outcome: SoakOutcome) -> None:
    _say(*outcome.lines[:20])
    if len(outcome.lines) > 20:
        _say(f"… and {len(outcome.lines) - 20} more")
    tally = outcome.tally
    computer = {k: n for k, n in outcome.faults.items() if k in COMPUTER_FAULTS}
    wire = {k: n for k, n in outcome.faults.items() if k not in COMPUTER_FAULTS}
    _say(
        f"violations            {len(outcome.violations)}",
        f"writes judged         {tally.messages - tally.not_judged} messages, {tally.positions} "
        f"positions, {tally.steps} steps; {tally.compensating} in full correction",
        f"not judged            {tally.not_judged} messages, in stalls of the judge's own process",
        f"faults of the wire    {sum(wire.values())}: {_counts(wire)}",
        f"faults of the computer {sum(computer.values())}: {_counts(computer)}",
        f"started again         {_counts(outcome.restarts) or 'never'}",
        f"slowest recovery      {tally.slowest_recovery:.1f} s in calm",
        f"cycles in calm        {outcome.cycles}, missed {outcome.missed}",
        f"clients               {outcome.answers} answers at the control socket",
        f"clients over HTTP     {_counts(outcome.http.answers)} answers; silent ones cut off "
        f"{outcome.http.cut}, rubbish {outcome.http.rubbish}, {outcome.http.gone} found nobody, "
        f"{len(outcome.http.wrong) + outcome.http.more} wrong answers",
        *outcome.http.wrong,
    )
    _say_memory("memory               ", outcome.memory)
    _say_memory("memory, HTTP process ", outcome.http_memory)


def _say_memory(what: str, memory: MemoryCurve) -> None:
    if life := memory.longest:
        _say(
            f"{what} {life[0][1]:.1f} MB at first, {life[-1][1]:.1f} MB after {life[-1][0]:.0f} s; "
            f"after {SETTLED:g} s: {memory.growth or 'watched for too short a time'}"
        )


def _counts(counted: dict[str, int]) -> str:
    return ", ".join(f"{kind} {n}" for kind, n in sorted(counted.items()))


def _say(*lines: str) -> None:
    for line in lines:
        sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
