"""What checks are expected to read: against dense algebra; standard normal where it is sound."""

from __future__ import annotations

import math

import numpy as np
import pytest

from abbe.compcore.monitoring import expected as module
from abbe.compcore.monitoring import scatter
from abbe.compcore.monitoring.charts import ChartDesign, charted
from abbe.compcore.monitoring.expected import WILD, expect
from abbe.compcore.monitoring.readings import check_readings
from abbe.compcore.monitoring.scatter import HYPOTHESES, Scatter, Weighing, quantiles
from tests.support.compcore.checked_machine import (
    ALPHA,
    ALPHA_SD,
    ANGLE,
    ANGLE_SD,
    DAY,
    checked_model,
    checks,
)


def only(monkeypatch: pytest.MonkeyPatch, *one: Scatter) -> None:
    """Let there be only these hypotheses, of one duration."""
    for where in (scatter, module):
        monkeypatch.setattr(where, "HYPOTHESES", one)
    monkeypatch.setattr(scatter, "_KINDS", np.ones((1, len(one))))


@pytest.mark.parametrize("lasts", [0.0, 2.0 * DAY])
def test_one_place_in_changing_warmth_as_dense_algebra_has_it(monkeypatch, lasts: float) -> None:
    only(monkeypatch, Scatter(1.5, lasts, 1.0))
    rng = np.random.default_rng(2)
    n, sd, left_over = 30, 0.8, 0.6
    time = np.cumsum(rng.uniform(0.5, 5.0, n)) * DAY
    warm = 20.0 + rng.normal(size=n)
    value = rng.normal(size=n) * 1.5 + 5.0 + ALPHA * 450e3 * (warm - 20.0)
    rows = [
        {"time": t, "X": 450.0, "T_x": w, "value": v, "sd": sd}
        for t, w, v in zip(time, warm, value, strict=True)
    ]
    z = expect(check_readings(checked_model(left_over=left_over), checks(rows))).standardised[:, 0]

    gap = np.abs(time[:, None] - time[None, :])
    seen = ALPHA_SD * 450e3 * (warm - 20.0)
    lasting = np.exp(-gap / lasts) if lasts else np.eye(n)
    covariance = (
        np.outer(seen, seen)
        + (module._APART * math.hypot(sd, left_over)) ** 2
        + (module._WANDERS * left_over) ** 2 * np.exp(-gap / module._SEASON)
        + (1.5 * sd) ** 2 * lasting
        + sd**2 * np.eye(n)
    )
    residual = value - ALPHA * 450e3 * (warm - 20.0)
    innovations = np.linalg.solve(np.linalg.cholesky(covariance), residual)
    assert np.abs(innovations).max() < WILD
    assert z == pytest.approx(innovations, abs=1e-6)


def test_a_line_whose_laser_is_placed_anew_loses_one_reading_each_time(monkeypatch) -> None:
    only(monkeypatch, Scatter(0.0, 0.0, 1.0))
    rng = np.random.default_rng(3)
    places, sd = np.array([0.0, 200.0, 400.0]), 0.5
    rows, residuals = [], []
    for day in range(8):
        zero = rng.normal() * 50.0
        noise = sd * rng.normal(size=3)
        residuals.append(zero + noise)
        rows += [
            {"time": day * DAY + k, "setup": f"line@{day}", "X": x, "value": zero + e, "sd": sd}
            for k, (x, e) in enumerate(zip(places, noise, strict=True))
        ]
    free = {f"line@{day}": ("zero",) for day in range(8)}
    found = expect(check_readings(checked_model(covariance=False), checks(rows, free=free)))
    # every check reads three places and knows two differences: projected by hand
    level, spread = np.zeros(3), np.eye(3) * (module._APART * sd) ** 2
    for day, value in enumerate(residuals):
        ahead = value - level
        s = spread + sd**2 * np.eye(3) + module._ANYWHERE**2 * np.ones((3, 3))
        z = ahead / np.sqrt(np.diag(s))
        assert found.standardised[day] == pytest.approx(z, abs=1e-4)
        gain = spread @ np.linalg.inv(s)
        level, spread = level + gain @ ahead, spread - gain @ spread


def machines(count: int, checks_each: int, seed: int = 7) -> np.ndarray:
    """Standardised checks of sound machines that their models miss by what these state, (k, n, 2).

    Two places far apart, read in Y and in X, on days that are 1 K colder or warmer.
    """
    rng = np.random.default_rng(seed)
    model = checked_model(left_over=0.5)
    out = []
    for _ in range(count):
        angle = ANGLE + ANGLE_SD * rng.normal()
        alpha = ALPHA + ALPHA_SD * rng.normal()
        left = 0.5 * rng.normal(size=2)
        rows = []
        for day in range(checks_each):
            warm = 20.0 + rng.normal()
            e = 0.7 * rng.normal(size=2) + 0.7 * rng.normal(size=2)
            in_x = alpha * 400e3 * (warm - 20.0) + left[0] + e[0]
            # the sign with which the angle acts is the model's
            turn = float(_SIGN * angle * 400e3) + left[1] + e[1]
            at = {"time": day * DAY, "X": 400.0, "T_x": warm, "sd": 0.7}
            rows += [{**at, "value": in_x}, {**at, "value": turn, "u": (0.0, 1.0, 0.0)}]
        out.append(expect(check_readings(model, checks(rows))).standardised)
    return np.array(out)


