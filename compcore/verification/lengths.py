"""Lengths out of lines and gauges, as ISO 10360-2 judges them.

A laser along a line measures lengths from the first target, both ends approached from the same
side; ISO 10360-2 takes lasers as calibrated lengths, beside a short one that is probed both ways.
Error of indication = measured − true: the opposite of a campaign's error.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_length import CalibratedLength
from abbe.compcore.artefacts.decision_rule import Conformity, DecisionRule
from abbe.compcore.artefacts.iso10360 import LengthEvaluation, Outcome, evaluate_lengths
from abbe.compcore.artefacts.measured_length import MeasuredLength
from abbe.compcore.artefacts.permissible import PermissibleError
from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.machine import Machine
from abbe.compcore.verification.budget import (
    INSTRUMENT,
    SETUP,
    MeasuringUncertainty,
    combined,
)
from abbe.compcore.verification.line_test import LineTest, temperature_of

F64 = NDArray[np.float64]

_LENGTHS = 5
_REPEATS = 3


@dataclass(frozen=True, eq=False)
class LengthsVerified:
    """Lengths against a stated maximum permissible error (ISO 10360-2, ISO 14253-1).

    Attributes
    ----------
    evaluation
        With the zone that is smaller by the uncertainty: what proves conformity.
    outcome
        Whether conformity, non-conformity or neither is proven.
    """

    evaluation: LengthEvaluation
    outcome: Conformity


def lengths_verified(
    lengths: Sequence[MeasuredLength], permissible: PermissibleError, coverage: float
) -> LengthsVerified:
    """Judge lengths as E0 by both rules of ISO 14253-1: is it proven, is the contrary proven?"""
    limits = {"E0": permissible}
    proof, contrary = (
        evaluate_lengths(lengths, limits, decision=rule, coverage=coverage)
        for rule in (DecisionRule.ACCEPTANCE, DecisionRule.REJECTION)
    )
    outcome = Conformity.NEITHER
    if all(t.outcome is Outcome.PASSES for t in proof.tests):
        outcome = Conformity.PASSES
    elif any(t.outcome is Outcome.FAILS for t in contrary.tests):
        outcome = Conformity.FAILS
    return LengthsVerified(proof, outcome)


def lengths_of_lines(
    tests: Sequence[LineTest], sure: MeasuringUncertainty
) -> Iterator[MeasuredLength]:
    """Five lengths of each line from its first target, each way, in sets of three runs.

    Where the runs are no multiple of three the last set is that of the last three: every run
    counts.
    """
    for test in tests:
        if test.rotary:
            continue
        runs = test.result.runs
        for way, table in (("↑", runs.up), ("↓", runs.down)):
            if table.shape[1]:
                for block in _blocks(table.shape[1]):
                    words = f"{test.name} {test.setup} {way}"
                    if table.shape[1] > _REPEATS:
                        words += f" runs {block[0] + 1}–{block[-1] + 1}"
                    yield from _of_table(test, table, block, words, sure)


def _blocks(runs: int) -> list[list[int]]:
    """Runs in threes, the last three overlapping where they must."""
    if runs <= _REPEATS:
        return [list(range(runs))]
    starts = [*range(0, runs - _REPEATS + 1, _REPEATS)]
    if starts[-1] != runs - _REPEATS:
        starts.append(runs - _REPEATS)
    return [list(range(at, at + _REPEATS)) for at in starts]


def _of_table(
    test: LineTest, table: F64, block: Sequence[int], words: str, sure: MeasuringUncertainty
) -> Iterator[MeasuredLength]:
    targets = test.result.runs.targets
    far = np.unique(np.round(np.linspace(0, len(targets) - 1, _LENGTHS + 1)).astype(int))[1:]
    for i in far.tolist():
        length = float(targets[i] - targets[0])
        for number, run in enumerate(block, start=1):
            error = float(table[i, run] - table[0, run])
            if np.isfinite(error):
                yield _measured(words, length, -error, number, test.temperature, sure, test.length)


def lengths_of_gauges(
    campaign: Campaign, machine: Machine, sure: MeasuringUncertainty
) -> Iterator[MeasuredLength]:
    """The calibrated lengths of a campaign's gauges: rows with a gauge, from their set-up's first.

    Their uncertainty is that of the calibration and of their expansion.
    """
    setup = campaign.conditions.setup
    if campaign.gauge is None or campaign.gauge_sd is None or setup is None:
        return
    at = campaign.functional_moves() + campaign.conditions.tool
    seen: dict[tuple[str, str], int] = {}
    for name in campaign.setups:
        rows = np.flatnonzero(setup == name)
        if campaign.setups[name].free != ("zero",) or campaign.gauge[rows[0]]:
            continue
        warmth = temperature_of(campaign, machine, name, "")
        for row in rows[1:].tolist():
            gauge = str(campaign.gauge[row])
            length = float(np.linalg.norm(at[row] - at[rows[0]]))
            # repeats of one length in one place are runs, whatever their set-ups are called
            words = f"{_direction(at[row] - at[rows[0]])} from {_place(at[rows[0]])}"
            run = seen[words, gauge] = seen.get((words, gauge), 0) + 1
            error = float(campaign.value[row] - campaign.value[rows[0]])
            known = float(campaign.gauge_sd[row])
            yield _measured(words, length, -error, run, warmth, sure, length, known)


def _direction(way: F64) -> str:
    """Which way a length lies: ``+X``, ``+X-Z``, with its direction cosines where oblique."""
    u = way / max(float(np.linalg.norm(way)), 1e-12)
    return "".join(f"{v:+.2f}{k}" for k, v in zip("XYZ", u.tolist(), strict=True) if abs(v) > 0.01)


def _place(at: F64) -> str:
    return ", ".join(f"{v:.0f}" for v in at.tolist())


def _measured(
    words: str,
    length: float,
    error: float,
    run: int,
    temperature: float | None,
    sure: MeasuringUncertainty,
    line: float,
    calibration: float | None = None,
) -> MeasuredLength:
    """A length with an error of indication (mm), and all that it is unsure by.

    `calibration` is a gauge's own; None: by the instrument along its line, two readings.
    """
    parts = sure.of_length(length, temperature, line)
    known = calibration
    if known is None:
        two = {"readings": 2.0**0.5 * sure.reading}
        known = combined({INSTRUMENT: parts[INSTRUMENT], SETUP: parts[SETUP], **two})
    standard = CalibratedLength(length, known, sure.expansion, sure.expansion_sd)
    indicated = standard.at(temperature) + error
    return MeasuredLength(words, standard, indicated, run, temperature, sure.temperature_sd)
