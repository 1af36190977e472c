"""How soon is a changed machine noticed, and how often a sound one accused? Years of checks.

``python -m benchmarks.check_points`` measures the simulated bridge once, fits a model, and has four
spheres probed on 250 working days of a simulated year, again and again with another weather and
scatter: of a sound machine, and of one to which something happens at the 121st check. It writes its
section of ``docs/validation.md`` and fails where a stated number of checks does not hold.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from abbe.compcore.monitoring.charts import ChartDesign
from abbe.compcore.monitoring.judgement import Judgement, judge
from abbe.daemon.demo.prepare import START
from abbe.drivers.simulated.bridge.checks import (
    DAY,
    DAYS,
    FIRST_DAY,
    STATED,
    WhatHappens,
    year_of_checks,
)
from abbe.drivers.simulated.bridge.measure import campaign
from benchmarks.measuring.report import machine, write_section

PAGE = Path(__file__).resolve().parent.parent / "docs" / "validation.md"
AT, YEAR = 120, 250
"""Checks before something happens, and of a whole year."""
SCATTER = 3.0
"""Of what is stated for a reading: lasting scatter from day to day that nobody has stated."""


@dataclass(frozen=True)
class Promise:
    """Something that happens to the machine.

    Attributes
    ----------
    what
        As the simulator knows it.
    words
        For the table.
    within
        Checks within which it is noticed, as `docs/check-points.md` states.
    named
        In which component, growing with what, it may be described.
    """

    what: WhatHappens
    words: str
    within: int
    named: frozenset[tuple[str, str]]


_SCALES = [f"T_{a}{k}" for a in "xyz" for k in "12"]
PROMISES = (
    Promise("crash", "crash: X turned on Y by 10 µrad", 3, frozenset({("Y", "X")})),
    Promise(
        "levelling",
        "bed levelled anew: 15 µrad of roll a metre",
        3,
        frozenset({("X", "Y"), ("Z", "X"), ("X", "Z"), ("Z", "Y")}),
    ),
    Promise("sensor", "X's thermistors drift by 0.2 K a month", 30, frozenset({("X", "X")})),
    Promise(
        "quill",
        "the spindle ages: 0.5 µm/K more a month",
        130,
        frozenset(("Z", s) for s in [*_SCALES, "T_amb"]),
    ),
)


def fitted(folder: Path) -> Model:
    """What the machine was when it was measured."""
    (folder / "campaign.csv").write_text(campaign(1), "utf-8")
    start = load_model(START)
    return fit(start, read_campaign(folder / "campaign.csv", start.machine)).model


def read(folder: Path, model: Model, what: WhatHappens, checks: int, year: int) -> Campaign:
    """A year's checks."""
    path = folder / "year.csv"
    path.write_text(year_of_checks(1, what, AT, checks, year), "utf-8")
    return read_campaign(path, model.machine)


def scattered(checks: Campaign, times: float, year: int) -> Campaign:
    """The same with lasting scatter in X, Y and Z, common to all spheres of a day."""
    c = checks.conditions
    day = np.round((c.time - FIRST_DAY) / DAY).astype(np.int64)
    days, of = np.unique(day, return_inverse=True)
    rng = np.random.default_rng([250, year])
    more = rng.normal(size=(len(days), 3))
    for k in range(1, len(days)):
        stays = np.exp(-(days[k] - days[k - 1]) / DAYS)
        more[k] = stays * more[k - 1] + np.sqrt(1.0 - stays**2) * more[k]
    u = np.zeros((checks.n, 3)) if c.u is None else c.u
    return replace(checks, value=checks.value + times * STATED * (more[of.reshape(-1)] * u).sum(1))


@dataclass(frozen=True)
class Row:
    """Some years of one kind.

    Attributes
    ----------
    words
        What they are of.
    within
        Stated number of checks; None: nothing happens, or nothing is stated.
    delays
        Checks from what happened until the alarm, that one included; None: no alarm.
    early
        Alarms before anything had happened.
    named
        Alarms that describe it as it is.
    checks
        Sound checks that were judged.
    """

    words: str
    within: int | None
    delays: tuple[int | None, ...]
    early: int
    named: int
    checks: int

    @property
    def held(self) -> bool:
        """Whether it is as stated."""
        if self.early > likely(self.checks / ChartDesign().false_alarm_every):
            return False
        within = self.within
        return within is None or all(d is not None and d <= within for d in self.delays)


def likely(expected: float) -> int:
    """The most false alarms that do not contradict so many expected ones (Poisson, 99.9 %)."""
    count, term = 0, np.exp(-expected)
    total = term
    while total < 0.999:
        count += 1
        term *= expected / count
        total += term
    return count


