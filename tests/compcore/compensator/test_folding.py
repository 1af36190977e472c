"""The parts of a fold: nodes, products, what effects read, look-ups of many positions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from abbe.compcore.compensator.batch import Finder
from abbe.compcore.compensator.folding.cross import NotSeparableError, find_cross
from abbe.compcore.compensator.folding.metric import Metric
from abbe.compcore.compensator.folding.nodes.layout import SampledFunctions, TooManyNodesError
from abbe.compcore.compensator.folding.slow_state import SlowState, plausible_states
from abbe.compcore.compensator.folding.tables import FoldedAxisTable
from abbe.compcore.compensator.rotation import about, apply, product, solved, transposed
from abbe.compcore.effects import ErrorMotion
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import rotation_about
from abbe.compcore.model.reads import Reads, reads_of
from tests.support.compcore.machines import machine
from tests.support.compcore.random_models import random_machine


def layout(function, breaks) -> SampledFunctions:
    """Of one function in mm, one component."""
    return SampledFunctions(
        lambda x: function(x)[:, None, None], lambda e: np.abs(e[..., 0, :]), breaks
    )


def interpolation_error(function, nodes) -> float:
    x = np.sort(np.random.default_rng(0).uniform(nodes[0], nodes[-1], 50_000))
    return float(np.abs(np.interp(x, nodes, function(nodes)) - function(x)).max())


@pytest.mark.parametrize("tolerance", [1e-7, 1e-5, 1e-3])
def test_nodes_are_as_many_as_needed(tolerance: float) -> None:
    def wave(x):
        return 0.01 * np.sin(x / 30.0)

    nodes = layout(wave, [0.0, 500.0]).nodes(tolerance, 10**6)
    off = interpolation_error(wave, nodes)
    # a chord over h misses a curve of curvature c by c·h²/8; the mean of √|sin| is 0.763
    needed = 0.763 * 500.0 / np.sqrt(8 * tolerance / (0.01 / 30.0**2))
    assert 0.1 * tolerance < off <= tolerance
    assert needed < len(nodes) < 2.5 * needed


def test_a_straight_line_needs_its_ends_and_a_bend_its_node() -> None:
    straight = layout(lambda x: 3.0 * x - 7.0, [-5.0, 900.0])
    assert straight.off < 1e-9
    assert straight.nodes(1e-9, 100).tolist() == [-5.0, 900.0]
    bent = layout(lambda x: np.abs(x - 123.456), [0.0, 123.456, 900.0])
    assert bent.nodes(1e-9, 100).tolist() == [0.0, 123.456, 900.0]


@pytest.mark.parametrize("period", [1.0, 0.5, 0.25, 2.0, 1.0 / 3.0])
def test_a_period_that_the_grid_repeats_is_seen(period: float) -> None:
    """512 cells over 512 mm: samples at the nodes alone would see a constant."""

    def wave(x):
        return 1e-3 * np.sin(2 * np.pi * x / period)

    assert layout(wave, [0.0, 512.0]).off > 5e-4


def test_a_jump_is_kept_narrow() -> None:
    def jump(x):
        return np.where(x < 100.0 / 3.0, 0.0, 0.01)

    nodes = layout(jump, [0.0, 100.0]).nodes(1e-6, 1000)
    near = nodes[np.abs(nodes - 100.0 / 3.0) < 1.0]
    assert np.diff(near).min() < 1e-6
    x = np.array([33.333, 33.3334])
    assert np.abs(np.interp(x, nodes, jump(nodes)) - jump(x)).max() < 1e-6


def test_too_many_nodes_are_said() -> None:
    with pytest.raises(TooManyNodesError):
        layout(lambda x: np.sin(50.0 * x), [0.0, 500.0]).nodes(1e-6, 2000)


@settings(max_examples=60, deadline=None)
@given(rank=st.integers(1, 5), seed=st.integers(0, 10**6), variables=st.integers(2, 4))
def test_sums_of_products_are_found(rank: int, seed: int, variables: int) -> None:
    rng = np.random.default_rng(seed)
    powers = rng.integers(0, 4, (rank, variables))
    weights = rng.normal(size=(2, rank))

    def function(rows: np.ndarray) -> np.ndarray:
        terms = np.prod(np.cos(rows[:, None, :] * (1 + powers)), axis=2)
        return weights @ terms.T

    grids = [np.linspace(-1.0, 1.0, 12) for _ in range(variables)]
    cross = find_cross(function, grids, 1e-9)
    assert cross is not None
    nodes = [np.sort(rng.uniform(-1.0, 1.0, 7 + v)) for v in range(variables)]
    for state in range(2):
        products = cross.products(function(cross.rows(nodes))[state], nodes)
        at = rng.integers(0, 7, (40, variables))
        found = sum(
            np.prod([f[at[:, v]] for v, f in enumerate(factors)], axis=0) for factors in products
        )
        rows = np.stack([nodes[v][at[:, v]] for v in range(variables)], axis=1)
        assert np.abs(found - function(rows)[state]).max() < 1e-6


def test_what_is_no_short_sum_of_products_is_said() -> None:
    def ridge(rows: np.ndarray) -> np.ndarray:
        return np.abs(rows[:, 0] - rows[:, 1])[None]

    with pytest.raises(NotSeparableError):
        find_cross(ridge, [np.linspace(0.0, 1.0, 33)] * 2, 1e-9)


def test_nothing_needs_no_products() -> None:
    assert find_cross(lambda rows: np.zeros((1, len(rows))), [np.arange(4.0)] * 2, 1e-12) is None


def test_what_an_effect_reads_is_noted() -> None:
    n = np.ones(3)
    conditions = Conditions(
        {"X": n, "Y": n, "Z": n}, directions={"X": n, "Y": n}, signals={"a": n, "b": n, "c": n}
    )

    def looks(at: Conditions) -> None:
        at.position("Y")
        at.direction("X")
        at.mean_signal(("a", "b"))
        at.lag("c", 60.0)

    found = reads_of(looks, conditions)
    assert found.positions == {"Y"}
    assert found.directions == {"X"}
    assert found.signals == {"a", "b"}
    assert found.lags == {("c", 60.0)}
    assert not found.others
    assert found.slow
    assert reads_of(lambda at: at.time, conditions).others == {"time"}
    assert reads_of(lambda at: at.tool, conditions).others == {"tool"}
    assert not reads_of(lambda at: at.position("X"), conditions).slow


@pytest.mark.parametrize(
    "copy",
    [
        lambda at, n: at.moved({"X": n}),
        lambda at, n: at.with_offset("b", 1.0).with_gain("b", 2.0, 20.0),
        lambda at, n: at.straightened("b", 1e-4, 20.0).straightened("b", 1e-4, 20.0, now=1e-4),
        lambda at, n: at.rows(np.array([0, 2])).moved({"X": n[:2]}),
    ],
    ids=["displaced", "amended", "straightened", "picked"],
)
def test_of_copied_conditions_is_noted_what_is_read_of_the_copy(copy) -> None:
    n = np.ones(3)
    conditions = Conditions({"X": n, "Z": n}, directions={"X": n}, signals={"a": n, "b": n, "c": n})

    def looks(at: Conditions) -> None:
        here = copy(at, n)
        here.position("Z")
        here.mean_signal(("a", "b"))
        here.lag("b", 60.0)

    assert reads_of(looks, conditions) == Reads({"Z"}, set(), {"a", "b"}, {("b", 60.0)}, set())
    assert reads_of(lambda at: copy(at, n), conditions) == Reads()
    assert reads_of(lambda at: copy(at, n).time, conditions).others == {"time"}
    assert reads_of(lambda at: copy(at, n).direction("X"), conditions).directions == {"X"}
    seen: list[Conditions] = []
    reads_of(lambda at: seen.append(copy(at, n)), conditions)
    there = copy(conditions, n)
    for name in ("a", "b"):
        np.testing.assert_array_equal(seen[0].signals[name], there.signals[name])
    np.testing.assert_array_equal(seen[0].position("X"), there.position("X"))


@given(
    nodes=arrays(np.float64, st.integers(1, 60), elements=st.floats(-500, 500, width=32)).map(
        np.unique
    ),
    seed=st.integers(0, 1000),
)
@example(nodes=np.linspace(-360.0, 0.0, 101), seed=0)
@example(nodes=np.array([0.0, 1e-13, 1.0]), seed=0)
@example(nodes=np.array([-1.0, 0.0, 4e-36]), seed=0)
@example(nodes=np.array([0.0, 4e-36]), seed=0)
@example(nodes=900.0 / 1280 * np.unique(np.array([0, 3, 16, 17, 18, 256, 700, 1280])), seed=0)
def test_the_segment_of_many_positions(nodes: np.ndarray, seed: int) -> None:
    """Within rounding, where either neighbour serves: tables are continuous."""
    rng = np.random.default_rng(seed)
    at = np.concatenate([rng.uniform(-600.0, 600.0, 500), nodes])
    found = np.clip(Finder(nodes)(at), 0, len(nodes))
    lower = np.concatenate([[-np.inf], nodes])[found]
    upper = np.concatenate([nodes, [np.inf]])[found]
    slack = 1e-9 * max(float(np.ptp(nodes)), 1e-3)
    assert (lower <= at + slack).all()
    assert (at <= upper + slack).all()


def test_tables_hold_or_continue_outside_their_nodes() -> None:
    nodes, values = np.array([0.0, 10.0, 20.0]), np.array([[0.0], [1.0], [5.0]])
    flat = FoldedAxisTable.through(0, nodes, values, np.zeros(1), np.zeros(1))
    assert flat.look_up(np.array([-5.0, 5.0, 10.0, 15.0, 99.0]))[:, 0] == pytest.approx(
        [0.0, 0.5, 1.0, 3.0, 5.0]
    )
    going = FoldedAxisTable.through(0, nodes, values, np.array([0.1]), np.array([-1.0]))
    assert going.look_up(np.array([-5.0, 25.0]))[:, 0] == pytest.approx([-0.5, 0.0])


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3), st.floats(-10, 10))
def test_rotations_in_floats_are_those_of_the_kinematics(axis: list[float], angle: float) -> None:
    length = float(np.linalg.norm(axis))
    if length < 1e-3:
        return
    x, y, z = (c / length for c in axis)
    expected = rotation_about(np.array([x, y, z]), np.array([angle]))[0]
    found = about((x, y, z), angle)
    assert np.array(found).reshape(3, 3) == pytest.approx(expected, abs=1e-12)
    assert apply(found, 1.0, 2.0, 3.0) == pytest.approx(expected @ [1.0, 2.0, 3.0], abs=1e-12)
    assert product(found, transposed(found)) == pytest.approx(
        (1, 0, 0, 0, 1, 0, 0, 0, 1), abs=1e-12
    )
    columns = [(1.0, 0.2, 0.1), (0.0, 1.0, 0.3), (-0.1, 0.2, 1.0)]
    matrix = np.array(columns).T
    assert solved(columns, 1.0, 2.0, 3.0) == pytest.approx(np.linalg.solve(matrix, [1, 2, 3]))


def test_states_show_sums_and_differences_of_any_two_signals() -> None:
    of = random_machine("w b Y X Z t", np.random.default_rng(0))
    names = ("T_x", "T_y", "T_low", "T_high")
    states = plausible_states(of, names, [("T_x", 600.0)], SlowState(), seen=False)
    table = np.array([[s.signals[n] for n in names] + [s.lags["T_x", 600.0]] for s in states])
    for i in range(table.shape[1]):
        for j in range(i):
            same = table[:, i] == table[:, j]
            assert same.any()
            assert not same.all()


def test_a_metric_is_the_longest_lever_of_the_volume() -> None:
    of = machine("w b Y X Z t")
    metric = Metric(of, [ErrorMotion("Y", "C"), ErrorMotion("Y", "X")], reach=100.0)
    # E_CY: what lies behind Y is X up to 700 mm and Z, and the tool up to 100 mm each way
    assert metric.largest(0) == pytest.approx(np.hypot(800.0, 100.0))
    assert metric.largest(1) == pytest.approx(1.0)
    off = metric.size(metric.project(np.array([[[1e-6, 0.0]]]), [0, 1]))
    assert off.max() == pytest.approx(np.hypot(800.0, 100.0) * 1e-6)
