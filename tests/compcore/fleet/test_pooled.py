"""Parameters over machines: against closed forms, a general optimiser, and simulated plants."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import optimize

from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import load_model, parse_model, save_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fleet.next_machine import next_machine
from abbe.compcore.fleet.pooled import pooled, spread
from abbe.compcore.model.model import Model, Value

HEAD = """format = "abbe-model/1"
[machine]
name = "M"
structure = "w X' b Y Z t"
reference_temperature = 20.0
[machine.axes.X]
travel = [0.0, 800.0]
[machine.axes.Y]
travel = [0.0, 500.0]
[machine.axes.Z]
travel = [0.0, 500.0]
[machine.signals.T_y]
unit = "degC"
role = "scale"
axis = "Y"
"""


EFFECTS = """
[[effects]]
kind = "scale_expansion"
axis = "Y"
signals = ["T_y"]
[[effects]]
kind = "backlash"
axis = "X"
"""
BARE = parse_model(TomlSource(HEAD))
UNFITTED = parse_model(TomlSource(HEAD + EFFECTS))


def model(alpha: float, sd: float) -> Model:
    expansion, backlash = UNFITTED.terms
    return replace(
        UNFITTED,
        terms=(
            replace(expansion, values={"alpha": Value(alpha, sd)}),
            replace(backlash, values={"b": Value(2e-3, 5e-4)}),
        ),
    )


def test_spread_of_machines_that_are_known_alike_is_their_variance_less_their_own() -> None:
    values = np.array([1.0, 4.0, 2.0, 9.0, 5.0])
    found = spread(values, np.full(5, 0.25))
    assert found.tau2 == pytest.approx(np.var(values, ddof=1) - 0.25, rel=1e-9)
    assert spread(np.full(5, 3.0), np.full(5, 0.25)).tau2 == 0.0


def test_spread_is_where_the_restricted_likelihood_is_greatest() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        variances = rng.uniform(0.1, 3.0, 9)
        values = rng.normal(5.0, np.sqrt(variances + rng.uniform(0.0, 4.0)))

        def minus_log(tau2: float, y: np.ndarray = values, s: np.ndarray = variances) -> float:
            w = 1.0 / (s + tau2)
            mean = w @ y / w.sum()
            terms = np.log(s + tau2).sum() + np.log(w.sum()) + w @ (y - mean) ** 2
            return float(0.5 * terms)

        best = optimize.minimize_scalar(minus_log, bounds=(0.0, 50.0), method="bounded")
        found = spread(values, variances).tau2
        assert minus_log(found) <= minus_log(float(best.x)) + 1e-6


def test_machines_lean_on_each_other_as_far_as_they_are_unsure() -> None:
    rng = np.random.default_rng(1)
    truth = rng.normal(11e-6, 1e-6, 12)
    sds = np.where(np.arange(12) % 2, 4e-6, 0.2e-6)
    models = [model(float(rng.normal(t, s)), float(s)) for t, s in zip(truth, sds, strict=True)]
    found = pooled(models, [f"M{i}" for i in range(12)])
    alpha = found.parameters[0]
    assert alpha.parameter.name == "alpha"
    assert alpha.mean == pytest.approx(11e-6, abs=3 * alpha.mean_sd)
    assert 0.3e-6 < alpha.spread < 2.5e-6
    own, shrunk = np.abs(alpha.values - truth), np.abs(alpha.pooled - truth)
    unsure = sds > 1e-6
    assert shrunk[unsure].mean() < 0.6 * own[unsure].mean()
    assert np.allclose(alpha.pooled[~unsure], alpha.values[~unsure], atol=0.2e-6)
    assert np.all(np.abs(alpha.pooled - truth) < 4.0 * alpha.pooled_sds)
    # the closed form of one parameter
    w = 1.0 / (alpha.sds**2 + alpha.spread**2)
    assert alpha.mean == pytest.approx(float(w @ alpha.values / w.sum()), rel=1e-6)
    assert alpha.mean_sd == pytest.approx(float(w.sum() ** -0.5), rel=1e-6)


def test_what_a_plant_foretells_of_the_next_machine_is_as_wrong_as_it_says() -> None:
    rng = np.random.default_rng(7)
    off = []
    for _ in range(100):
        truth = rng.normal(11e-6, 1e-6, 9)
        models = [model(float(rng.normal(t, 0.5e-6)), 0.5e-6) for t in truth[:8]]
        found = pooled(models, list("ABCDEFGH"))
        off.append((truth[8] - found.mean[0]) / np.sqrt(found.covariance[0, 0]))
    assert 0.8 < np.std(off) < 1.3


def test_the_next_machine_is_a_model_file(tmp_path: Path) -> None:
    found = pooled([model(10e-6, 1e-7), model(12e-6, 1e-7), model(11e-6, 1e-7)], ["a", "b", "c"])
    made = next_machine(found, model(0.0, 1e-7))
    save_model(made, tmp_path / "next.toml")
    again = load_model(tmp_path / "next.toml")
    alpha = again.terms[0].values["alpha"]
    assert alpha.value == pytest.approx(11e-6)
    assert alpha.sd is not None
    assert alpha.sd == pytest.approx(np.hypot(1e-6, 1e-6 / np.sqrt(3)), rel=0.02)
    assert again.covariance is not None
    assert again.covariance.shape == (2, 2)


def test_what_cannot_be_compared_is_said() -> None:
    with pytest.raises(InputError, match="compared with each other"):
        pooled([model(1e-5, 1e-7)], ["a"])
    other = parse_model(TomlSource(HEAD.replace("w X' b Y Z t", "w b X Y Z t")))
    with pytest.raises(InputError, match="another structure"):
        pooled([model(1e-5, 1e-7), other], ["a", "b"])
    with pytest.raises(InputError, match="no fitted effect in common"):
        pooled([model(1e-5, 1e-7), BARE], ["a", "b"])
    found = pooled([model(1e-5, 1e-7), model(1e-5, 1e-7)], ["a", "b"])
    assert found.left_out == ()
