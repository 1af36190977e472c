"""The exact test of a candidate against a plain refit with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.screening.candidates import Candidate, candidates
from abbe.compcore.diagnosis.screening.frames import Frames
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import LeftOut, folds
from abbe.compcore.diagnosis.screening.pool import Pool
from abbe.compcore.diagnosis.screening.projection.bank import Bank, screen
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.screening.projection.frame import Frame, Placed
from abbe.compcore.effects import make_effect
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]

DATA = Path(__file__).parents[3] / "data"
SPECS = (
    ("backlash", {"axis": "Z"}),
    ("thermal_offset", {"direction": "X", "signal": "T_spindle"}),
    ("thermal_tilt", {"axis": "Y", "about": "X", "signals": ["T_col_front", "T_col_rear"]}),
    ("positioning", {"axis": "X", "shape": "spline:12"}),
)


@pytest.fixture(scope="module")
def case() -> tuple[Model, Campaign, FitResult]:
    """A bridge with a smaller model than it deserves, so that refits are quick."""
    model = load_model(DATA / "p03-bridge" / "model.toml")
    model = replace(model, terms=model.terms[:7])
    campaign = read_campaign(DATA / "p03-bridge" / "fit.csv", model.machine)
    return model, campaign, fit(model, campaign)


@pytest.mark.parametrize(("kind", "keys"), SPECS)
def test_fall_of_chi2_is_that_of_a_refit(
    case: tuple[Model, Campaign, FitResult], kind: str, keys: dict[str, object]
) -> None:
    model, campaign, result = case
    effect = make_effect(kind, keys)
    columns = result.effect_columns(effect, {})
    (found,) = screen(Basis.of(result), [(0, {}, lambda: columns)])
    refitted = fit(model.with_effects(effect), campaign)
    assert found.drop > 1.0
    assert found.drop == pytest.approx(result.chi2 - refitted.chi2, rel=1e-6)
    assert found.rank == result.dof - refitted.dof


def test_bank_answers_for_an_extended_model_as_if_made_for_it(
    case: tuple[Model, Campaign, FitResult],
) -> None:
    _, _, result = case
    columns = [result.effect_columns(make_effect(kind, keys), {}) for kind, keys in SPECS]
    trials = [(i, {}, lambda c=c: c) for i, c in enumerate(columns)]
    base = Basis.of(result)
    for hold in (10**9, 0):  # held in memory, and made again for every test
        bank = Bank(base, lambda: trials, hold=hold)
        extended = base.extended(columns[0])
        for one, two in zip(bank.screen(extended), screen(extended, trials), strict=True):
            assert one.key == two.key
            assert one.rank == two.rank
            assert one.drop == pytest.approx(two.drop, rel=1e-6, abs=1e-6)
        assert bank.screen(extended)[0].rank == 0, "what has joined the model is no candidate"


def test_columns_in_frames_weigh_like_whole_columns(
    case: tuple[Model, Campaign, FitResult],
) -> None:
    """Rows that see nothing, and rows at one position, make no difference to any fall of χ²."""
    model, campaign, result = case
    first: dict[str, Candidate] = {}
    for candidate in candidates(model, campaign):
        first.setdefault(candidate.effect.kind, candidate)
    tried = list(first.values())
    base = Basis.of(result)
    frames = Frames(result.problem, result.theta, base)

    def whole(candidate: Candidate, nonlinear: Mapping[str, float]) -> F64:
        return result.effect_columns(candidate.effect, nonlinear)

    extended = base.extended(whole(first["backlash"], {}))
    ranked = [
        {
            f.candidate.effect.spec: f
            for f in Pool(tried, whole, base, model.machine, **keys).ranked(b)
        }
        for b in (base, extended)
        for keys in ({}, {"placed": frames.columns})
    ]
    assert len(ranked[0]) > 15
    for one, two in (ranked[:2], ranked[2:]):
        assert one.keys() == two.keys()
        for spec, found in one.items():
            assert found.screened.rank == two[spec].screened.rank
            assert found.screened.nonlinear == two[spec].screened.nonlinear
            assert found.screened.drop == pytest.approx(two[spec].screened.drop, rel=1e-8, abs=1e-8)


def test_a_candidate_of_positions_alone_is_made_on_few_rows(
    case: tuple[Model, Campaign, FitResult],
) -> None:
    model, campaign, result = case
    frames = Frames(result.problem, result.theta, Basis.of(result))
    cyclic = next(c for c in candidates(model, campaign) if c.effect.kind == "cyclic")
    placed = frames.columns(cyclic, cyclic.choices[0])
    assert isinstance(placed, Placed)
    assert placed.frame.count == len(
        np.unique(campaign.conditions.position(cyclic.effect.where()["axis"]))
    )
    assert 5 * placed.frame.count < campaign.n


def test_extended_basis_is_that_of_the_larger_model(
    case: tuple[Model, Campaign, FitResult],
) -> None:
    model, campaign, result = case
    effect = make_effect("backlash", {"axis": "Z"})
    extended = Basis.of(result).extended(result.effect_columns(effect, {}))
    refitted = Basis.of(fit(model.with_effects(effect), campaign))
    assert extended.dof == refitted.dof
    np.testing.assert_allclose(extended.residual, refitted.residual, atol=1e-7)


def test_leaving_out_without_refit_is_leaving_out_with_one(
    case: tuple[Model, Campaign, FitResult],
) -> None:
    """Rows whose set-up stays: the short formula against an explicit fit of the others."""
    _, campaign, result = case
    rng = np.random.default_rng(3)
    out = np.sort(rng.choice(campaign.n, 15, replace=False))
    basis = Basis.of(result)
    kept = np.setdiff1d(np.arange(campaign.n), out)
    jacobian = result.problem.jacobian(result.theta)
    scale = np.linalg.norm(jacobian, axis=0)
    jacobian = jacobian / np.where(scale > 0, scale, 1.0)
    value = result.problem.residual(np.zeros(result.problem.layout.size))
    solution = np.linalg.lstsq(jacobian[kept], value[kept], rcond=1e-11)[0]
    predicted_residual = value[out] - jacobian[out] @ solution
    # the explicit fit also follows directions that Abbe's calls undetermined: 0.05 % here
    left = LeftOut.of(basis, [out]).residual[out]
    assert float(left @ left) == pytest.approx(
        float(predicted_residual @ predicted_residual), rel=2e-3
    )


def test_folds_keep_setups_whole_and_cut_the_master_point_by_time(
    case: tuple[Model, Campaign, FitResult],
) -> None:
    _, campaign, _ = case
    conditions = campaign.conditions
    assert conditions.setup is not None
    parts = folds(conditions, 8)
    assert sorted(np.concatenate(parts)) == list(range(campaign.n))
    where = {
        name: [i for i, p in enumerate(parts) if (conditions.setup[p] == name).any()]
        for name in np.unique(conditions.setup)
    }
    assert all(len(v) == 1 for name, v in where.items() if not name.startswith("master"))
    assert len(where["master_x"]) > 1


def test_details_of_one_cause_are_choices_of_it_and_no_further_causes(
    case: tuple[Model, Campaign, FitResult],
) -> None:
    model, campaign, result = case
    tried = candidates(model, campaign)

    def columns(candidate: Candidate, nonlinear: Mapping[str, float]) -> F64:
        return result.effect_columns(candidate.effect, nonlinear)

    def chances(chosen: list[Candidate]) -> dict[str, float]:
        pool = Pool(chosen, columns, Basis.of(result), model.machine)
        ranked = pool.ranked(Basis.of(result))
        return {f.candidate.effect.spec: f.evidence.log_tests for f in ranked}

    harmonics = [c for c in tried if c.effect.kind == "cyclic"]
    plain = [c for c in harmonics if "harmonics" not in c.effect.where()]
    others = [c for c in tried if c.effect.kind == "backlash"]
    assert len(harmonics) == 2 * len(plain) > 0
    few, many = chances([*plain, *others]), chances([*harmonics, *others])
    for spec in few:
        # a second detail of a cause costs as twice the choices do, and other causes nothing
        more = 0.5 * np.log(2.0) if spec.startswith("cyclic") else 0.0
        assert many[spec] == pytest.approx(few[spec] + more, abs=1e-12)


def test_rare_causes_do_not_make_an_expected_one_less_likely_to_be_meant(
    case: tuple[Model, Campaign, FitResult],
) -> None:
    model, campaign, result = case
    tried = candidates(model, campaign)

    def columns(candidate: Candidate, nonlinear: Mapping[str, float]) -> F64:
        return result.effect_columns(candidate.effect, nonlinear)

    def chances(chosen: list[Candidate]) -> dict[str, float]:
        pool = Pool(chosen, columns, Basis.of(result), model.machine)
        ranked = pool.ranked(Basis.of(result))
        return {f.candidate.effect.spec: f.evidence.log_tests for f in ranked}

    expected = [c for c in tried if c.expected]
    rare = [c for c in tried if not c.expected]
    assert {c.effect.kind for c in expected} >= {"straightness", "angular"}
    assert "backlash" in {c.effect.kind for c in rare}
    together, alone, others = chances(tried), chances(expected), chances(rare)
    assert together == pytest.approx({**alone, **others}, abs=1e-12)


def test_a_frame_of_all_rows_takes_setups_one_by_one_as_all_of_them_together(
    case: tuple[Model, Campaign, FitResult],
) -> None:
    fitted = Basis.of(case[2])
    rows = np.random.default_rng(3).standard_normal((5, fitted.n))
    frame = Frame.whole(fitted)
    assert frame.setups
    whole = rows @ fitted.imitable
    one_by_one = frame.imitated(rows)
    assert one_by_one @ one_by_one.T == pytest.approx(whole @ whole.T, rel=1e-10)
