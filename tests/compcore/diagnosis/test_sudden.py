"""An event is sudden: no wander is called one, and a step in one is."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.screening.suddenness import Wander, gradual
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.design.nuisance import Eliminator
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging import trial

F64 = NDArray[np.float64]

MODEL = """format = "abbe-model/1"
[machine]
name = "pin"
structure = "w b Z t"
[machine.axes.Z]
travel = [0.0, 250.0]
[machine.signals.room]
unit = "degC"
role = "ambient"
"""
HEAD = '# format = "abbe-campaign/1"\n# [setups.pin]\n# free = ["zero"]\n'
N, EVERY = 150, 20.0
"""Readings of one place, s apart."""


def wander(kind: str, rng: np.random.Generator) -> F64:
    """A drift of some 5 to 30 µm that no signal shows."""
    t = EVERY * np.arange(N)
    if kind == "random walk":
        return np.cumsum(rng.normal(0.0, 1.5, N))
    if kind == "settling":
        early, late = np.exp(-t / rng.uniform(100.0, 300.0)), np.exp(-t / rng.uniform(800, 3000))
        return np.asarray(rng.uniform(5.0, 20.0) * early - rng.uniform(5.0, 20.0) * late)
    out = np.zeros(N)
    for i in range(1, N):
        out[i] = 0.95 * out[i - 1] + rng.normal(0.0, 1.5)
    return out


def record(
    values: F64, rng: np.random.Generator, *, every: float = EVERY
) -> tuple[Model, Campaign]:
    """Readings in µm of a pin that does not move, and a room's temperature that has no part."""
    model = parse_model(TomlSource(MODEL))
    n = len(values)
    room = 20.0 + 0.3 * np.sin(6.0 * np.arange(n) / n + rng.uniform(0.0, 6.0))
    rows = [
        f"{every * i:.0f},pin,displacement,0,0,0,1,{v:.3f},{r:.2f}\n"
        for i, (v, r) in enumerate(zip(values, room, strict=True))
    ]
    return model, as_campaign(rows, model)


def as_campaign(rows: list[str], model: Model) -> Campaign:
    return trial.as_campaign(
        HEAD + "time,setup,kind,Z,ux,uy,uz,value,room\n" + "".join(rows), model
    )


