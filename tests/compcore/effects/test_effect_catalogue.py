"""Every effect of the catalogue, by one table: a kind without a row fails the suite."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from abbe.compcore.effects import effect_class, effect_kinds, make_effect
from abbe.compcore.effects.base import INSTRUMENT, Effect
from abbe.compcore.files.model_file import format_model, parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.catalogue import ROWS, Row, conditions, world

BUILT_IN = [k for k, cls in effect_kinds().items() if cls.__module__.startswith("abbe.compcore.")]
IDS = [row.label for row in ROWS]


def make(row: Row) -> Effect:
    effect = make_effect(row.kind, row.keys)
    effect.check(row.machine)
    return effect


def motions_of(row: Row, w, nonlinear=None) -> dict[str, np.ndarray]:
    effect = make(row)
    p = np.array([row.linear[q.name] for q in effect.linear(row.machine)])
    found: dict[str, np.ndarray] = {}
    for motion in effect.motions(row.machine, conditions(w), nonlinear or row.nonlinear):
        count = motion.columns.shape[1]
        value = motion.columns @ p[motion.first : motion.first + count]
        name = str(motion.error_motion)
        found[name] = found.get(name, 0.0) + value
    return found


def test_every_kind_has_a_row():
    # what is measured, not fitted, has tests of its own: test_error_grid, test_two_drives
    assert {row.kind for row in ROWS} | {"error_grid", "two_drives"} == set(BUILT_IN)
    assert len(BUILT_IN) == 50


@pytest.mark.parametrize("row", ROWS, ids=IDS)
def test_values_are_those_of_the_independent_formula(row):
    w = world(row.machine)
    found, truth = motions_of(row, w), row.truth(w)
    assert set(found) == set(truth)
    for channel, value in truth.items():
        scale = np.abs(value).max()
        assert scale > 0.0
        # Edlén stands in for Ciddor, a cosine for its parabola
        loose = row.kind in ("dead_path", "air_refraction", "cosine")
        tolerance = 1e-3 if loose else 1e-12
        np.testing.assert_allclose(found[channel], value, atol=tolerance * scale, rtol=0.0)


@pytest.mark.parametrize(
    "row", [r for r in ROWS if not make(r).signals_needed()], ids=lambda r: r.label
)
def test_what_reads_no_signal_changes_with_the_hour_where_it_says_so(row):
    early, late = world(row.machine), world(row.machine)
    late.t[:] = late.t + 5000.0
    before, after = motions_of(row, early), motions_of(row, late)
    same = all(np.array_equal(before[name], after[name]) for name in before)
    assert same != make(row).reads_time()


def test_a_formula_reads_the_time_where_a_term_names_it():
    def formula(*terms: str) -> Effect:
        return make_effect("formula", {"channel": "E_XX", "terms": terms})

    assert formula("X", "X*t").reads_time()
    assert not formula("X", "lag(T_x, 60) - T0").reads_time()


@pytest.mark.parametrize("row", ROWS, ids=IDS)
def test_columns_have_the_shapes_and_parameters_that_they_declare(row):
    effect = make(row)
    linear, nonlinear = effect.linear(row.machine), effect.nonlinear(row.machine)
    assert {p.name for p in linear} == set(row.linear)
    assert {p.name for p in nonlinear} == set(row.nonlinear)
    w = world(row.machine)
    covered = np.zeros(len(linear), dtype=int)
    for motion in effect.motions(row.machine, conditions(w), row.nonlinear):
        n, k = motion.columns.shape
        assert n == len(w.t)
        assert np.isfinite(motion.columns).all()
        covered[motion.first : motion.first + k] += 1
    assert effect.reads_model or (covered > 0).all()
    for p in (*linear, *nonlinear):
        assert p.plausible[0] < p.plausible[1]
        assert p.description
        assert p.unit
    for p in linear:
        assert p.plausible[0] <= row.linear[p.name] <= p.plausible[1], "the table is plausible"
    for p in nonlinear:
        assert p.bounds[0] < p.bounds[1]
        assert len(p.starts) >= 3
        assert all(p.bounds[0] <= s <= p.bounds[1] for s in p.starts)
        assert p.bounds[0] <= row.nonlinear[p.name] <= p.bounds[1]


@pytest.mark.parametrize("row", ROWS, ids=IDS)
def test_columns_depend_on_nothing_else_than_they_say(row):
    effect = make(row)
    w, other = world(row.machine), world(row.machine, seed=8)
    positions = effect.positions_used(row.machine)
    directions = effect.directions_used()
    signals = effect.signals_needed() or (effect.air(row.machine) if hasattr(effect, "air") else ())
    instrument = effect.scope == "instrument"
    mixed = type(w)(
        q=w.q if instrument else {a: w.q[a] if a in positions else other.q[a] for a in w.q},
        s={a: w.s[a] if a in directions else other.s[a] for a in w.s},
        T={k: w.T[k] if k in signals else other.T[k] for k in w.T},
        t=w.t,
        tool=w.tool if effect.reads_tool or instrument else other.tool,
        u=w.u if instrument else other.u,
        setup=w.setup,
        kind=w.kind,
        base=w.base,
        distance=w.distance,
    )
    one, two = motions_of(row, w), motions_of(row, mixed)
    for channel in one:
        np.testing.assert_array_equal(one[channel], two[channel])


AMENDING = ("sensor_offset", "sensor_gain", "sensor_bend")
"""Kinds that act through other effects."""


@pytest.mark.parametrize("row", [r for r in ROWS if r.kind not in AMENDING], ids=lambda r: r.label)
def test_columns_depend_on_all_that_they_say(row):
    effect = make(row)
    if effect.scope == "instrument":
        return
    w, other = world(row.machine), world(row.machine, seed=8)

    def differs(**changed) -> bool:
        mixed = type(w)(**{**{k: getattr(w, k) for k in w.__dataclass_fields__}, **changed})
        one, two = motions_of(row, w), motions_of(row, mixed)
        return any(not np.array_equal(one[c], two[c]) for c in one)

    for axis in effect.positions_used(row.machine):
        assert differs(q={**w.q, axis: other.q[axis]}), axis
    for axis in effect.directions_used():
        assert differs(s={**w.s, axis: other.s[axis]}), axis
    for signal in effect.signals_needed():
        assert differs(T={**w.T, signal: other.T[signal]}), signal
    assert not effect.reads_tool or differs(tool=other.tool)


@pytest.mark.parametrize("row", ROWS, ids=IDS)
def test_slopes_jump_at_the_kinks_only(row):
    effect = make(row)
    kinks = effect.kinks(row.machine)
    assert set(kinks) <= set(effect.positions_used(row.machine))
    w = world(row.machine)
    fixed = conditions(w).rows(np.full(1, 5))
    for name in effect.positions_used(row.machine):
        if effect.reads_tool:
            continue
        low, high = row.machine.axis(name).travel
        margin = 0.05 * (high - low)

        def bends(count: int, name=name, low=low, high=high, margin=margin) -> float:
            x = np.linspace(low - margin, high + margin, count)
            at = fixed.rows(np.zeros(count, dtype=np.int64)).moved({name: x - w.q[name][5]})
            largest = 0.0
            for motion in effect.motions(row.machine, at, row.nonlinear):
                size = np.abs(motion.columns).max(axis=0)
                size[size < 1e-14] = np.inf  # rounding
                second = np.abs(np.diff(motion.columns / size, 2, axis=0)).max(axis=1)
                near = np.zeros(count - 2, dtype=bool)
                for kink in kinks.get(name, ()):
                    near |= np.abs(x[1:-1] - kink) < 2.0 * (x[1] - x[0])
                largest = max(largest, float(second[~near].max(initial=0.0)))
            return largest

        coarse, fine = bends(4001), bends(8001)
        # second differences fall fourfold where the slope is continuous, twofold where it jumps
        assert fine < 1e-9 or fine < 0.35 * coarse, name


@pytest.mark.parametrize("row", ROWS, ids=IDS)
def test_a_spec_makes_the_same_effect_again(row):
    effect = make(row)
    kind, *pairs = effect.spec.split(" ")
    assert kind == row.kind
    assert make_effect(kind, dict(p.split("=", 1) for p in pairs)) == effect
    assert make_effect(kind, effect.where()) == effect


@pytest.mark.parametrize("row", ROWS, ids=IDS)
def test_a_model_file_gives_back_the_effect_and_its_values(row):
    values = {k: Value(v, abs(v) * 0.1) for k, v in {**row.linear, **row.nonlinear}.items()}
    model = Model(row.machine, (Term(make(row), values),))
    assert parse_model(TomlSource(format_model(model))) == model


FITTED = [r for r in ROWS if r.kind not in (*AMENDING, "air_refraction", "dead_path", "cosine")]


@pytest.mark.parametrize("row", FITTED, ids=lambda r: r.label)
def test_simulated_and_recovered(row):
    """The reference's motions, seen as displacements and angles: the fit finds the parameters."""
    effect, w = make(row), world(row.machine)
    at = conditions(w)
    chain = Chain(row.machine, at)
    linear = effect.linear(row.machine)

    def seen(channel) -> np.ndarray:
        if channel.place == INSTRUMENT:
            return np.ones(at.n)
        moved, turned = chain.influence(channel)
        angle = w.kind == 1
        return np.where(
            angle, 1000.0 * np.einsum("ni,ni->n", turned, w.u), np.einsum("ni,ni->n", moved, w.u)
        )

    def matrix(nonlinear) -> np.ndarray:
        out = np.zeros((at.n, len(linear)))
        for motion in effect.motions(row.machine, at, nonlinear):
            k = motion.columns.shape[1]
            part = slice(motion.first, motion.first + k)
            out[:, part] += seen(motion.error_motion)[:, None] * motion.columns
        return out

    channels = {
        str(m.error_motion): m.error_motion for m in effect.motions(row.machine, at, row.nonlinear)
    }
    value = sum(seen(channels[name]) * motion for name, motion in row.truth(w).items())

    def solve(x):
        nonlinear = dict(zip(names, x, strict=True))
        a = matrix(nonlinear)
        p = np.linalg.lstsq(a, value, rcond=None)[0]
        return p, (a @ p - value) / np.abs(value).max()

    parameters = effect.nonlinear(row.machine)
    names = [p.name for p in parameters]
    starts = np.meshgrid(*(p.starts for p in parameters), indexing="ij")
    tried = np.stack([s.ravel() for s in starts], axis=1) if names else np.zeros((1, 0))
    best = min(tried, key=lambda x: float(np.sum(solve(x)[1] ** 2)))
    if names and all(p.smooth for p in parameters):
        scale = np.abs(best)
        bounds = np.array([p.bounds for p in parameters]).T / scale
        best = (
            scale
            * least_squares(
                lambda x: solve(x * scale)[1],
                np.clip(best / scale, *bounds),
                bounds=bounds,
                xtol=1e-15,
                ftol=1e-15,
                gtol=1e-15,
            ).x
        )
    if all(p.smooth for p in parameters):
        for name, x in zip(names, best, strict=True):
            assert x == pytest.approx(row.nonlinear[name], rel=1e-5)
        found = solve(best)[0]
        for p, x in zip(linear, found, strict=True):
            assert x == pytest.approx(row.linear[p.name], rel=1e-5), p.name
    else:
        # the moment of a step: within the spacing of the starts
        gap = np.diff(parameters[0].starts).max()
        assert abs(best[0] - row.nonlinear[names[0]]) <= gap


@pytest.mark.parametrize("kind", BUILT_IN)
def test_the_docstring_is_a_page_of_the_handbook(kind):
    text = effect_class(kind).__doc__ or ""
    lines = text.splitlines()
    assert lines[0].endswith((".", ")"))
    titles = ["Formula", "Parameters", "Signals", "Typical causes", "Cure", "Source"]
    found = [line.strip() for line in lines if line.startswith("    ") and line.strip() in titles]
    assert found == titles
    page = {}
    for line in lines:
        if line.strip() in titles and line.startswith("    ") and not line.startswith("     "):
            page[current := line.strip()] = ""
        elif page:
            page[current] += line.strip(" -")
    assert all(len(body) > 3 for body in page.values())
