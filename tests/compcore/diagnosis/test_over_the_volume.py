"""A smooth error over the volume: for an arm of joints, and for no machine of straight axes."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations_with_replacement

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.diagnosis.uncatalogued.chosen import of_positions_alone
from abbe.compcore.diagnosis.uncatalogued.over_the_volume import smooth_errors
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging import trial

F64 = NDArray[np.float64]

VOLUME = """format = "abbe-model/1"
[machine]
name = "arm"
structure = "w b X Y Z t"
[machine.axes.X]
travel = [400.0, 900.0]
[machine.axes.Y]
travel = [-400.0, 400.0]
[machine.axes.Z]
travel = [50.0, 550.0]
"""
ROOM = """[machine.signals.room]
unit = "degC"
role = "ambient"
"""
NOISE = 20.0  # µm
PLACES, FITTED = 300, 200


def about(axis: int, angle: float) -> F64:
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
    return turn


def arm_errors(rng: np.random.Generator, places: F64) -> F64:
    """Three joints and a tool that hangs down: zeros, lengths and leaning axes err; µm."""
    upper, fore, shoulder, tool = 600.0, 580.0, 400.0, 200.0
    zero = rng.normal(0.0, 5e-4, 4)
    longer = rng.normal(0.0, 0.3, 3)
    lean = rng.normal(0.0, 4e-4, (3, 2))

    def tip(q: tuple[float, float, float], err: float) -> F64:
        turn = about(2, q[0] + err * zero[0]) @ about(0, err * lean[0, 0])
        at = turn @ np.array([0.0, 0.0, shoulder + err * longer[0]])
        turn = turn @ about(1, q[1] + err * zero[1]) @ about(2, err * lean[1, 0])
        at = at + turn @ np.array([upper + err * longer[1], 0.0, 0.0])
        turn = turn @ about(1, q[2] + err * zero[2]) @ about(0, err * lean[2, 1])
        at = at + turn @ np.array([fore + err * longer[2], 0.0, 0.0])
        turn = turn @ about(1, -q[1] - q[2] + err * zero[3])
        result: F64 = at + turn @ np.array([0.0, 0.0, -tool])
        return result

    errors = []
    for x, y, z in places:
        out, up = np.hypot(x, y), z + tool - shoulder
        far = np.hypot(out, up)
        elbow = np.arccos((far**2 - upper**2 - fore**2) / (2 * upper * fore))
        first = np.arctan2(-up, out) - np.arctan2(
            fore * np.sin(elbow), upper + fore * np.cos(elbow)
        )
        q = (float(np.arctan2(y, x)), float(first), float(elbow))
        np.testing.assert_allclose(tip(q, 0.0), (x, y, z), atol=1e-6)
        errors.append(1e3 * (tip(q, 1.0) - tip(q, 0.0)))
    return np.array(errors)


def axes_errors(_: np.random.Generator, places: F64) -> F64:
    """A machine of straight axes: a leaning Z, a long Y, a bow of X that the tool feels; µm."""
    x, y, z = ((places[:, i] - m) for i, m in enumerate((650.0, 0.0, 300.0)))
    bow = 60.0 * (np.cos(x / 150.0) - x / 700.0)
    return np.column_stack([0.3 * z, 0.2 * y + bow, np.zeros(len(x))])


def no_errors(_: np.random.Generator, places: F64) -> F64:
    return np.zeros_like(places)


def campaign(model: Model, places: F64, value: F64) -> Campaign:
    """Displacements in X, Y and Z at every place, one set-up for each direction."""
    lines = ['# format = "abbe-campaign/1"', "# [setups.t]", '# free = ["zero"]']
    lines.append("time,setup,kind,X,Y,Z,ux,uy,uz,value,sd")
    for k, (place, errors) in enumerate(zip(places, value, strict=True)):
        for j in range(3):
            at = ",".join(f"{p:.3f}" for p in place)
            u = ",".join("1" if i == j else "0" for i in range(3))
            lines.append(f"{k * 10},t{'xyz'[j]},displacement,{at},{u},{errors[j]:.2f},{NOISE:g}")
    return trial.as_campaign("\n".join(lines) + "\n", model)


def cubic(places: F64, value: F64) -> F64:
    """What a shop's cubic leaves of the places that were not fitted, µm."""
    at = (places - [650.0, 0.0, 300.0]) / 300.0
    powers = [c for d in range(4) for c in combinations_with_replacement(range(3), d)]
    columns = np.column_stack([np.prod(at[:, list(c)], axis=1) for c in powers])
    found = np.linalg.lstsq(columns[:FITTED], value[:FITTED], rcond=None)[0]
    left: F64 = value[FITTED:] - columns[FITTED:] @ found
    return left - left.mean(axis=0)