@pytest.mark.parametrize("kind", ["random walk", "autocorrelated", "settling"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_wanders_is_no_event(kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, len(kind)])
    values = wander(kind, rng) + rng.normal(0.0, 1.0, N)
    course = to_the_verdict(*record(values, rng))
    assert "event" not in {e.kind for e in course.last.result.model.effects}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_step_in_noise_is_an_event(seed: int) -> None:
    rng = np.random.default_rng(seed)
    at = int(rng.integers(30, 120))
    values = 6.0 * (np.arange(N) >= at) + rng.normal(0.0, 1.0, N)
    (found,) = diagnose(*record(values, rng)).established
    assert found.effect.kind == "event"
    (t0,) = (e.value for e in found.estimates if e.name == "t0")
    assert abs(t0 / EVERY - at) <= 1.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_step_amid_a_wander_is_an_event(seed: int) -> None:
    rng = np.random.default_rng(seed)
    at = int(rng.integers(30, 120))
    drift = np.cumsum(rng.normal(0.0, 0.3, N))
    values = drift + 15.0 * (np.arange(N) >= at) + rng.normal(0.0, 0.5, N)
    found = {e.effect.kind for e in diagnose(*record(values, rng)).established}
    assert "event" in found


@pytest.mark.parametrize("tau", [20.0, 40.0])
@pytest.mark.parametrize("seed", [0, 1, 3])
def test_what_takes_a_while_is_no_event(tau: float, seed: int) -> None:
    # a body that is cooled from a moment on, read every 3 s: over after a minute or two of 30
    rng = np.random.default_rng(seed)
    t = 3.0 * np.arange(600)
    at = rng.uniform(600.0, 1200.0)
    moved = -20.0 * np.expm1(-np.clip(t - at, 0.0, None) / tau)
    found = diagnose(*record(moved + rng.normal(0.0, 1.0, len(t)), rng, every=3.0)).established
    assert "event" not in {e.effect.kind for e in found}


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_step_between_two_of_many_readings_is_an_event(seed: int) -> None:
    rng = np.random.default_rng(seed)
    moved = 6.0 * (np.arange(600) >= rng.integers(100, 500))
    (found,) = diagnose(*record(moved + rng.normal(0.0, 1.0, 600), rng, every=3.0)).established
    assert found.effect.kind == "event"


def free(residual: F64) -> Basis:
    """A model without effects, its residual as it is."""
    none = np.zeros((len(residual), 0))
    return Basis(none, residual, Eliminator((), np.ones(len(residual))), none)


def steps(n: int) -> F64:
    return np.asarray(np.tril(np.ones((n, n)))[:, 1:])


def test_where_nothing_wanders_a_step_is_as_likely_as_any_cause() -> None:
    rng = np.random.default_rng(0)
    n = 200
    step = steps(n)[:, 99:100]
    noise = rng.normal(size=n)
    basis = free(noise - noise.mean())
    # the likelihood ratio of Gaussian noise of unknown size, with no wander at all
    left = basis.chi2 - basis.extended(step).chi2
    plain = basis.dof * np.log(basis.chi2 / (basis.chi2 - left))
    assert Wander.of(basis, steps(n)).likelier_with(step) == pytest.approx(plain, abs=0.5)


def test_a_wander_s_own_greatest_step_is_no_surprise() -> None:
    rng = np.random.default_rng(3)
    n, greatest = 100, []
    for _ in range(10):
        basis = free(np.cumsum(rng.normal(size=n)))
        beside = Wander.of(basis, steps(n))
        greatest.append(max(beside.likelier_with(c[:, None]) for c in steps(n).T[::20]))
    # a χ² of one degree of freedom each: the greatest of fifty is below 20
    assert max(greatest) < 20.0


def test_a_change_in_a_finite_time_is_likelier_slowly_and_a_step_is_not() -> None:
    rng = np.random.default_rng(5)
    n, at = 200, 90
    time = np.arange(float(n))
    step = steps(n)[:, at - 1 : at]
    noise = rng.normal(size=n)
    for tau, slow in ((0.0, False), (10.0, True)):
        moved = 10.0 * gradual_or_not(time, at, tau) + noise
        wander = Wander.of(free(moved - moved.mean()), steps(n))
        better = wander.likelier_slowly(step, gradual(time, float(at)))
        assert (better > float(np.log(n))) is slow


def gradual_or_not(time: F64, at: float, tau: float) -> F64:
    return np.asarray(-np.expm1(-np.clip(time - at, 0.0, None) / tau) if tau else time >= at)


@pytest.mark.parametrize("again", [6006.0, 6010.0, 6014.0])
def test_a_step_just_after_a_time_in_which_nothing_shows_it_is_found_where_it_was(
    again: float,
) -> None:
    """An hour of lines that are blind to Z; then one reading in Z, and the step right after it."""
    rng = np.random.default_rng(5)
    model = parse_model(
        TomlSource(
            'format = "abbe-model/1"\n[machine]\nname = "m"\nstructure = "w b X Z t"\n'
            "[machine.axes.X]\ntravel = [0.0, 500.0]\n[machine.axes.Z]\ntravel = [0.0, 500.0]\n"
        )
    )
    in_z = [*np.arange(0.0, 2000.0, 20.0), *np.arange(again, 8000.0, 20.0)]
    moment = again + 10.0
    rows = ['# format = "abbe-campaign/1"', "# [setups.probe]", '# free = ["zero"]']
    rows += ["# [setups.line]", '# free = ["zero"]', "time,setup,kind,X,Z,ux,uy,uz,value"]
    for t in sorted([*in_z, *np.arange(2000.0, 6000.0, 20.0)]):
        z = t in in_z
        value = (12.0 * (t > moment) if z else 0.0) + rng.normal(0.0, 0.5)
        what = "probe,displacement,100,100,0,0,1" if z else "line,displacement,100,100,1,0,0"
        rows.append(f"{t},{what},{value:.4f}")
    found = diagnose(model, trial.as_campaign("\n".join(rows) + "\n", model))
    assert [e.effect.spec for e in found.established] == ["event direction=Z"]
    by_name = {e.name: e.value for e in found.established[0].estimates}
    assert moment - 10.0 <= by_name["t0"] <= moment + 10.0
