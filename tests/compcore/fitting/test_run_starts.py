"""Bodies begin each run as warm as they are: fitted and compared run by run, never carried over.

The truth is a spindle's nose stepped through its heat balance (`tests.support.compcore.bodies`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.join import join_campaigns
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.judging.soundness import worth
from abbe.compcore.files.model_file import format_model, parse_model
from abbe.compcore.files.model_toml.packed_covariance import pack_symmetric
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.design.begun import begun
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.fitting.words import start_lines
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from abbe.daemon.answers.model.compare import as_json as compared
from abbe.daemon.answers.model.fit import as_json
from tests.support.compcore.bodies import growth

NOISE = 0.3e-3
"""mm."""

SLOW = (0.03, 2400.0)
"""Growth at full speed, mm, and time constant, s."""


def run(seed: int, *begins: float | None) -> tuple[Model, Campaign]:
    """A morning of the same spindle; its body began at this part of full speed's warmth."""
    bodies = (SLOW, (0.01, 300.0))
    return growth(seed, [(*body, at) for body, at in zip(bodies, begins, strict=False)])


def lagged(model: Model, **detail: str) -> Model:
    where = {"direction": "Z", "signal": "n", "tau": "fit", **detail}
    return with_effect(model, "thermal_offset", where)[0]


def left(model: Model, campaign: Campaign) -> float:
    return compare(model, campaign).lengths.rms


def starts(result: FitResult) -> list[float]:
    """What each run's bodies had more of at first than in equilibrium, mm."""
    layout = result.problem.layout
    return [float(v) for start in layout.starts for v in result.theta[start.where]]


def excess_at_first(campaign: Campaign, begins: float, size: float = SLOW[0]) -> float:
    """The same by the truth, mm."""
    return size * (begins - float(campaign.conditions.signal("n")[0]) / 1e4)


@pytest.mark.parametrize("warm", [0.0, 0.5])
def test_a_run_that_begins_warm_is_foretold_by_one_that_began_in_equilibrium(warm: float) -> None:
    model, first = run(21, None)
    fitted = fit(lagged(model), first).model
    _, second = run(22, warm)
    seen = compare(fitted, second)
    assert seen.lengths.rms == pytest.approx(NOISE, rel=0.15)
    (start,) = seen.problem.layout.starts
    assert seen.theta[start.where] == pytest.approx([excess_at_first(second, warm)], abs=0.7e-3)
    # what it would be with the bodies in equilibrium: the beginning is not free for nothing
    bound = Problem(fitted, second, bodies="none")
    apart = second.value - bound.predicted(bound.layout.of_model(fitted, second))
    assert np.std(apart) > 5 * NOISE


def test_where_a_run_began_does_not_travel_to_another() -> None:
    model, first = run(23, 0.9)
    result = fit(lagged(model, start="fit"), first)
    assert starts(result) == pytest.approx([excess_at_first(first, 0.9)], rel=0.05)
    for warm in (None, 0.0, 0.5):
        assert left(result.model, run(24, warm)[1]) == pytest.approx(NOISE, rel=0.15)


def test_runs_that_are_fitted_together_begin_each_for_itself() -> None:
    model, first = run(25, 0.9)
    _, second = run(26, 0.1)
    both = join_campaigns([first, second])
    result = fit(lagged(model, start="fit"), both)
    truth = [excess_at_first(first, 0.9), excess_at_first(second, 0.1)]
    assert starts(result) == pytest.approx(truth, abs=0.7e-3)
    (term,) = result.model.terms
    assert term.values["tau"].value == pytest.approx(SLOW[1], rel=0.03)
    assert term.values["k"].value * 1e4 == pytest.approx(SLOW[0], rel=0.03)
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.2)


def test_both_bodies_of_a_second_run_begin_where_they_are() -> None:
    model, first = run(27, None, None)
    fitted = fit(lagged(model, tau2="fit"), first).model
    assert left(fitted, run(28, 0.8, 0.2)[1]) == pytest.approx(NOISE, rel=0.2)


