"""Pictures of a fit: error motions, error map, residuals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from abbe.compcore.campaign.campaign import LENGTHS, Kind
from abbe.compcore.figures.figure import Figure
from abbe.compcore.figures.motions import map_figure, motion_figures
from abbe.compcore.figures.residuals import Residuals, residual_figures
from abbe.compcore.fitting.solution import Solution


def fit_figures(result: Solution) -> dict[str, Callable[[], Figure]]:
    """The pictures of a fit by name, each made when called."""
    campaign = result.problem.campaign
    made = {**motion_figures(result.model), **map_figure(result.model)}
    for kinds, what, unit in (
        (LENGTHS, "residuals", "µm"),
        ((Kind.ROTATION,), "rotations", "µrad"),
    ):
        rows = np.isin(campaign.kind, kinds)
        if rows.any():
            machine = result.model.machine
            drawn = Residuals.of(campaign, rows, result.residual, result.weighted, unit, machine)
            made |= residual_figures(drawn, what, machine.signals)
    return made
