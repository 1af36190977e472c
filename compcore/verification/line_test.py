"""Lines of a campaign as ISO 230-2 and 230-6 evaluate them, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.iso230.evaluate import evaluate_iso230
from abbe.compcore.iso230.positioning import PositioningResult
from abbe.compcore.machine.machine import Machine
from abbe.compcore.verification.budget import (
    FIGURES,
    Budget,
    MeasuringUncertainty,
    budgets_of,
    combined,
)

AXIS, BODY, FACE = "axis", "body", "face"
_NEAREST = ("workpiece", "scale", "screw", "structure", "ambient", "air")
"""Roles of the thermometers that tell how warm a line is, the best first."""


@dataclass(frozen=True, eq=False)
class LineTest:
    """One line: an axis by ISO 230-2, a diagonal by ISO 230-6.

    Attributes
    ----------
    setup
        The set-up.
    name
        ``X``, ``C``, ``+X+Y+Z``.
    kind
        ``axis``, ``body`` or ``face``.
    result
        The standard's evaluation.
    temperature
        How warm it was, °C; None where no thermometer tells.
    causes
        What is common to all readings, cause → standard uncertainty at the far end, mm or rad.
    budgets
        Figure → cause → standard uncertainty, mm or rad.
    """

    setup: str
    name: str
    kind: str
    result: PositioningResult
    temperature: float | None
    causes: Mapping[str, float]
    budgets: Mapping[str, Budget]

    @property
    def rotary(self) -> bool:
        """Whether errors are angles."""
        return self.result.runs.unit == "rad"

    @property
    def length(self) -> float:
        """From the first to the last target, mm or rad."""
        return float(np.ptp(self.result.runs.targets))

    def value(self, figure: str) -> float | None:
        """A figure, mm or rad; None where the runs do not give it."""
        found = getattr(self.result, figure)
        return None if found is None else float(found)

    def sd(self, figure: str) -> float | None:
        """Standard uncertainty of a figure, mm or rad; None where there is no figure."""
        budget = self.budgets.get(figure)
        return None if budget is None else combined(budget)

    @property
    def figures(self) -> dict[str, float]:
        """The figures that the runs give, mm or rad."""
        found = {name: self.value(name) for name in FIGURES}
        return {name: value for name, value in found.items() if value is not None}


def line_tests(
    campaign: Campaign, machine: Machine, sure: MeasuringUncertainty
) -> tuple[LineTest, ...]:
    """The lines along axes and diagonals of a campaign, in its order."""
    found = evaluate_iso230(campaign, machine)
    lines = [(p.runs.setup, p.runs.axis, AXIS, p) for p in found.positioning]
    lines += [
        (d.setup, d.name, BODY if d.body else FACE, d.result) for d in found.diagonals.diagonals
    ]
    order = {name: i for i, name in enumerate(campaign.setups)}
    made = []
    for setup, name, kind, result in sorted(lines, key=lambda one: order[one[0]]):
        runs = result.runs
        warmth = temperature_of(campaign, machine, setup, name)
        if runs.unit == "rad":
            causes, reading = sure.of_turn(), sure.angle
        else:
            causes = sure.of_length(float(np.ptp(runs.targets)), warmth)
            reading = sure.reading
        budgets = budgets_of(runs, causes, reading)
        made.append(LineTest(setup, name, kind, result, warmth, causes, budgets))
    return tuple(made)


def temperature_of(campaign: Campaign, machine: Machine, setup: str, axis: str) -> float | None:
    """How warm a set-up's line was, °C: the mean of the thermometers that are nearest to it.

    Those of the workpiece before those of the scale, the structure and the air; of an axis its own
    before those of others. None where none was recorded.
    """
    rows = campaign.conditions.setup == setup
    known = {
        name: signal
        for name, signal in machine.signals.items()
        if signal.temperature and name in campaign.conditions.signals
    }
    for role in _NEAREST:
        alike = [name for name, signal in known.items() if signal.role == role]
        own = [name for name in alike if known[name].axis == axis]
        if used := own or alike:
            values = [float(np.mean(campaign.conditions.signals[name][rows])) for name in used]
            return float(np.mean(values))
    return None
