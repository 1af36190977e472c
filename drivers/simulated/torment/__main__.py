"""``python -m abbe.drivers.simulated.torment``: torment ``abbe run``, tell what it broke."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from abbe.drivers.simulated.torment.kinds import KINDS
from abbe.drivers.simulated.torment.trial import Trial
from abbe.drivers.simulated.torment.wires import WIRES, wire_class


def main(arguments: Sequence[str] | None = None) -> int:
    """Run; exit status 1 when a promise was not kept."""
    parser = _parser()
    asked = parser.parse_args(arguments)
    unknown = {*filter(None, (asked.only + "," + asked.without).split(","))} - set(KINDS)
    if unknown:
        parser.error(f"no such kind: {', '.join(sorted(unknown))}")
    runs = [
        (protocol, variant)
        for protocol in (list(WIRES) if asked.protocol == "all" else [asked.protocol])
        for variant in ([asked.variant] if asked.variant else wire_class(protocol).VARIANTS)
    ]
    seconds = max(5.0, asked.seconds / len(runs))
    found = sum(_violations(protocol, variant, seconds, asked) for protocol, variant in runs)
    return 1 if found else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m abbe.drivers.simulated.torment", description=__doc__
    )
    parser.add_argument("--protocol", choices=[*WIRES, "all"], default="all")
    parser.add_argument("--variant", help="of the protocol's configuration; default all in turn")
    parser.add_argument("--seconds", type=float, default=60.0, help="all in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help=f"kinds, with commas: {', '.join(KINDS)}")
    parser.add_argument("--without", default="", help="kinds that are left out, with commas")
    parser.add_argument("--folder", type=Path, help="for the wire's log and Abbe's journal")
    parser.add_argument("--script", action="store_true", help="print the script, run nothing")
    return parser


def _violations(protocol: str, variant: str, seconds: float, asked: argparse.Namespace) -> int:
    """Torment one variant of a protocol and say how it went; how many promises were not kept."""
    kinds = _kinds(protocol, asked.only, asked.without)
    with tempfile.TemporaryDirectory(prefix="torment-") as made:
        folder = Path(made)
        if asked.folder:
            folder = asked.folder / f"{protocol}-{variant}-{asked.seed}"
            folder.mkdir(parents=True, exist_ok=True)
        trial = Trial(
            protocol,
            variant=variant,
            seed=asked.seed,
            seconds=seconds,
            kinds=kinds,
            folder=folder,
        )
        _say(f"{protocol} {variant}, seed {asked.seed}, {seconds:g} s, {', '.join(kinds)}")
        if asked.script:
            _say(*map(str, trial.script.torments))
            return 0
        outcome = trial.run()
    _say(*outcome.lines[:20])
    if len(outcome.lines) > 20:
        _say(f"… and {len(outcome.lines) - 20} more")
    tally = outcome.tally
    _say(
        f"  {len(outcome.violations)} violations; {tally.pictures} pictures shown, "
        f"{tally.messages} messages, {tally.positions} positions, {tally.steps} steps judged, "
        f"{tally.compensating} in full correction; {tally.not_judged} not judged "
        f"({outcome.stalls} stalls); slowest recovery in calm {tally.slowest_recovery:.1f} s"
    )
    return len(outcome.violations)


def _kinds(protocol: str, only: str, without: str) -> list[str]:
    """The protocol's kinds that are wanted."""
    kinds = [k for k in wire_class(protocol).KINDS if k not in without.split(",")]
    return [k for k in kinds if k in only.split(",")] if only else kinds


def _say(*lines: str) -> None:
    for line in lines:
        sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
