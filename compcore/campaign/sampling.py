"""The rule of steps: which sampling step resolves which wave of an error.

An error that repeats along an axis, a screw's turn or the period of a rack, is a wave. Read every
step h, a wave of length λ is seen as what it is only where λ > 2h; a shorter one looks like a
longer (its alias), or like nothing. And a table with straight lines between points h apart holds
only a part of a wave's amplitude, also of one that is resolved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

HELD = 0.8
"""Part of a wave's amplitude that a step is asked to hold, where nobody says otherwise."""
_SAME = 1e-3
"""Positions within this are one, mm; rotary 1e-5 rad."""
_SAME_ANGLE = 1e-5
_STILL = 0.01
"""Part of its travel by which another axis may move on a line along one axis."""
_EVEN = 0.02
"""Part of the step by which even steps may differ."""
_FEWEST = 3
_NEAR = 1e-9


def alias(step: float, wave: float) -> float:
    """The wave as which a wave appears that is read every step, same unit; infinite: a constant.

    >>> round(alias(9.0, 10.0), 6), alias(10.0, 10.0), round(alias(2.0, 10.0), 6)
    (90.0, inf, 10.0)
    """
    turns = step / wave
    apparent = abs(turns - round(turns))
    return math.inf if apparent < _NEAR else step / apparent


def looks_alike(step: float, wave: float, least: float) -> tuple[float, ...]:
    """Waves from `least` on, longest first, that readings every step show as one and the same.

    >>> [round(w, 2) for w in looks_alike(25.0, 10.0, 5.0)]
    [50.0, 16.67, 10.0, 7.14, 5.56]
    """
    part = step / alias(step, wave)
    turns = [n + sign * part for n in range(int(step / least) + 2) for sign in (-1.0, 1.0)]
    waves = {round(step / t, 9) for t in turns if t > _NEAR}
    return tuple(sorted((w for w in waves if w >= least), reverse=True))


def resolves(step: float, wave: float) -> bool:
    """Whether readings every step tell a wave from every longer one: λ > 2h (Nyquist)."""
    return wave > 2.0 * step * (1.0 + _NEAR)


def amplitude_held(step: float, wave: float) -> float:
    """Part of a wave's amplitude that straight lines between points a step apart hold, 0 … 1.

    ``(sin(πh/λ)/(πh/λ))²``: the wave's share of the line through its points, whatever the phase.
    Where the step does not resolve the wave, nothing of it is held as that wave: 0.
    """
    if not resolves(step, wave):
        return 0.0
    return float(np.sinc(step / wave)) ** 2


def step_for(wave: float, held: float = HELD) -> float:
    """The longest step that resolves a wave and holds a part of its amplitude, same unit.

    >>> round(step_for(10.0, 0.81), 1)
    2.5
    """
    low, high = 0.0, 0.5
    for _ in range(60):
        middle = 0.5 * (low + high)
        if float(np.sinc(middle)) ** 2 >= held:
            low = middle
        else:
            high = middle
    return low * wave


@dataclass(frozen=True, slots=True)
class AxisSampling:
    """How finely a campaign reads along an axis at best.

    Attributes
    ----------
    axis
        The axis.
    step
        Of its finest line, mm or rad; of uneven steps the mean.
    even
        Whether its steps are even: then a shorter wave looks like a longer one; uneven, like noise.
    setup
        The set-up that has that line.
    """

    axis: str
    step: float
    even: bool
    setup: str

    @property
    def shortest(self) -> float:
        """The wave from which on a wave is seen as what it is, mm or rad."""
        return 2.0 * self.step

    def hidden(self, wave: float) -> str | None:
        """What a wave (mm or rad) looks like that these steps do not resolve; None: it is seen.

        Of uneven steps nothing is said: they may still tell it.
        """
        if not self.even or resolves(self.step, wave):
            return None
        rotary = is_rotary(self.axis)
        unit, factor = ("°", math.degrees(1.0)) if rotary else (" mm", 1.0)
        seen = alias(self.step, wave)
        like = "a constant" if math.isinf(seen) else f"one of {in_digits(seen * factor, 4)}{unit}"
        length = f"{in_digits(wave * factor, 4)}{unit}"
        return f"a wave of {length} along {self.axis} looks like {like} in them"

    def __str__(self) -> str:
        rotary = is_rotary(self.axis)
        unit, factor = ("°", math.degrees(1.0)) if rotary else (" mm", 1.0)
        how = "every" if self.even else "on average every"
        shorter = "looks like a longer one" if self.even else "looks like noise"
        return (
            f"{self.axis} is read {how} {in_digits(self.step * factor, 4)}{unit} at best: "
            "this campaign "
            f"cannot see a wave shorter than {in_digits(self.shortest * factor, 4)}{unit} "
            f"along it; one {shorter}"
        )


def samplings(campaign: Campaign) -> tuple[AxisSampling, ...]:
    """The finest line along each axis, in the order of the campaign's axes.

    A line is a set-up in which one axis moves and the others stand; axes that only move together
    with others are left out: scattered places have no step.
    """
    conditions = campaign.conditions
    if conditions.setup is None:
        return ()
    positions = conditions.positions
    whole = {a: float(np.ptp(q)) if len(q) else 0.0 for a, q in positions.items()}
    best: dict[str, AxisSampling] = {}
    setups = conditions.setup_rows()
    order = np.argsort(setups.number, kind="stable")
    ends = np.cumsum(np.bincount(setups.number, minlength=len(setups.index)))
    for name, i in setups.index.items():
        rows = order[(ends[i - 1] if i else 0) : ends[i]]
        if len(rows) < _FEWEST:
            continue
        moving = [
            a
            for a, q in positions.items()
            if np.ptp(q[rows]) > max(_STILL * whole[a], _SAME_ANGLE if is_rotary(a) else _SAME)
        ]
        if len(moving) != 1:
            continue
        found = _line(moving[0], positions[moving[0]][rows], name)
        if found is not None and (
            moving[0] not in best or found.step < best[moving[0]].step * (1.0 - _EVEN)
        ):
            best[moving[0]] = found
    return tuple(best[a] for a in positions if a in best)


def _line(axis: str, at: F64, setup: str) -> AxisSampling | None:
    same = _SAME_ANGLE if is_rotary(axis) else _SAME
    places = np.sort(at)
    places = places[np.r_[True, np.diff(places) > same]]
    if len(places) < _FEWEST:
        return None
    steps = np.diff(places)
    step = float(steps.mean())
    even = bool(np.ptp(steps) <= 2.0 * _EVEN * step)
    return AxisSampling(axis, float(np.median(steps)) if even else step, even, setup)


def sampling_words(campaign: Campaign, waves: Sequence[tuple[str, float]] = ()) -> Iterator[str]:
    """One sentence an axis: which waves the campaign cannot see.

    Parameters
    ----------
    waves
        Axis and length, mm or rad, of waves that the machine is known to have.
    """
    for found in samplings(campaign):
        hidden = [found.hidden(wave) for axis, wave in waves if axis == found.axis]
        yield "; ".join([str(found), *(words for words in hidden if words)])
