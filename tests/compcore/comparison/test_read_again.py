"""A plate that is probed on several days: what the model lacks, and what changed between them."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import compare
from abbe.compcore.comparison.read_again import ReadAgain, read_again
from abbe.compcore.effects import make_effect
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model, Term
from benchmarks.hidden.judging import trial

PRINTER = parse_model(
    TomlSource(
        'format = "abbe-model/1"\n[machine]\nname = "printer"\nstructure = "w Z\' b Y X t"\n'
        "[machine.axes.X]\ntravel = [0.0, 300.0]\n[machine.axes.Y]\ntravel = [0.0, 300.0]\n"
        "[machine.axes.Z]\ntravel = [0.0, 300.0]\n"
    )
)
_KEYS = {"axis": "X", "direction": "Z", "shape": "polynomial:2"}
MODEL = Model(PRINTER.machine, (Term(make_effect("straightness", _KEYS)),))
X, Y = (g.ravel() for g in np.meshgrid(np.linspace(10.0, 290.0, 8), np.linspace(10.0, 290.0, 8)))
RNG = np.random.default_rng(8)


def plane_out(error: np.ndarray) -> np.ndarray:
    plane = np.column_stack([np.ones_like(X), X, Y])
    return error - plane @ np.linalg.lstsq(plane, error, rcond=None)[0]


BOW = plane_out(40.0 * ((X - 150.0) / 140.0) ** 2)
TWIST = 20.0 * (X - 150.0) * (Y - 150.0) / 140.0**2
"""µm; of it the model says nothing."""


def days(*errors: np.ndarray, noise: float = 1.0, name: str = "day") -> Campaign:
    lines = ['# format = "abbe-campaign/1"']
    lines += [f'# [setups.{name}{k}]\n# free = ["frame"]' for k in range(len(errors))]
    lines.append("setup,kind,X,Y,Z,ux,uy,uz,value")
    for k, error in enumerate(errors):
        read = error + RNG.normal(0.0, noise, len(X))
        lines += [
            f"{name}{k},displacement,{x:g},{y:g},0,0,0,1,{e:.3f}"
            for x, y, e in zip(X, Y, read, strict=True)
        ]
    return trial.as_campaign("\n".join(lines) + "\n", PRINTER)


def beside(fitted: Campaign, unseen: Campaign) -> ReadAgain | None:
    result = fit(MODEL, fitted)
    return read_again(result, compare(result.model, unseen), rotations=False)


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(plane_out(error) ** 2)))


def test_a_day_like_the_others_needs_no_words() -> None:
    assert beside(days(BOW, BOW, BOW), days(BOW, name="new")) is None


def test_what_all_days_show_is_lacking_in_the_model_and_the_rest_has_changed() -> None:
    other = plane_out(24.0 * np.sin(Y / 40.0))
    fitted = days(*3 * [BOW + TWIST], noise=8.0)
    found = beside(fitted, days(BOW + TWIST + other, name="new"))
    assert found is not None
    assert not found.otherwise
    assert (found.rows, found.of) == (64, 64)
    assert found.lacking == pytest.approx(1e-3 * rms(TWIST), rel=0.35)
    assert found.changed == pytest.approx(1e-3 * rms(other), rel=0.15)
    (words,) = found.words()
    assert "stands in the fitted campaigns, too, and is lacking in the model" in words


def test_days_that_agree_and_one_that_does_not_say_that_something_was_changed() -> None:
    found = beside(days(BOW + TWIST, BOW + TWIST), days(BOW - TWIST, name="new"))
    assert found is not None
    assert found.otherwise
    assert found.between == pytest.approx(2e-3 * rms(TWIST), rel=0.1)
    assert found.among == pytest.approx(1e-3, rel=0.3)
    (words,) = found.words()
    assert "something was changed" in words


def test_another_error_that_the_fitted_days_do_not_show_is_no_lack_of_the_model() -> None:
    found = beside(days(BOW, noise=5.0), days(BOW + TWIST, name="new"))
    assert found is not None
    assert found.lacking == 0.0
    (words,) = found.words()
    assert "nothing surely stands in the fitted campaigns" in words


def test_other_places_tell_nothing() -> None:
    fitted, unseen = days(BOW), days(BOW + TWIST, name="new")
    elsewhere = unseen.conditions.positions["X"] + 5.0
    moved = trial.as_campaign(
        "\n".join(
            [
                '# format = "abbe-campaign/1"\n# [setups.new0]\n# free = ["frame"]',
                "setup,kind,X,Y,Z,ux,uy,uz,value",
                *(
                    f"new0,displacement,{x:g},{y:g},0,0,0,1,{1e3 * v:.3f}"
                    for x, y, v in zip(elsewhere, Y, unseen.value, strict=True)
                ),
            ]
        )
        + "\n",
        PRINTER,
    )
    assert beside(fitted, moved) is None
