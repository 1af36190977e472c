"""Targets approached again and again, as by ISO 230-2; rotary axes that do not turn around."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import folds
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.diagnosis.verdict import diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from benchmarks.hidden.judging.trial import as_campaign

TARGETS = np.arange(-20.0, 21.0, 5.0)
NOISE = 1.0
HEAD = '# format = "abbe-campaign/1"\n# [setups.line]\n# free = ["zero"]\n'
COLUMNS = "setup,kind,X,X_dir,ux,uy,uz,value\n"


def machine(structure: str, **travels: tuple[float, float]) -> Model:
    text = ['format = "abbe-model/1"', "[machine]", 'name = "m"', f'structure = "{structure}"']
    text += [f"[machine.axes.{a}]\ntravel = [{lo}, {hi}]" for a, (lo, hi) in travels.items()]
    return parse_model(TomlSource("\n".join(text)))


def runs(seed: int, model: Model, which: range) -> Campaign:
    """A screw whose error has nothing in common from target to target, and 20 µm of play."""
    error = np.random.default_rng(seed).normal(0.0, 30.0, len(TARGETS))
    rng = np.random.default_rng([seed, which.start])
    lines = [
        f"line,displacement,{x},{s},1,0,0,{e - 10.0 * s + rng.normal(0.0, NOISE):.3f}\n"
        for _ in which
        for s in (1, -1)
        for x, e in list(zip(TARGETS, error, strict=True))[::s]
    ]
    return as_campaign(HEAD + COLUMNS + "".join(lines), model)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_table_of_targets_is_found_and_holds_in_further_runs(seed: int) -> None:
    model = machine("w b X t", X=(-21.0, 21.0))
    course = to_the_verdict(model, runs(seed, model, range(3)))
    kinds = {e.kind for e in course.last.result.model.effects}
    assert kinds == {"positioning", "backlash"}
    reached = course.last.result.model
    check = runs(seed, model, range(3, 5))
    left = 1e3 * compare(reached, check).residual
    assert np.std(left) < 1.3 * NOISE


def test_repeated_targets_are_left_out_run_by_run() -> None:
    model = machine("w b X t", X=(-21.0, 21.0))
    for rows in folds(runs(1, model, range(3)).conditions):
        assert len(rows) == 2 * len(TARGETS)


def test_places_that_were_measured_twice_are_left_out_as_places() -> None:
    """A hole that is measured twice was drilled once."""
    x = np.repeat(np.arange(40.0), 2)
    c = Conditions({"X": x}, time=np.zeros(80), setup=np.full(80, "a"))
    for rows in folds(c):
        assert not np.isin(np.delete(x, rows), x[rows]).any()


def test_what_was_fitted_against_all_belief_is_a_degree_of_freedom() -> None:
    """An encoder that is off by 0.1 rad: no sound one is; what was fitted is not fitted twice."""
    model, _ = with_effect(machine("w b C t", C=(-95.0, 95.0)), "rotary_positioning", {"axis": "C"})
    campaign = encoder(model)
    result = fit(model, campaign)
    assert campaign.kind[0] == Kind.ROTATION
    assert result.decomposition.rank == result.thin.basis.shape[1] > 0
    assert [abs(t.values["A1"].value) > 0.01 for t in result.model.terms] == [True]


def encoder(model: Model, waves: tuple[int, ...] = (4,), day: int = 5) -> Campaign:
    """A worn encoder on half a turn, 0.02 rad of each of some waves in it, 1 mrad of noise."""
    rng = np.random.default_rng(day)
    angle = np.linspace(-90.0, 90.0, 181)
    error = 1e5 * np.cos(np.deg2rad(angle))
    for number in waves:
        error = error + 2e4 * np.sin(np.deg2rad(number * angle))
    values = error - error.mean() + rng.normal(0.0, 1e3, len(angle))
    rows = [f"line,rotation,{c:.3f},0,0,1,{v:.1f}\n" for c, v in zip(angle, values, strict=True)]
    return as_campaign(HEAD + "setup,kind,C,ux,uy,uz,value\n" + "".join(rows), model)


def test_half_a_turn_is_given_a_spline_and_no_waves_that_cancel() -> None:
    model = machine("w b C t", C=(-95.0, 95.0))
    last = to_the_verdict(model, encoder(model)).last
    (term,) = last.result.model.terms
    assert getattr(term.effect, "shape", "").startswith("spline:")
    assert all(abs(value.value) < 0.5 for value in term.values.values())
    assert last.held_out.rotations < 2e-3


def test_a_shape_is_made_finer_as_long_as_it_foretells_more() -> None:
    """Sixteen coefficients do not follow twelve waves a turn; what is left is no noise."""
    model = machine("w b C t", C=(-95.0, 95.0))
    course = to_the_verdict(model, encoder(model, (4, 8, 12)))
    (term,) = course.last.result.model.terms
    assert int(getattr(term.effect, "shape", "").removeprefix("spline:")) >= 32
    assert course.last.held_out.rotations < 1.5e-3
    another = compare(course.last.result.model, encoder(model, (4, 8, 12), day=6)).residual
    assert np.std(another) < 1.5e-3


def test_a_shape_is_judged_by_blocks_no_wider_than_its_knots_are_apart() -> None:
    x = np.linspace(0.0, 160.0, 641)
    line = Conditions({"X": x}, time=np.zeros(641), setup=np.full(641, "a"))
    usual = 10.0
    for distance in (40.0, 20.0, 10.0, 5.0, 3.0):
        parts = folds(line, detail={"X": distance})
        assert np.array_equal(np.sort(np.concatenate(parts)), np.arange(641))
        fold = np.empty(641, dtype=int)
        for i, rows in enumerate(parts):
            fold[rows] = i
        edges = np.flatnonzero(np.diff(fold)) + 1
        widths = np.diff(x[np.concatenate([[0], edges, [640]])])
        assert min(usual, 0.3 * distance) <= widths.max() <= 1.05 * min(usual, distance)


def test_where_a_campaign_is_too_coarse_for_a_shape_blocks_are_as_for_any_cause() -> None:
    x = np.linspace(0.0, 160.0, 33)
    line = Conditions({"X": x}, time=np.zeros(33), setup=np.full(33, "a"))
    for usual, fine in zip(folds(line), folds(line, detail={"X": 5.0}), strict=True):
        assert np.array_equal(usual, fine)


ANGLES = np.array([-5.0, 0.0, 10.0, 20.0, 30.0, 40.0])


def read_back(model: Model, errors: np.ndarray, runs: int) -> Campaign:
    """A rotary axis approached from both sides; its scale is read back where it stands, µrad."""
    rng = np.random.default_rng(7)
    lines = []
    for _ in range(runs):
        for side in (1, -1):
            for angle, error in list(zip(ANGLES, errors, strict=True))[::side]:
                # it comes to rest elsewhere from the other side, and the scale sees most of that
                shown = angle - side * 0.008 + rng.normal(0.0, 5e-4)
                value = error + side * 60.0 + rng.normal(0.0, 15.0)
                lines.append(f"line,rotation,{shown:.5f},{side},0,0,1,{value:.1f}\n")
    return as_campaign(HEAD + "setup,kind,C,C_dir,ux,uy,uz,value\n" + "".join(lines), model)


def test_between_targets_nothing_goes_beyond_them() -> None:
    """What lies 0.016° apart is no slope of a curve: between, 10 mrad were foretold of it once."""
    model = machine("w b C t", C=(-10.0, 50.0))
    errors = np.array([-160.0, 190.0, -70.0, -5.0, -15.0, 60.0])
    found = to_the_verdict(model, read_back(model, errors, 3)).last.result.model
    between = np.linspace(-5.0, 40.0, 91)
    c = Conditions({"C": np.deg2rad(between)}, directions={"C": np.ones(91)})
    foretold = np.zeros(91)
    for term in found.terms:
        columns = term.effect.motions(found.machine, c, {})[0].columns
        foretold += 1e6 * columns @ [v.value for v in term.values.values()]
    assert float(np.ptp(foretold)) < 1.2 * float(np.ptp(errors))


def test_part_of_a_turn_is_a_curve_and_no_waves_that_cancel() -> None:
    """Two waves over 40° were 39 mrad and 11 mrad of the other sign, for 30 µrad."""
    model = machine("w b C t", C=(-10.0, 50.0))
    rng = np.random.default_rng(3)
    lines = [
        f"line,rotation,{c:.3f},0,0,1,{1e-3 * (c - 20) ** 3 - 0.3 * (c - 20) + rng.normal():.2f}\n"
        for c in rng.uniform(0.0, 40.0, 80)
    ]
    campaign = as_campaign(HEAD + "setup,kind,C,ux,uy,uz,value\n" + "".join(lines), model)
    found = to_the_verdict(model, campaign).last.result.model
    assert {e.kind for e in found.effects} == {"rotary_positioning"}
    assert max(abs(v.value) for t in found.terms for v in t.values.values()) < 100e-6


def test_a_rival_that_is_nothing_at_every_target_is_no_fault() -> None:
    """Of a wave of twice the step, half is 0 wherever was read: nothing is made of it."""
    model = machine("w b X t", X=(-20.0, 20.0))
    rng = np.random.default_rng(4)
    lines = [
        f"run{run},displacement,{x},{s},1,0,0,"
        f"{-0.03 * x - 2.0 * s + 1.2 * np.sin(2 * np.pi * x / 5.0) + rng.normal(0.0, 0.3):.4f}\n"
        for run in range(5)
        for s in (1, -1)
        for x in np.linspace(-18.0, 18.0, 13)[::s]
    ]
    found = diagnose(model, as_campaign(HEAD + COLUMNS + "".join(lines), model))
    assert {"backlash axis=X", "cyclic axis=X"} <= {e.effect.spec for e in found.established}
    aliases = [a for e in found.established for a in e.aliases]
    assert any(a.found.candidate.effect.spec == "cyclic axis=X harmonics=2" for a in aliases)
    assert all(np.isfinite(a.separation) for a in aliases)
    assert all(np.isfinite(a.separation) and a.separation < 1e4 for a in found.advice)