def rms(values: F64) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def measured(errors: Callable[[np.random.Generator, F64], F64], seed: int) -> tuple[F64, F64]:
    rng = np.random.default_rng(seed)
    places = rng.uniform([400.0, -400.0, 50.0], [900.0, 400.0, 550.0], (PLACES, 3))
    value = errors(rng, places)
    return places, value + rng.normal(0.0, NOISE, value.shape)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1])
def test_an_arm_that_is_told_x_y_z(seed: int) -> None:
    """No worse than a cubic where it is not fitted, though the axes are none of the arm's."""
    places, value = measured(arm_errors, seed)
    model = parse_model(TomlSource(VOLUME))
    course = to_the_verdict(model, campaign(model, places[:FITTED], value[:FITTED]))
    unseen = campaign(model, places[FITTED:], value[FITTED:])
    left = rms(compare(course.last.result.model, unseen).residual) * 1e3
    assert rms(value[FITTED:]) > 100.0
    assert left < 1.03 * rms(cubic(places, value))
    kinds = [e.kind for e in course.last.result.model.effects]
    assert "formula" in kinds


def test_straight_axes_keep_their_names() -> None:
    places, value = measured(axes_errors, 4)
    model = parse_model(TomlSource(VOLUME))
    course = to_the_verdict(model, campaign(model, places[:FITTED], value[:FITTED]))
    assert "described" not in {s.action for s in course.steps}
    kinds = {e.kind for e in course.last.result.model.effects}
    assert "straightness" in kinds
    unseen = campaign(model, places[FITTED:], value[FITTED:])
    assert rms(compare(course.last.result.model, unseen).residual) * 1e3 < 1.1 * NOISE


@pytest.mark.parametrize(
    ("spec", "goes"),
    [
        ("straightness axis=X direction=Y", True),
        ("cross_angular axis=X about=X by=Y", True),
        ("backlash axis=X", False),
        ("thermal_offset direction=Z signal=room", False),
        ("scale_expansion axis=X signals=room", False),
        ("event direction=X", False),
        ("warm_up direction=X", False),
        ("setup_frame setup=t", False),
    ],
)
def test_a_polynomial_takes_the_place_of_positions_alone(spec: str, goes: bool) -> None:
    """Not of warmth, time, direction, nor of how an instrument or a plate lay."""
    machine = parse_model(TomlSource(VOLUME + ROOM)).machine
    kind, *keys = spec.split()
    effect = make_effect(kind, dict(key.split("=") for key in keys))
    assert of_positions_alone(effect, machine) is goes


@pytest.mark.one_in(4)
@pytest.mark.parametrize("seed", range(4))
def test_noise_is_not_described(seed: int) -> None:
    places, value = measured(no_errors, 10 + seed)
    model = parse_model(TomlSource(VOLUME))
    course = to_the_verdict(model, campaign(model, places[:FITTED], value[:FITTED]))
    assert "described" not in {s.action for s in course.steps}


def test_four_linear_axes_have_more_products_than_a_formula_has_terms() -> None:
    """A boring mill with a ram ended with an error of the program: 53 terms, of 50 at most."""
    text = VOLUME.replace("w b X Y Z t", "w X' Z' b Y W (C) t")
    model = parse_model(TomlSource(text + "[machine.axes.W]\ntravel = [0.0, 700.0]\n"))
    rng = np.random.default_rng(2)
    lines = ['# format = "abbe-campaign/1"', "setup,kind,X,Y,Z,W,ux,uy,uz,value"]
    for at in rng.uniform([400.0, -400.0, 50.0, 0.0], [900.0, 400.0, 550.0, 700.0], (700, 4)):
        where = ",".join(f"{q:.2f}" for q in at)
        lines += [f"s,displacement,{where},{u},{rng.normal():.3f}" for u in ("1,0,0", "0,1,0")]
    campaign = trial.as_campaign("\n".join(lines) + "\n", model)
    found = list(smooth_errors(model.machine, campaign))
    assert found
    assert all(len(e.terms) <= 50 for effects in found for e in effects)
