"""From a bare machine and from its usual effects a short campaign ends alike, and no worse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.diagnosis.stepwise.best_on_the_way import best_on_the_way
from abbe.compcore.diagnosis.stepwise.held_near_zero import held_near_zero
from abbe.compcore.diagnosis.stepwise.step import Step
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.model.model import Model
from abbe.drivers.simulated.bridge.machine import make_bridge
from tests.support.drivers.measured_bridge import bridge, measured_by, on_unseen_lines

MACHINE = make_bridge(1)
"""The exact bridge; no model of Abbe's."""


def step(action: str, result: FitResult) -> Step:
    return Step(action, None, result, LeftOutErrors.of(result))


def fitted(*specs: tuple[str, dict[str, object]], hours: float = 2.0) -> FitResult:
    """Effects fitted to what a laser shows."""
    machine = replace(bridge(), signals={})
    model = Model(machine).with_effects(*(make_effect(kind, where) for kind, where in specs))
    planned = Model(machine).with_effects(make_effect("positioning", {"axis": "X"}))
    return fit(model, measured_by("laser", hours, planned).campaign(MACHINE, 1))


def test_a_short_campaign_ends_alike_from_nothing_and_from_the_usual_effects() -> None:
    """A step gauge for an hour, then lines where nobody was: least squares left 39 µm of 5.3."""
    usual = measured_by("step-gauge", 1.0)
    campaign = usual.campaign(MACHINE, 1)
    ends = [to_the_verdict(m, campaign) for m in (Model(usual.model.machine), usual.model)]
    bare, from_usual = (on_unseen_lines(MACHINE, c.last.result.model) for c in ends)
    assert bare < 0.6 * on_unseen_lines(MACHINE, None)
    assert bare == pytest.approx(from_usual, rel=0.15)
    assert [c.last.action for c in ends] == ["held near 0"] * 2
    for course in ends:
        assert course.last.held_out.lengths <= min(s.held_out.lengths for s in course.steps)


def test_what_was_measured_is_not_held() -> None:
    """Nothing changes where every combination is shown well."""
    result = fitted(("positioning", {"axis": "X", "shape": "spline:5"}))
    assert cautiously(result).caution is not None
    assert held_near_zero(step("began", result), None) is None


def test_back_to_the_step_that_foretells_best() -> None:
    """A curve of 60 coefficients follows the noise, and left-out blocks are foretold worse."""
    plain = step("began", fitted(("positioning", {"axis": "X", "shape": "spline:5"})))
    wild = step("added", fitted(("positioning", {"axis": "X", "shape": "polynomial:1"})))
    assert wild.held_out.lengths > 1.1 * plain.held_out.lengths
    assert best_on_the_way((plain, wild)) is plain
    assert best_on_the_way((wild, plain)) is None
    assert best_on_the_way((plain,)) is None


def test_left_out_blocks_of_values_that_are_held_are_those_of_a_fit_without_them() -> None:
    """Against normal equations written here, with what is expected of each coefficient."""
    result = fitted(
        ("positioning", {"axis": "X", "shape": "spline:8"}), ("scale", {"axis": "X"}), hours=1.0
    )
    held = cautiously(result)
    assert held.caution is not None
    problem = held.as_weighed.problem
    assert problem.expected is not None
    names = problem.campaign.conditions.setup
    assert names is not None
    own_zero = (names[:, None] == np.unique(names)) * problem.weight[:, None]
    a = np.hstack([problem.columns(np.zeros(problem.layout.size)), own_zero])
    y = problem.campaign.value * problem.weight
    expected = np.pad(problem.expected, ((0, 0), (0, own_zero.shape[1])))
    found = LeftOutErrors.of(held).left
    for rows in found.folds:
        others = np.delete(np.arange(problem.n), rows)
        normal = a[others].T @ a[others] + expected.T @ expected
        theta = np.linalg.solve(normal, a[others].T @ y[others])
        left = (y[rows] - a[rows] @ theta) * problem.sd[rows]
        assert found.residual[rows] == pytest.approx(left, abs=1e-7)
