"""The design matrix against finite differences, dense least squares and itself in row blocks."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.fitting.design import row_blocks
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import fit
from abbe.compcore.fitting.reduction import leverage
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import (
    BASES,
    DIRECTIONS,
    GEOMETRY,
    TOOLS,
    bridge,
    distance_rows,
    mill,
    model,
    plane_rows,
    random_theta,
    with_truth,
)


def plane(*free: str, seed: int = 0, specs: tuple[str, ...] = GEOMETRY):
    rng = np.random.default_rng(seed)
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    machine = bridge()
    campaign = rows.campaign("plane")
    if free:
        setups = {n: replace(s, free=free) for n, s in campaign.setups.items()}
        campaign = replace(campaign, setups=setups)
    wanted = model(machine, *specs)
    theta = random_theta(wanted, campaign, rng)
    return wanted, with_truth(wanted, campaign, theta, rng), theta


def distances():
    rng = np.random.default_rng(3)
    rows = Rows(("X", "Y", "Z"))
    distance_rows(rows, rng)
    wanted = model(
        mill(),
        "positioning axis=X shape=polynomial:3",
        "straightness axis=Z direction=X shape=polynomial:2",
        "angular axis=X about=Y shape=polynomial:2",
        "spindle_squareness direction=X",
        "length_bias",
    )
    campaign = rows.campaign("distances", bases=BASES, tools=TOOLS)
    theta = random_theta(wanted, campaign, rng)
    return wanted, with_truth(wanted, campaign, theta, rng), theta


def slopes(problem: Problem, theta: np.ndarray) -> np.ndarray:
    """∂(weighted predicted)/∂θ by central differences."""
    columns = []
    for k, scale in enumerate(problem.layout.scale):
        step = np.zeros_like(theta)
        step[k] = 1e-3 * scale
        ends = [problem.predicted(theta + sign * step) for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2e-3 * scale) * problem.weight)
    return np.stack(columns, axis=1)


def test_columns_are_the_slopes_of_distances_with_bases_tools_and_spindle() -> None:
    wanted, campaign, theta = distances()
    problem = Problem(wanted, campaign)
    names = [u.name for u in problem.layout.unknowns]
    assert names.count("base B2 y") == 1
    assert "tool T1 y" in names
    assert "tool T2 y" not in names
    found = problem.columns(theta) * problem.layout.scale
    expected = slopes(problem, theta) * problem.layout.scale
    # first order: a turned tool's lever and the error's own part across the line of sight are left
    assert found == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


def test_distances_come_back_from_bases_and_tools_known_to_a_millimetre() -> None:
    wanted, campaign, _ = distances()
    result = fit(wanted, campaign)
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.25)
    stated = np.array([TOOLS["T2"].offset[k] for k in (0, 2)])
    where, _ = result.problem.layout.tools["T2"]
    assert np.abs(result.theta[where] - stated).max() > 1e-3


@pytest.mark.parametrize("free", [(), ("frame",), ("zero", "slope")])
def test_elimination_is_the_same_as_one_dense_least_squares(free: tuple[str, ...]) -> None:
    wanted, campaign, _ = plane(*free)
    result = fit(wanted, campaign)
    problem = result.problem
    dense = problem.jacobian(problem.start())
    assert dense.shape[1] > problem.layout.size
    size = np.linalg.norm(dense, axis=0)
    size[size <= 1e-12 * size.max()] = 1.0  # columns of rounding only
    weighted = campaign.value / campaign.sd
    solution, _, rank, _ = np.linalg.lstsq(dense / size, weighted, rcond=1e-9)
    left = weighted - dense / size @ solution
    assert result.weighted == pytest.approx(left, abs=1e-6)
    assert result.dof == campaign.n - rank
    assert result.residual / campaign.sd == pytest.approx(left, abs=1e-6)


@pytest.mark.parametrize("most", [7, 20, 90])
def test_row_blocks_give_what_the_whole_gives(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    wanted, campaign, _ = plane("zero", "slope")
    whole = fit(wanted, campaign)
    absorbed = leverage(whole.problem, whole.theta, whole.decomposition)
    monkeypatch.setattr(row_blocks, "BLOCK_BYTES", most * 8 * (whole.problem.layout.size + 1))
    monkeypatch.setattr(row_blocks, "FEWEST_ROWS", 1)
    in_blocks = fit(wanted, campaign)
    assert in_blocks.problem.large
    assert len(list(in_blocks.problem.row_blocks(in_blocks.theta))) > 1
    assert in_blocks.theta == pytest.approx(whole.theta, abs=1e-12)
    assert in_blocks.residual == pytest.approx(whole.residual, abs=1e-12)
    assert leverage(in_blocks.problem, in_blocks.theta, in_blocks.decomposition) == pytest.approx(
        absorbed, abs=1e-9
    )


def test_leverages_sum_to_what_was_fitted() -> None:
    wanted, campaign, _ = plane()
    result = fit(wanted, campaign)
    absorbed = leverage(result.problem, result.theta, result.decomposition)
    fitted = result.decomposition.rank + result.eliminator.rank
    assert absorbed.sum() == pytest.approx(fitted)


def test_residuals_are_orthogonal_to_all_columns_and_lose_nothing_else() -> None:
    wanted, campaign, _ = plane()
    result = fit(wanted, campaign)
    dense = result.problem.jacobian(result.theta)
    left, sizes, _ = np.linalg.svd(dense / np.linalg.norm(dense, axis=0), full_matrices=False)
    q = left[:, sizes > 1e-9 * sizes[0]]
    assert q.shape[1] == result.decomposition.rank + result.eliminator.rank
    other = np.random.default_rng(0).normal(size=(campaign.n, 3))
    assert result.residualise(other) == pytest.approx(other - q @ (q.T @ other), abs=1e-8)


def test_effect_columns_are_those_of_the_jacobian() -> None:
    wanted, campaign, theta = plane()
    problem = Problem(wanted, campaign)
    for i, effect in enumerate(wanted.effects):
        own = problem.columns(theta)[:, problem.layout.terms[i]]
        assert problem.effect_columns(effect, {}) == pytest.approx(own)


def arm_under_a_tracker(rng: np.random.Generator) -> tuple[Machine, Campaign]:
    """25 poses of three joints, a tool that is known approximately, a tracker."""
    places = {"C1": (0.0, 0.0, -900.0), "B2": (50.0, 0.0, -900.0), "B3": (50.0, 0.0, -400.0)}
    axes = {a: Axis(a, (-2.0, 2.0), location=at) for a, at in places.items()}
    arm = Machine("arm", Structure.parse("w b C1 B2 B3 t"), axes)
    rows = Rows(tuple(axes))
    poses = {a: rng.uniform(-1.0, 1.0, 25) for a in axes}
    for u in DIRECTIONS.values():
        keys = {"u": u, "tool_name": "T1", "free": ("frame",)}
        rows.add("tracker", Kind.DISPLACEMENT, poses, np.zeros(25), 1e-2, **keys)
    campaign = rows.campaign("arm", tools={"T1": TOOLS["T1"]})
    return arm, campaign


def test_an_arm_that_stands_askew_is_led_to_where_its_residuals_are_least() -> None:
    """Zeros of degrees, a tracker whose frame is turned: slopes of χ² itself."""
    rng = np.random.default_rng(8)
    arm, campaign = arm_under_a_tracker(rng)
    wanted = replace(
        model(arm, *(f"rotary_location axis={a}" for a in arm.axes)), composition="exact"
    )
    problem = Problem(wanted, campaign)
    theta = problem.start()
    angles = [i for i, u in enumerate(problem.layout.unknowns) if u.name[2] in "ABC"]
    theta[angles[:-3]] = rng.uniform(-0.15, 0.15, len(angles) - 3)
    point = problem.observation(theta).chain.point
    turned = np.einsum("ni,ni->n", campaign.conditions.u, np.cross([0.01, -0.02, 0.015], point))
    value = problem.predicted(theta) + turned + rng.normal(0.0, 0.3, problem.n)
    problem = Problem(wanted, replace(campaign, value=value))

    def left(at: np.ndarray) -> np.ndarray:
        return problem.eliminator(at).project(problem.residual(at))

    found = -left(theta) @ problem.columns(theta) * problem.layout.scale
    expected = []
    for k, scale in enumerate(problem.layout.scale):
        step = np.zeros_like(theta)
        step[k] = 1e-4 * scale
        ends = [left(theta + sign * step) for sign in (1.0, -1.0)]
        expected.append((ends[0] @ ends[0] - ends[1] @ ends[1]) / 4e-4)
    # how a tool turns with its tracker's frame leads nowhere: see below
    tools = [np.arange(len(theta))[where] for where, _ in problem.layout.tools.values()]
    others = np.setdiff1d(np.arange(len(theta)), np.concatenate(tools))
    np.testing.assert_allclose(
        found[others], np.array(expected)[others], rtol=1e-4, atol=1e-3 * np.abs(expected).max()
    )


def test_a_tool_that_is_free_is_not_led_away_by_how_its_tracker_stands() -> None:
    """A frame turned by 2 mrad and a metre of tool would imitate 2 mm of askew joints."""
    rng = np.random.default_rng(9)
    arm, campaign = arm_under_a_tracker(rng)
    locations = (f"rotary_location axis={a}" for a in arm.axes)
    askew = replace(model(arm, *locations), composition="exact")
    problem = Problem(askew, campaign)
    theta = problem.start()
    angles = [i for i, u in enumerate(problem.layout.unknowns) if u.name[2] in "ABC"]
    theta[angles[:-3]] = rng.uniform(-0.01, 0.01, len(angles) - 3)
    bare = replace(model(arm), composition="exact")
    result = fit(bare, replace(campaign, value=problem.predicted(theta)))
    stated = np.array(campaign.tools["T1"].offset)
    where, free = result.problem.layout.tools["T1"]
    assert len(free) > 0
    assert np.abs(result.theta[where] - stated[list(free)]).max() < 5.0
