from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from abbe.compcore.machine.lag import LagState, first_order_lag


def test_ramp_has_its_closed_form():
    # T = 20 + r·t from equilibrium: y = 20 + r·(t − τ·(1 − exp(−t/τ)))
    tau, rate = 600.0, 2e-3
    t = np.linspace(0.0, 4000.0, 37)
    y = first_order_lag(t, 20.0 + rate * t, tau)
    np.testing.assert_allclose(y, 20.0 + rate * (t - tau * (1.0 - np.exp(-t / tau))), atol=1e-12)


def test_step_decays_exponentially():
    tau, jump = 100.0, 1e-9
    t = np.concatenate([[0.0, jump], jump + np.linspace(1.0, 900.0, 50)])
    y = first_order_lag(t, np.where(t > 0.0, 21.0, 20.0), tau)
    np.testing.assert_allclose(y[1:], 21.0 - np.exp(-t[1:] / tau), atol=1e-10)


def test_constant_stays():
    t = np.array([0.0, 1.0, 1e6, 1e6 + 1e-3])
    np.testing.assert_allclose(first_order_lag(t, np.full(4, 23.5), 50.0), 23.5, atol=1e-9)


@pytest.mark.parametrize("tau", [0.5, 30.0, 5000.0])
def test_irregular_spacing_against_an_ode_solver(tau):
    rng = np.random.default_rng(4)
    t = np.sort(rng.uniform(0.0, 300.0, 25))
    t[0] = 0.0
    value = rng.uniform(18.0, 25.0, 25)
    got = first_order_lag(t, value, tau)
    for i in range(len(t) - 1):  # piece by piece: the input has kinks
        solved = solve_ivp(
            lambda s, y: (np.interp(s, t, value) - y) / tau,
            (t[i], t[i + 1]),
            [got[i]],
            method="LSODA",
            rtol=1e-11,
            atol=1e-11,
        )
        assert solved.y[0, -1] == pytest.approx(got[i + 1], abs=1e-8)


def test_rows_in_any_order_and_rows_of_one_time_alike():
    rng = np.random.default_rng(1)
    t = rng.uniform(0.0, 100.0, 30)
    value = 20.0 + 0.1 * t
    order = rng.permutation(30)
    np.testing.assert_array_equal(
        first_order_lag(t[order], value[order], 12.0), first_order_lag(t, value, 12.0)[order]
    )
    doubled = first_order_lag(np.repeat(t, 2), np.repeat(value, 2), 12.0)
    np.testing.assert_array_equal(doubled[::2], doubled[1::2])


def test_steps_of_hundreds_of_time_constants_stay_finite():
    t = np.array([0.0, 1.0, 1e5, 1e5 + 1.0, 3e5])
    y = first_order_lag(t, np.array([20.0, 21.0, 22.0, 23.0, 24.0]), 1.0)
    assert np.isfinite(y).all()
    # long after any change the lagged value trails a ramp by slope·τ
    assert y[-1] == pytest.approx(24.0 - 1.0 / (2e5 - 1.0), abs=1e-9)


@given(
    st.lists(st.tuples(st.floats(0.0, 2e4), st.floats(-40.0, 90.0)), min_size=1, max_size=40),
    st.floats(1.0, 2e4),
)
def test_sample_by_sample_equals_the_batch(steps, tau):
    t = np.cumsum([dt for dt, _ in steps])
    value = np.array([v for _, v in steps])
    state = LagState(tau)
    live = np.array([state.step(float(a), float(b)) for a, b in zip(t, value, strict=True)])
    np.testing.assert_allclose(live, first_order_lag(t, value, tau), rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("step", [2.2250738585072014e-308, 1e-200, 1e-16, 1e-13, 1e-9])
def test_a_sample_at_almost_the_same_time_hardly_moves_the_lag(step):
    state = LagState(4.0)
    state.step(0.0, 20.0)
    assert state.step(step, 90.0) == pytest.approx(20.0 + 35.0 * step / 4.0, abs=1e-12)
    y = first_order_lag(np.array([0.0, step]), np.array([20.0, 90.0]), 4.0)
    assert y[1] == pytest.approx(20.0 + 35.0 * step / 4.0, abs=1e-12)


@given(st.floats(-40.0, 90.0), st.floats(1e-3, 1e4), st.floats(1.0, 2e4))
def test_a_signal_that_stands_still_changes_nothing_to_the_last_digit(value, step, tau):
    state = LagState(tau)
    for k in range(5):
        assert state.step(step * k, value) == value


def test_a_late_or_repeated_sample_changes_nothing():
    state = LagState(10.0)
    assert state.step(0.0, 20.0) == 20.0
    after = state.step(5.0, 22.0)
    assert state.step(5.0, 99.0) == after
    assert state.step(4.0, 99.0) == after
    assert state.time == 5.0
    assert state.value == 22.0


def test_one_sample_is_equilibrium():
    assert first_order_lag(np.array([7.0]), np.array([21.5]), 3.0).tolist() == [21.5]