def years_of(
    promise: Promise, model: Model, folder: Path, years: int, design: ChartDesign, times: float
) -> Row:
    """Years in which something happens."""
    delays: list[int | None] = []
    early = named = 0
    length = min(YEAR, AT + promise.within + 20)
    for year in range(years):
        checks = read(folder, model, promise.what, length, year)
        if times:
            checks = scattered(checks, times, year)
        found = judge(model, checks, design)
        alarm = found.charts.alarm
        if alarm is not None and alarm.check < AT:
            early += 1
            continue
        delays.append(None if alarm is None else alarm.check - AT + 1)
        named += alarm is not None and named_so(found, promise, model, checks, design)
    words = f"{promise.words}, {times:g} × the stated scatter" if times else promise.words
    within = None if times else promise.within
    return Row(words, within, tuple(delays), early, named, AT * years)


def named_so(
    found: Judgement, promise: Promise, model: Model, checks: Campaign, design: ChartDesign
) -> bool:
    """Whether the sentence names what it is, at the stated number of checks after it happened."""
    until = FIRST_DAY + (7 * ((AT + promise.within) // 5) + (AT + promise.within) % 5) * DAY
    later = judge(model, checks.rows(checks.conditions.time < until), design)
    change = later.change or found.change
    return bool(
        change
        and change.patterns
        and (change.patterns[0].component, change.patterns[0].along) in promise.named
    )


def sound_years(
    words: str, model: Model, folder: Path, years: int, design: ChartDesign, times: float
) -> Row:
    """Years in which nothing happens."""
    early = 0
    for year in range(years):
        checks = read(folder, model, "nothing", YEAR, year)
        found = judge(model, scattered(checks, times, year) if times else checks, design)
        early += found.charts.alarm is not None
    return Row(words, None, (), early, 0, YEAR * years)


def rows(years: int) -> Iterator[Row]:
    """All of the table."""
    design = ChartDesign()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = fitted(folder)
        yield sound_years("a sound machine", model, folder, years, design, 0.0)
        yield sound_years(
            f"a sound machine, {SCATTER:g} × the stated scatter, lasting {DAYS:g} days",
            model, folder, years, design, SCATTER,
        )  # fmt: skip
        for promise in PROMISES:
            yield years_of(promise, model, folder, years, design, 0.0)
        yield years_of(PROMISES[0], model, folder, years, design, SCATTER)


def table(found: list[Row], years: int) -> str:
    """The section of the page."""
    lines = [_BEFORE.format(years=years)]
    for row in found:
        seen = [d for d in row.delays if d is not None]
        of = len(row.delays)
        cells = [
            row.words,
            f"{row.early} in {row.checks} checks",
            f"{len(seen)} of {of}" if of else "",
            f"{np.mean(seen):.1f} ({max(seen)}) checks" if seen else "",
            str(row.within or ""),
            f"{row.named} of {of}" if of else "",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    day = time.strftime("%Y-%m-%d")
    return "\n".join([*lines, _AFTER.format(times=SCATTER, machine=machine(), day=day)])


_BEFORE = """## Is the model still true? Years of checks

`python -m benchmarks.check_points`: four spheres on the table of the
[simulated bridge](simulated-cmm.md), probed every working day and held against its fitted model;
{years} years of each kind, with another weather and scatter. Each probing scatters by 0.4 µm, the
probe by 0.5 µm from morning to morning, the machine by 0.3 µm over days; 0.5 µm are stated.
Something happens at the 121st check. A sound machine may be accused once in 5000 checks (the
default), so once in 20 such years.

| | false alarms | noticed | after, mean (longest) | stated: within | described as it is |
| --- | --- | --- | --- | --- | --- |"""
_AFTER = """
*After* counts the check that raised the alarm. Lasting scatter of {times:g} times what is stated is
learned from the first checks; a crash then takes longer to stand out. *Described as it is*: the
first pattern of the sentence is the component, and the axis or a temperature with which it grows,
at the stated number of checks.

Measured on {machine}, {day}."""


def main() -> None:
    """Run, print, write; exit status 1 where a promise does not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--years", type=int, default=10)
    parser.add_argument("--dry", action="store_true", help="write nothing")
    options = parser.parse_args()
    found = []
    for row in rows(options.years):
        found.append(row)
        print(row, flush=True)
    if not options.dry:
        write_section("check-points", table(found, options.years), PAGE)
    sys.exit(0 if all(row.held for row in found) else 1)


if __name__ == "__main__":
    main()
