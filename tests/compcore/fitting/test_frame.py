"""The reference frame: chosen where it is free, never against what was measured."""

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.fitting.fit import fit
from abbe.compcore.fitting.frame import ReferenceFrame
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.sensitivity import prediction_sd
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import (
    GEOMETRY,
    bridge,
    model,
    plane_rows,
    random_theta,
    with_truth,
)


def measured(*free: str):
    rng = np.random.default_rng(4)
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    wanted = model(bridge(), *GEOMETRY, "straightness axis=Y direction=X shape=polynomial:3")
    campaign = rows.campaign("plane")
    return wanted, with_truth(wanted, campaign, random_theta(wanted, campaign, rng), rng)


def errors(result, *points: tuple[float, float]) -> np.ndarray:
    x, y = np.array(points).T
    places = Conditions({"X": x, "Y": y, "Z": np.full(len(x), -180.0)})
    return result.model.predict(places).translation


@pytest.mark.parametrize(
    ("frame", "ends"), [("X,Y", [(0, 450), (700, 450)]), ("Y,X", [(350, 0), (350, 900)])]
)
def test_the_primary_axis_runs_straight_through_the_middle(frame: str, ends) -> None:
    wanted, campaign = measured()
    result = fit(wanted, campaign, frame=ReferenceFrame.parse(frame))
    across = 1 if frame == "X,Y" else 0
    middle, low, high = errors(result, (350, 450), *ends)
    assert middle == pytest.approx(np.zeros(3), abs=1e-9)
    assert low[across] == pytest.approx(high[across], abs=1e-9)


def test_frames_differ_by_a_rigid_displacement_only() -> None:
    wanted, campaign = measured()
    free, axes = fit(wanted, campaign), fit(wanted, campaign, frame=ReferenceFrame("X", "Y"))
    assert axes.chi2 == pytest.approx(free.chi2, rel=1e-6)
    rng = np.random.default_rng(0)
    points = [tuple(p) for p in rng.uniform((0, 0), (700, 900), (30, 2))]
    apart = errors(axes, *points) - errors(free, *points)
    x, y = np.array(points).T
    zero, one = np.zeros(30), np.ones(30)
    rigid = np.concatenate([np.stack([one, zero, -y], 1), np.stack([zero, one, x], 1)])
    both = np.concatenate([apart[:, 0], apart[:, 1]])
    left = both - rigid @ np.linalg.lstsq(rigid, both, rcond=None)[0]
    assert np.abs(both).max() > 1e-3
    assert np.abs(left).max() < 1e-8


def test_least_errors_is_what_it_says() -> None:
    wanted, campaign = measured()
    rng = np.random.default_rng(0)
    points = [tuple(p) for p in rng.uniform((0, 0), (700, 900), (2000, 2))]
    free = errors(fit(wanted, campaign), *points)
    for frame in (ReferenceFrame("X", "Y"), ReferenceFrame("Y", "X")):
        axes = errors(fit(wanted, campaign, frame=frame), *points)
        assert (free**2).mean() < (axes**2).mean()


def test_the_frame_adds_no_uncertainty() -> None:
    wanted, campaign = measured()
    places = Conditions({"X": np.array([100.0]), "Y": np.array([100.0]), "Z": np.array([-180.0])})
    sd, _ = prediction_sd(fit(wanted, campaign, frame=ReferenceFrame("X", "Y")).model, places)
    assert sd[:, :2].max() < 5e-3


def test_frames_that_make_no_sense_are_refused() -> None:
    wanted, campaign = measured()
    with pytest.raises(InputError, match=r"reference frame.*least-squares"):
        ReferenceFrame.parse("X")
    with pytest.raises(InputError, match="no such axis"):
        fit(wanted, campaign, frame=ReferenceFrame("X", "W"))
