"""Whether what is said of the volume foretells lines where no other set-up was."""

from __future__ import annotations

from collections.abc import Sequence

from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.screening.left_out.lines import same_lines
from abbe.compcore.diagnosis.uncatalogued.descriptions import LEAST
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult

_OVER_A_VOLUME = 2
"""Axes of whose positions a description is a function that is one of places in a volume."""

_LINES = 3
"""Fewer lines say nothing of another one."""


def foretells_other_lines(before: FitResult, result: FitResult, added: Sequence[Effect]) -> bool:
    """Whether what is said of the volume foretells lines where no other set-up was, by a tenth.

    A gauge that is corrected wrongly stands on the same lines on every day. What it shows against
    the laser on other lines a polynomial of places takes up, and foretells each day from the next.
    """
    machine = before.model.machine
    if all(len(e.positions_used(machine)) < _OVER_A_VOLUME for e in added):
        return True
    lines = same_lines(before.thin.problem.campaign.conditions)
    if len(lines) < _LINES:
        return True
    was, now = (LeftOutErrors.of(r, rows=lines) for r in (before, result))
    return was.falls_to(now, result, bound=False) <= 1.0 - LEAST