def _sign() -> float:
    (residual,) = check_readings(
        checked_model(), checks([{"X": 400.0, "u": (0.0, 1.0, 0.0)}])
    ).residual
    return -math.copysign(1.0, residual)


_SIGN = _sign()


def test_sound_checks_are_standard_normal_and_independent_from_the_second_on() -> None:
    z = machines(30, 20)[:, 1:]
    # 30 × 19 × 2 values; hypotheses that are not true make the first a little broad or narrow
    assert abs(z.mean()) < 0.1
    assert z.std() == pytest.approx(1.0, abs=0.08)
    assert abs((z[:, 1:] * z[:, :-1]).mean()) < 0.12
    assert np.quantile(np.abs(z), 0.997) < 3.6


def test_a_model_that_is_wrong_from_the_first_check_on_is_no_machine_that_has_changed() -> None:
    rng = np.random.default_rng(8)
    rows = [
        {"time": k * DAY, "X": 400.0, "value": 6.0 + rng.normal(), "sd": 0.7} for k in range(60)
    ]
    found = expect(check_readings(checked_model(left_over=0.5), checks(rows)))
    assert charted(found.charted, ChartDesign()).alarm is None


def course(*, deviates: float, lasts: float, seed: int, n: int = 250) -> np.ndarray:
    """Readings of six places that deviate for days, µm, (n, 6); 1 µm of noise besides."""
    rng = np.random.default_rng(seed)
    stays = math.exp(-1.0 / lasts) if lasts else 0.0
    a = rng.normal(size=(n, 6))
    for k in range(1, n):
        a[k] = stays * a[k - 1] + math.sqrt(1.0 - stays**2) * a[k]
    return deviates * a + rng.normal(size=(n, 6))


def alarm_of(y: np.ndarray):
    rows = [
        {"time": k * DAY, "setup": f"p{i}", "X": 60.0 * i, "value": v}
        for k, values in enumerate(y)
        for i, v in enumerate(values)
    ]
    model = checked_model(left_over=0.3, covariance=False)
    return charted(expect(check_readings(model, checks(rows))).charted, ChartDesign()).alarm


@pytest.mark.parametrize(
    ("deviates", "lasts"), [(0.0, 0.0), (1.0, 0.0), (4.0, 0.0), (1.5, 2.0), (1.5, 6.0)]
)
def test_no_alarm_in_a_year_however_a_sound_machine_scatters(deviates, lasts) -> None:
    assert alarm_of(course(deviates=deviates, lasts=lasts, seed=11)) is None


@pytest.mark.parametrize("size", [5.0, 8.0, 30.0])
def test_a_change_is_told_within_a_few_checks(size: float) -> None:
    y = course(deviates=1.0, lasts=0.0, seed=12, n=100)
    y[60:, 2] += size
    found = alarm_of(y)
    assert found is not None
    assert (found.series, found.sign) == (2, 1)
    # noise of 1.4 µm: the fewer, the larger; two at least, for one wild reading is none
    assert 61 <= found.check <= (62 if size > 6.0 else 66)


def test_one_wild_reading_is_no_changed_machine() -> None:
    y = course(deviates=1.0, lasts=0.0, seed=13, n=100)
    y[40, 1] += 200.0
    assert alarm_of(y) is None


def test_places_that_are_read_now_and_then() -> None:
    rng = np.random.default_rng(14)
    rows = [
        {"time": day * DAY, "setup": f"p{day % 3}", "value": rng.normal() + day % 3}
        for day in range(40)
    ]
    found = expect(check_readings(checked_model(), checks(rows)))
    read = np.isfinite(found.standardised)
    assert read.sum() == len(rows)
    assert (read.sum(axis=1) == 1).all()
    assert np.array_equal(read, np.isfinite(found.sd))
    assert charted(found.charted, ChartDesign()).alarm is None


def test_the_mixture_of_one_hypothesis_is_itself() -> None:
    z = np.array([[-3.0, 0.0, 0.5, 9.0, -20.0]])
    assert quantiles(np.ones((1, 5)), z) == pytest.approx(z[0], abs=1e-9)


def test_the_chances_of_the_hypotheses_are_chances() -> None:
    assert sum(h.chance for h in HYPOTHESES) == pytest.approx(1.0)
    weights = Weighing(3).weights()
    assert weights.sum(axis=0) == pytest.approx(np.ones(3))
    assert weights[:, 0] == pytest.approx([h.chance for h in HYPOTHESES])
