"""The reference frame: chosen where it is free, never against what was measured."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.errors import InputError
from abbe.compcore.fitting.fit import fit
from abbe.compcore.fitting.frame import ReferenceFrame, most_used
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.sensitivity import prediction_sd
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import (
    DIRECTIONS,
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


LONG = (0.8, 0.0, -200.37)


def bridge_error(model, at, tool) -> np.ndarray:
    """Error of the functional point of ``w b Y X Z t``, by the levers of docs/conventions.md."""
    conditions = Conditions({a: np.array([v]) for a, v in zip("XYZ", at, strict=True)})
    motion = {str(m): float(v[0]) for m, v in model.error_motions(conditions).items()}
    levers = {"Y": (at[0], 0.0, at[2]), "X": (0.0, 0.0, at[2]), "Z": (0.0, 0.0, 0.0)}
    total = np.zeros(3)
    for axis, lever in levers.items():
        total += [motion.get(f"E_{k}{axis}", 0.0) for k in "XYZ"]
        turn = [motion.get(f"E_{k}{axis}", 0.0) for k in "ABC"]
        total += np.cross(turn, np.add(lever, tool))
    return total


@pytest.mark.parametrize(("asked", "holds"), [(None, LONG), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))])
def test_the_frame_holds_for_the_tool_that_measured_or_for_the_one_that_is_asked(asked, holds):
    rng = np.random.default_rng(4)
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    for axis, other in (("X", "Y"), ("Y", "X")):  # levels, against gravity
        way = {axis: np.linspace(0.0, 700.0, 15), other: 400.0, "Z": -180.0}
        for about in ("X", "Y"):
            u = DIRECTIONS[about]
            rows.add(f"l{axis}{about}", Kind.ROTATION, way, np.zeros(15), 0.5e-6, u=u, free=())
    angles = [f"angular axis={a} about={k} shape=polynomial:2" for a in "XY" for k in "XY"]
    straight = "straightness axis=Y direction=X shape=polynomial:3"
    wanted = model(bridge(), *GEOMETRY, straight, *angles)
    plain = rows.campaign("plane")
    tool = np.tile(LONG, (plain.n, 1))
    campaign = replace(plain, conditions=replace(plain.conditions, tool=tool))
    campaign = with_truth(wanted, campaign, random_theta(wanted, campaign, rng), rng)
    result = fit(wanted, campaign, frame=ReferenceFrame.parse("X,Y", asked))
    assert result.frame.tool == holds
    middle = bridge_error(result.model, (350.0, 450.0, -180.0), holds)
    low, high = (bridge_error(result.model, (x, 450.0, -180.0), holds) for x in (0.0, 700.0))
    np.testing.assert_allclose(middle[:2], 0.0, atol=1e-9)  # Z was not measured
    assert low[1] == pytest.approx(high[1], abs=1e-9)
    assert abs(low[1]) > 1e-4, "the bow of X, which no frame takes away"
    other = (0.0, 0.0, 0.0) if asked is None else LONG
    assert np.abs(bridge_error(result.model, (350.0, 450.0, -180.0), other)[:2]).max() > 1e-4


def test_of_several_tools_the_one_of_most_rows_counts_and_of_equals_the_first():
    short, long = [0.0, 0.0, -100.0], [0.0, 0.0, -200.0]
    assert most_used(np.array([short, long, long])) == (0.0, 0.0, -200.0)
    assert most_used(np.array([long, short])) == (0.0, 0.0, -200.0)
    assert most_used(np.array([short, long])) == (0.0, 0.0, -100.0)
