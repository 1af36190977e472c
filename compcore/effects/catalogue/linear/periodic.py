"""Periodic effects: the lead of a screw, the period of a grating, the tooth of a worm wheel."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.campaign.sampling import alias
from abbe.compcore.effects.base import Effect, ErrorMotion, Motion, NonlinearParameter, Parameter
from abbe.compcore.effects.keys import Harmonics, PositiveUnlessFitted
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.targets import along, require_linear
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import WHOLE_TURN, Axis, Machine, own_component

LEADS_MM = (10.0, 5.0, 20.0, 6.0, 8.0, 4.0, 12.0, 16.0, 25.0, 40.0, 32.0, 30.0, 50.0, 2.5, 2.0)
"""Leads of ball screws, mm (ISO 3408-2 and the makers' series between), the commonest first."""

_LONGEST_LEAD = 60.0
"""Of screws, mm; a longer wave is that of a rack's pinion."""
_LONGEST_PINION = 500.0
"""Way in a pinion's turn, mm: 200 to 400 of racks, of large ones to here."""
_FEWEST_TURNS = 8.0
"""Waves in the travel from which on a long one is taken for a pinion's."""
_MOST_STARTS = 240
_GREATER = 2.0
"""Times the wave from which on a harmonic of it is the wave."""
_FEWEST_WAVES = 2.0
"""Of fewer waves than that a curve says the same."""
_RESOLVED = 1.02
_FEWEST_TEETH, _MOST_TEETH = 5, 360
"""Waves in a turn of a rotary axis that are looked for: teeth of a worm wheel, poles of a motor."""
_OF_A_TURN = tuple(WHOLE_TURN / n for n in range(_MOST_TEETH, _FEWEST_TEETH - 1, -1))


def _period(axis: Axis) -> NonlinearParameter:
    """The period to be fitted.

    Two periods can be told apart when they differ by one cycle over the travel; the starts stand
    half of that apart, so that one of them lies in the valley of the best. Below the shortest of
    them only the common leads are tried.
    """
    length = axis.travel[1] - axis.travel[0]
    if axis.rotary:
        return NonlinearParameter(
            "period",
            "rad",
            bounds=(0.9 * WHOLE_TURN / _MOST_TEETH, WHOLE_TURN / (_FEWEST_TEETH - 0.5)),
            starts=_OF_A_TURN,
            plausible=(0.5 * WHOLE_TURN / _MOST_TEETH, WHOLE_TURN / (_FEWEST_TEETH - 0.5)),
            description=f"angle after which {axis.name} errs alike",
            extent=True,
        )
    grid = 2.0 * length / np.arange(2, _MOST_STARTS + 2)
    grid = grid[grid >= min(LEADS_MM)]
    starts = {float(p) for p in grid} | {p for p in LEADS_MM if p < grid.min(initial=length)}
    return NonlinearParameter(
        "period",
        "mm",
        bounds=(0.9 * min(starts), length),
        starts=tuple(sorted(starts)),
        plausible=(1.0, max(_LONGEST_LEAD, min(_LONGEST_PINION, length / _FEWEST_TURNS))),
        description=f"period along {axis.name}",
        extent=True,
    )


def _told_apart(period: NonlinearParameter, step: float) -> list[float]:
    """Of the starts one each of those that readings every `step` (mm) show as the same wave."""
    apart = 1.0 / (2.0 * period.bounds[1])  # between two starts, cycles a mm
    longest = 1.0 / _LONGEST_LEAD - 0.1 * apart
    resolved = [p for p in period.starts if p > 2.0 * step]
    seen = [1.0 / p for p in LEADS_MM if p > 2.0 * step]
    leads: set[float] = set()
    for lead in LEADS_MM:
        looks = 1.0 / alias(step, lead)
        hidden = lead > 2.0 * step or lead < period.bounds[0] or looks < longest
        if hidden or any(abs(looks - other) < 0.5 * apart for other in seen):
            continue
        seen.append(looks)
        leads |= {1.0 / (1.0 / lead + by) for by in (-apart, 0.0, apart)}
        resolved = [p for p in resolved if abs(1.0 / p - looks) > apart]
    return sorted(leads.union(resolved))


@register
class Cyclic(Effect):
    """Cyclic error: a positioning error that repeats with the screw's turn or the grating's period.

    Formula
        ``E_aa = Σ A_h·cos(2π·h·q_a/P) + B_h·sin(2π·h·q_a/P)``, h = 1 … harmonics; the period P is
        fitted unless it is given (mm, of a rotary axis degrees: 360° through the number of teeth).
        `number` tells several waves of one axis apart, each of a period of its own: 2, 3, … up to
        9, in no order: a rack has its pinion's turn and its teeth, a screw its lead and its
        motor's poles.
    Parameters
    ----------
        A1, B1, A2, … in mm, within ±20 µm: a wobbling screw or an eccentric rotary encoder gives 1
        to 10 µm, the interpolation of a glass scale less than 0.5 µm. period in mm: the lead of a
        ball screw (5 to 40 mm), its divisions by the number of motor poles or gear teeth; the way
        in a turn of a rack's pinion (200 to 500 mm), and the pitch of its teeth (5 to 20 mm); a
        grating's period (4 to 40 µm) must be given, no ordinary campaign samples finely enough to
        find it. Of a rotary axis rad, within ±500 µrad: a worm that runs out gives 10 to 100 µrad
        at each tooth of its wheel; the wheel's own run-out, once in a turn, is
        `rotary_positioning`.
    Signals
        None beyond the axis's position. Steps along the axis must not be multiples of the period,
        or nothing is seen of it.
    Typical causes
        Eccentric coupling or rotary encoder, thrust bearing that runs out, bent screw, gear or rack
        pitch, unequal or phase-shifted signals of the scale's reader.
    Cure
        Alignment of encoder and bearing; adjustment of the reader's signals; a table with a step
        below a quarter of the period, where the controller has room for it.
    Source
        ISO 230-2 and ISO/TR 16907:2015, 9.2; Schwenke et al., CIRP Annals 57/2 (2008).
    """

    kind = "cyclic"
    axis: str
    period: PositiveUnlessFitted = None
    harmonics: Harmonics = 1
    number: Annotated[int, Field(ge=2, le=9)] | None = None

    def check(self, machine: Machine) -> None:
        """An axis that is positioned."""
        super().check(machine)
        if self.axis not in machine.axes or not machine.axis(self.axis).rotary:
            require_linear(machine, self.axis, self.kind)

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """Cosine and sine amplitude of each harmonic."""
        unit, most = ("rad", 5e-4) if machine.axis(self.axis).rotary else ("mm", 0.02)
        return tuple(
            Parameter(f"{letter}{h}", unit, (-most, most), f"{part} of harmonic {h}")
            for h in range(1, self.harmonics + 1)
            for letter, part in (("A", "cosine"), ("B", "sine"))
        )

    def nonlinear(self, machine: Machine) -> tuple[NonlinearParameter, ...]:
        """The period unless it is given."""
        return () if self.period is not None else (_period(machine.axis(self.axis)),)

    def search(self, machine: Machine, coverage: Coverage) -> tuple[NonlinearParameter, ...]:
        """The period: none that even steps show as one longer than any screw's or scale's.

        Of those that even steps do not resolve, and of the wave that all of them look like, only
        the commonest lead of a screw. Of a rotary axis those of which two waves were read at least;
        empty where there is none.
        """
        found = self.nonlinear(machine)
        step = coverage.steps.get(self.axis, 0.0)
        axis = machine.axis(self.axis)
        span = coverage.span(self.axis, 2.0 * axis.half_travel)
        if axis.rotary and not step and coverage.places:
            # uneven angles: no more waves than half of the places
            step = span / max(coverage.places.get(self.axis, 2) - 1, 1)
        if not found:
            return found
        (period,) = found
        if axis.rotary:
            told = [p for p in period.starts if 2.0 * step * _RESOLVED < p <= span / _FEWEST_WAVES]
            if not told:
                return ()
        elif not step or 2.0 * step >= period.bounds[1]:
            return found
        else:
            told = _told_apart(period, step)
        low = max(period.bounds[0], 0.9 * min(told, default=2.0 * step))
        high = min(period.bounds[1], 1.1 * max(told)) if axis.rotary else period.bounds[1]
        return (replace(period, bounds=(low, high), starts=tuple(told) or (high,)),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``cos`` and ``sin`` of each harmonic on E_aa; held at the ends of the travel."""
        axis, period = machine.axis(self.axis), self._period(machine, nonlinear)
        position = axis.clamp(conditions.position(self.axis))
        phase = np.outer(position, 2.0 * np.pi / period * np.arange(1, self.harmonics + 1))
        columns = np.stack([np.cos(phase), np.sin(phase)], axis=2)
        moved = (
            ErrorMotion(self.axis, own_component(self.axis))  # type: ignore[arg-type]
            if axis.rotary
            else along(self.axis)
        )
        return (Motion(moved, columns.reshape(len(position), -1)),)

    def _period(self, machine: Machine, nonlinear: Mapping[str, float]) -> float:
        """The period, mm or rad."""
        if self.period is None:
            return nonlinear["period"]
        return float(np.deg2rad(self.period)) if machine.axis(self.axis).rotary else self.period

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The ends of the travel."""
        return {self.axis: machine.axis(self.axis).travel}

    def repeats(self, machine: Machine, nonlinear: Mapping[str, float]) -> dict[str, float]:
        """The period."""
        return {self.axis: self._period(machine, nonlinear)}

    def misnamed(self, values: Mapping[str, float]) -> bool:
        """Whether a harmonic is much greater than the wave: then that is the wave, and shorter.

        Of a period that is known from the screw or the scale nothing follows: unequal signals of a
        reader give the second harmonic alone (Heydemann, Appl. Opt. 20, 1981, 3382).
        """
        if self.period is not None:
            return False
        first, *others = (
            float(np.hypot(values[f"A{h}"], values[f"B{h}"])) for h in range(1, self.harmonics + 1)
        )
        return any(other > _GREATER * first for other in others)

    def next_one(self) -> Cyclic | None:
        """Another wave of the same axis, of a period of its own."""
        following = (self.number or 1) + 1
        return self.model_copy(update={"number": following}) if following <= 9 else None

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Cyclic]:
        """Each axis that moved, its period to be found; a wave, and one that is no sine.

        Of rotary ones those that turn around: within part of a turn few waves are a curve.
        """
        for axis in (a for a in machine.structure.axes if a in coverage.moving):
            if machine.axis(axis).rotary and 2.0 * machine.axis(axis).half_travel < WHOLE_TURN:
                continue
            for harmonics in (1, 2):
                effect = cls(axis=axis, harmonics=harmonics)
                if coverage.shows(axis, 2 * harmonics + 1) and effect.search(machine, coverage):
                    yield effect
