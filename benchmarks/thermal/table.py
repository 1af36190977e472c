"""The table of thermal days and what it says in sum, as Markdown."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from benchmarks.alternatives.black_box import SETTINGS
from benchmarks.thermal.days import SEEN, UNSEEN
from benchmarks.thermal.learners import SPREADSHEET
from benchmarks.thermal.outcome import Outcome

METHODS = {
    "before": "nothing",
    "floor": "noise",
    "abbe": "Abbe",
    "spreadsheet": "spreadsheet",
    "process": "Gaussian process",
    "boosting": "boosting",
}
LEARNERS = ("spreadsheet", "process", "boosting")

HEADING = f"""## Thermal days: a second simulator that shares nothing with Abbe

`python -m benchmarks.thermal_days`: a C-frame mill of eight bodies that store heat and pass it on
(bearing, head, column front and rear, bed, table, scales), in a shop with air that swings, doors,
sun with clouds, spindle work, coolant and its chiller, hydraulics (`benchmarks/thermal`). No body
has a time constant of its own, thermometers sit loosely (up to 70 % air), are off by a constant and
read in steps of 0.05 K; noise of 0.3 µm a reading and 0.5 µm that stays for 1 to 30 minutes. From
the bare machine `{SEEN}` days are learnt, read every 5 minutes for 10 hours (`abbe diagnose
--apply`), and `{UNSEEN}` later days foretold; each day and direction has its own zero.

RMS on the later days in µm, medians of the seeds. *Nothing*: the machine as it is. *Noise*: what
the probes themselves err. {SPREADSHEET}. {SETTINGS} They learn from positions, signals, time and
direction. *Plausible*: the first effect that Abbe named is thermal, in a direction in which the
machine moves, and reads a thermometer that the same source of heat moves (each source is followed
apart by the simulator). *False*: effects of which this does not hold."""


def line(o: Outcome) -> str:
    """One outcome, for the terminal."""
    rms = " ".join(f"{o.rms.get(m, np.nan):7.2f}" for m in METHODS)
    said = "; ".join(f"!{n}" if n in o.false else n for n in o.named) or "nothing"
    return f"{o.scenario:45} {o.seed} | {rms} | {o.seconds:5.1f} s | {said}"


def section(outcomes: Sequence[Outcome]) -> str:
    """Everything that the page says."""
    heading = [textwrap.fill(part, 100, break_on_hyphens=False) for part in HEADING.split("\n\n")]
    return "\n\n".join([*heading, summary(outcomes), table(outcomes)])


def _warm(outcomes: Sequence[Outcome]) -> list[Outcome]:
    return [o for o in outcomes if not o.scenario.startswith("empty")]


def summary(outcomes: Sequence[Outcome]) -> str:
    """Counts, in a few lines."""
    warm = _warm(outcomes)
    empty = [o for o in outcomes if o.scenario.startswith("empty")]
    lines = [
        f"- {sum(o.first for o in warm)} of {len(warm)}: the first cause named is plausible; "
        f"{sum(len(o.false) for o in warm)} of {sum(len(o.named) for o in warm)} effects named in "
        "all are not",
        f"- days on which the machine does not move: a cause is named in "
        f"{sum(bool(o.named) for o in empty)} of {len(empty)}",
    ]
    for other in LEARNERS:
        ratios = [o.rms["abbe"] / o.rms[other] for o in warm if other in o.rms]
        if ratios:
            better = sum(r <= 1.0 for r in ratios)
            lines.append(
                f"- Abbe's error on later days is {np.median(ratios):.2f} of that of "
                f"{_with_article(other)} (median), at most {max(ratios):.2f}; no greater in "
                f"{better} of {len(ratios)}"
            )
    for name in ("abbe", *LEARNERS):
        here = [o for o in warm if name in o.rms]
        worse = sum(o.rms[name] > o.rms["before"] for o in here)
        idle = [o for o in empty if name in o.rms]
        more = sum(o.rms[name] > 1.01 * o.rms["before"] for o in idle)
        still = f"; by over 1 % where the machine does not move in {more} of {len(idle)}"
        still = still if idle else ""
        lines.append(f"- {METHODS[name]}: worse than nothing in {worse} of {len(here)}{still}")
    return "\n".join(lines)


def _with_article(name: str) -> str:
    return name if name == "boosting" else f"the {METHODS[name]}"


def table(outcomes: Sequence[Outcome]) -> str:
    """One line for each scenario: medians of its seeds."""
    lines = [
        "| days | " + " | ".join(METHODS.values()) + " | plausible | false | named (first seed) |",
        "| --- |" + " ---: |" * len(METHODS) + " --- | ---: | --- |",
    ]
    groups: dict[str, list[Outcome]] = {}
    for o in outcomes:
        groups.setdefault(o.scenario, []).append(o)
    for name, group in groups.items():
        figures = [
            f"{np.median([o.rms[m] for o in group]):.2f}" if m in group[0].rms else "–"
            for m in METHODS
        ]
        empty = name.startswith("empty")
        first = "–" if empty else f"{sum(o.first for o in group)} of {len(group)}"
        false = sum(len(o.false) for o in group)
        said = ", ".join(f"`{n}`" for n in group[0].named) or "nothing"
        label = f"{name} ({len(group)} campaigns)"
        lines.append(f"| {label} | {' | '.join(figures)} | {first} | {false} | {said} |")
    return "\n".join(lines)
