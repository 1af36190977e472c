"""Evaluation of a campaign by ISO 230: positioning, circles, diagonals (parts 2, 4, 6)."""

from __future__ import annotations

from dataclasses import dataclass

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import require_type
from abbe.compcore.iso230.circular import CircularResult, evaluate_circles
from abbe.compcore.iso230.diagonals import Diagonals, evaluate_diagonals
from abbe.compcore.iso230.positioning import (
    PositioningResult,
    evaluate_positioning,
    positioning_runs,
)
from abbe.compcore.machine.machine import Machine, OfMachine, machine_of


@dataclass(frozen=True)
class Iso230:
    """The results of a campaign by ISO 230-2, 230-4 and 230-6.

    Attributes
    ----------
    positioning
        One result for each set-up that measured the positioning of one axis; may be empty.
    diagonals
        The face and body diagonals, with the squareness that they hint at.
    circles
        One result for each set-up that went round a circle (ball bar, grid encoder).
    """

    positioning: tuple[PositioningResult, ...]
    diagonals: Diagonals
    circles: tuple[CircularResult, ...] = ()


def evaluate_iso230(campaign: Campaign, machine: Machine | OfMachine) -> Iso230:
    """Evaluate a campaign's positioning tests (ISO 230-2), circles (230-4), diagonals (230-6).

    Set-ups that are none of these count for nothing.
    """
    require_type(campaign, Campaign, "campaign")
    machine = machine_of(machine)
    runs = positioning_runs(campaign, machine)
    return Iso230(
        tuple(evaluate_positioning(r) for r in runs),
        evaluate_diagonals(campaign, machine),
        evaluate_circles(campaign),
    )
