"""The workbench: first sight, viewers, fifty channels, 1e8 records, a million rows, what if.

Writes its sections of docs/performance.md. ``python -m benchmarks.workbench [WHAT …]``, of
``sight``, ``viewers``, ``channels``, ``hour``, ``past``, ``rows``,
``what-if``; all where none is named.
``--seconds`` is how long the fifty channels are watched: 3600 for what an hour adds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.browsing.channels import fifty_channels
from benchmarks.browsing.first_sight import first_sight
from benchmarks.browsing.full_hour import full_hour
from benchmarks.browsing.past import far_past
from benchmarks.browsing.rows import many_rows
from benchmarks.browsing.viewers import many_viewers
from benchmarks.browsing.what_if import what_if
from benchmarks.measuring.report import machine, write_section

PARTS: Mapping[str, Callable[[float], str]] = {
    "sight": lambda _: first_sight(),
    "viewers": lambda _: many_viewers(100.0),
    "channels": fifty_channels,
    "hour": lambda _: full_hour(10),
    "past": lambda _: far_past(100_000_000),
    "rows": lambda _: many_rows(1_000_000),
    "what-if": lambda _: what_if(),
}


def main() -> None:
    """Measure and write the sections."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="*", choices=[*PARTS, []], help="default: all")
    parser.add_argument("--seconds", type=float, default=900.0, help="of channels; default 900")
    asked = parser.parse_args()
    for name in asked.what or PARTS:
        text = PARTS[name](asked.seconds)
        print(text, flush=True)
        write_section(f"workbench-{name}", f"{text}\n\n{machine()}.")


if __name__ == "__main__":
    main()