@pytest.mark.parametrize(("begins", "grown"), [(0.0, 1.0), (0.5, 1.0), (0.0, 1.3)])
def test_a_run_that_begins_warm_is_no_change_of_the_machine(begins: float, grown: float) -> None:
    """A body that grows by 30 % more is one, however warm it began."""
    model, first = run(21, None)
    fitted = fit(lagged(model), first).model
    _, second = growth(22, [(grown * SLOW[0], SLOW[1], begins)])
    found = diagnose(fitted, second)
    if grown == 1.0:
        assert found.verdict == "complete"
        return
    assert found.verdict == "changed"
    assert found.standing is not None
    (change,) = found.standing.changes
    k = next(p for p in change.parameters if p.name == "k")
    assert k.after * 1e4 == pytest.approx(grown * SLOW[0], rel=0.05)


def test_no_body_takes_up_what_its_warmth_cannot_move() -> None:
    """A drift of 30 µm beside a body that moves by 0.1 µm at full speed is no body's beginning."""
    model, first = run(29, None)
    fitted = fit(lagged(model), first).model
    weak = {
        name: replace(v, value=v.value / 300.0) if name == "k" else v
        for name, v in fitted.terms[0].values.items()
    }
    drift = np.linspace(0.0, 0.03, first.n)
    drift += np.random.default_rng(29).normal(0.0, NOISE, first.n)
    drifting = replace(first, value=drift, files={})
    slight = fitted.with_values([weak])
    assert left(slight, drifting) == pytest.approx(np.std(drift), rel=0.02)


def test_a_beginning_is_said_and_called_implausible_where_warmth_does_not_allow_it() -> None:
    model, first = run(23, 0.9)
    result = fit(lagged(model, start="fit"), first)
    (found,) = begun(result.problem, result.theta)
    (line,) = start_lines(result.problem, result.theta)
    assert found.plausible
    assert "IMPLAUSIBLE" not in line
    (stated,) = as_json(result, result.noise)["run_starts"]
    assert stated["off_equilibrium"] == list(found.off)
    assert stated["unit"] == "rpm"
    # half as far again as any body has been
    (start,) = result.problem.layout.starts
    theta = result.theta.copy()
    theta[start.where] *= 1.5 * found.furthest / abs(found.off[0])
    (absurd,) = begun(result.problem, theta)
    assert abs(absurd.off[0]) == pytest.approx(1.5 * found.furthest)
    assert not absurd.plausible
    assert "IMPLAUSIBLE" in next(iter(start_lines(result.problem, theta)))


def test_a_beginning_that_a_comparison_held_is_implausible() -> None:
    model, first = run(29, None)
    fitted = fit(lagged(model), first).model
    drift = np.linspace(0.0, 3.0, first.n)
    seen = compare(fitted, replace(first, value=first.value + drift, files={}))
    assert [start["plausible"] for start in compared(seen)["run_starts"]] == [False]
    assert any("IMPLAUSIBLE" in line for line in seen.words())


def test_detail_beside_a_model_that_leaves_nothing_is_worth_nothing() -> None:
    model, first = run(32, None)
    fuller = fit(lagged(model), first)
    exact = replace(fuller, residual=np.zeros_like(fuller.residual))
    assert not worth(exact, fuller)


def test_a_body_says_the_same_of_a_run_in_parts() -> None:
    """Rows of a run know when it began, wherever they were cut."""
    model, first = run(30, 0.9)
    result = fit(lagged(model, start="fit"), first)
    rows = np.arange(100, 160)
    part = result.problem.part(rows, result.theta)
    assert part.predicted(result.theta) == pytest.approx(
        result.problem.predicted(result.theta)[rows]
    )


def test_a_model_file_that_holds_a_beginning_is_read_without_it() -> None:
    model, first = run(31, 0.9)
    fitted = fit(lagged(model, start="fit"), first).model
    assert fitted.covariance is not None
    text = format_model(fitted)
    (k_sd, tau_sd) = np.sqrt(np.diag(fitted.covariance))
    older = np.diag([k_sd**2, 0.002**2, tau_sd**2])
    older[0, 2] = older[2, 0] = fitted.covariance[0, 1]
    packed = pack_symmetric(fitted.covariance)
    assert packed in text
    text = text.replace(packed, pack_symmetric(older))
    text = text.replace(
        "[effects.parameters.tau]",
        '[effects.parameters.start]\nvalue = 0.027\nsd = 0.002\nunit = "mm"\n\n'
        "[effects.parameters.tau]",
    )
    read = parse_model(TomlSource(text))
    assert read.terms[0].values == fitted.terms[0].values
    assert read.covariance == pytest.approx(fitted.covariance)
