"""A judgement of a machine in words: has it changed, since when, in what, growing with what."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from abbe.compcore.monitoring.change import ChangePattern, MachineChange
from abbe.compcore.monitoring.judgement import Judgement
from abbe.compcore.units import in_digits

When = Callable[[float], str]
"""A moment, s since 1970, for people."""

_SEEN = 2.5
"""Standard deviations from which on a part is stated."""
_MOSTLY = 0.8
"""Part of a difference from which on its description is the whole of it."""
_SIZES = (2.0, 4.0)
"""Times its usual scatter: changes of a series for which the time to detect is stated."""


def judgement_words(found: Judgement, when: When) -> Iterator[str]:
    """Whether the machine has changed, and how soon a change would be found."""
    times = found.readings.times
    count = len(times)
    if found.change is None:
        since = f"since {when(float(times[0]))}" if count > 1 else "so far"
        yield f"NOTHING HAS CHANGED: {_checks(count)} {since}, no chart is beyond its limit."
    else:
        yield f"THE MACHINE HAS CHANGED {change_words(found, found.change, when)}"
    for k in found.wild if found.change is None else ():
        series = found.readings.series[k]
        yield (
            f"{series.name}: {_signed(float(found.expected.surprise[-1, k]))} {series.unit} beyond "
            "what was expected. Measure it again: where it reads so once more, the machine has "
            "changed; if not, it was a chip, or the artefact is loose."
        )
    if found.learning and found.change is None:
        yield (
            f"How checks scatter on this machine is known after {found.learning} more; until then "
            "only a gross change is found."
        )
    elif found.change is None:
        yield detection_words(found)
    yield (
        f"A sound machine is accused once in {found.design.false_alarm_every:g} checks, or less "
        "often."
    )


def change_words(found: Judgement, change: MachineChange, when: When) -> str:
    """Since when, in what component, growing with what; after 'the machine has changed'."""
    times, series = found.readings.times, found.readings.series
    before, after = (when(float(times[k])) for k in (change.last_sound, change.first_changed))
    text = (
        f"between the checks of {before} and {after}"
        if change.course == "at once"
        else f"ever more since the check of {before}"
    )
    patterns = [pattern_words(p) for p in change.patterns]
    if not patterns:
        return f"{text}, most of all {series[change.largest].name}; in no simple way."
    text += f": {'; '.join(patterns)}"
    if change.explained < _MOSTLY:
        text += f". That is {change.explained:.0%} of it, the rest hangs on more than one axis"
    return text + "."


def pattern_words(pattern: ChangePattern) -> str:
    """One part of a change: ``in Y, grows with X by +10.2 ± 0.8 µm per m``."""
    turned = pattern.component in "ABC"
    unit = "µrad" if turned else "µm"
    where = f"{'about' if turned else 'in'} {pattern.component}"
    middle = f"{_signed(pattern.constant)} ± {in_digits(pattern.constant_sd, 1)} {unit}"
    if not pattern.along:
        return f"{where} by {middle}"
    per, many = {"mm": ("m", 1e3), "degree": ("degree", 1.0)}.get(
        pattern.unit, (f"unit of {pattern.along}", 1.0)
    )
    sd = in_digits(many * pattern.slope_sd, 1)
    slope = f"{_signed(many * pattern.slope)} ± {sd} {unit} per {per}"
    text = f"{where}, grows with {pattern.along} by {slope}"
    if abs(pattern.constant) > _SEEN * pattern.constant_sd:
        text += f" ({middle} in the middle)"
    return text


def detection_words(found: Judgement) -> str:
    """How soon a change of the best and of the worst place would be found."""
    usual, series = found.usual, found.readings.series
    k = int(np.argmax(usual))
    soon = [
        f"{in_digits(size * usual[k], 2)} {series[k].unit} within "
        f"{in_digits(found.detects_within(size * usual[k], k), 2)} checks"
        for size in _SIZES
    ]
    return f"Changed, the place that scatters most ({series[k].name}) is found on average: " + (
        ", ".join(reversed(soon)) + "."
    )


def _checks(count: int) -> str:
    return f"{count} checks" if count != 1 else "1 check"


def _signed(value: float) -> str:
    return in_digits(value, sign=True).replace("-", "−")
