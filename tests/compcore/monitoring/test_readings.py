"""Check measurements as series beside the prediction: closed forms, what belongs together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.errors import InputError
from abbe.compcore.monitoring.readings import ONE_CHECK, check_readings
from tests.support.compcore.checked_machine import (
    ALPHA,
    ALPHA_SD,
    ANGLE,
    ANGLE_SD,
    DAY,
    checked_model,
    checks,
)


def test_residual_and_uncertainty_of_a_reading_in_closed_form() -> None:
    model = checked_model(left_over=0.4)
    row = {"X": 400.0, "Y": 100.0, "T_x": 23.0, "value": 15.0, "sd": 0.7}
    found = check_readings(model, checks([row]))
    assert found.residual == pytest.approx([15.0 - ALPHA * 3.0 * 400e3])
    assert found.sd == pytest.approx([0.7])
    # in X the squareness turns Y's lever: nothing at all of X's
    wide = np.hypot(ALPHA_SD * 3.0 * 400e3, 0.4)
    assert found.predicted_sd == pytest.approx([wide], rel=1e-6)
    square = {"X": 400.0, "u": (0.0, 1.0, 0.0)}
    (across,) = check_readings(model, checks([square])).residual
    assert abs(across) == pytest.approx(ANGLE * 400e3)
    (sure,) = check_readings(model, checks([square])).predicted_sd
    assert sure == pytest.approx(np.hypot(ANGLE_SD * 400e3, 0.4), rel=1e-6)


def test_rotations_are_microradians_of_their_own() -> None:
    row = {"X": 400.0, "kind": Kind.ROTATION, "u": (0.0, 0.0, 1.0), "value": 3.0, "sd": 0.5}
    found = check_readings(checked_model(), checks([row]))
    assert abs(found.residual[0] - 3.0) == pytest.approx(ANGLE * 1e6)
    assert found.predicted_sd == pytest.approx([ANGLE_SD * 1e6])
    assert found.series[0].unit == "µrad"


def test_readings_of_an_hour_are_one_check_whatever_their_order() -> None:
    times = [2 * DAY, 0.0, 100.0, ONE_CHECK - 1.0, DAY, DAY + ONE_CHECK]
    found = check_readings(checked_model(), checks([{"time": t} for t in times]))
    assert found.check.tolist() == [0, 0, 0, 1, 2, 3]
    assert found.times.tolist() == [0.0, DAY, DAY + ONE_CHECK, 2 * DAY]


def test_readings_many_minutes_apart_do_not_chain_into_one_check() -> None:
    found = check_readings(checked_model(), checks([{"time": 600.0 * k} for k in range(18)]))
    assert np.bincount(found.check).tolist() == [6, 6, 6]


def test_series_are_places_directions_and_kinds_and_not_placings() -> None:
    rows = [
        {"setup": "ball", "X": 100.0, "u": (1.0, 0.0, 0.0)},
        {"setup": "ball", "X": 100.003, "u": (0.0, 1.0, 0.0)},
        {"setup": "line@monday", "X": 0.0, "time": 1.0},
        {"setup": "line@monday", "X": 200.0, "time": 2.0},
        {"setup": "ball", "X": 99.996, "u": (1.0, 0.0, 0.0), "time": DAY},
        {"setup": "line@tuesday", "X": 200.0, "time": DAY + 1.0},
    ]
    found = check_readings(checked_model(), checks(rows))
    names = [s.name for s in found.series]
    assert names == ["ball in X", "ball in Y", "line in X at X 0", "line in X at X 200"]
    assert found.of.tolist() == [0, 1, 2, 3, 0, 3]


def test_many_places_on_a_line_are_taken_together_with_their_neighbours() -> None:
    rows = [{"setup": "line", "X": 5.0 * k, "time": float(k)} for k in range(100)]
    rows += [{"setup": "ball", "X": 10.0, "u": (0.0, 1.0, 0.0), "time": 200.0}]
    found = check_readings(checked_model(), checks(rows))
    assert len(found.series) <= 48
    of = found.of[:100]
    assert (np.diff(of) >= 0).all()
    assert np.bincount(of).max() <= 4
    assert found.series[found.of[100]].setup == "ball"
    assert (found.of == found.of[100]).sum() == 1


def test_the_model_need_not_have_a_covariance() -> None:
    found = check_readings(checked_model(covariance=False), checks([{"X": 100.0}]))
    assert found.influence.shape == (1, 0)
    assert found.predicted_sd.tolist() == [0.0]


def test_placings_are_unknowns_of_their_rows() -> None:
    rows = [{"setup": "a", "X": 1.0}, {"setup": "b", "X": 100.0}, {"setup": "a", "time": DAY}]
    found = check_readings(checked_model(), checks(rows, free={"a": ("zero",)}))
    (block,) = found.placings
    assert (block.setup, block.rows.tolist()) == ("a", [0, 2])
    assert block.columns.tolist() == [[1e3], [1e3]]


def test_a_distance_is_refused_with_its_line() -> None:
    with pytest.raises(InputError, match=r"line 3.*distance.*displacement or rotation"):
        check_readings(checked_model(), checks([{}, {"kind": Kind.DISTANCE}]))


def test_a_signal_that_the_model_needs_must_be_there() -> None:
    campaign = checks([{}])
    bare = replace(campaign, conditions=replace(campaign.conditions, signals={}))
    with pytest.raises(InputError, match="T_x"):
        check_readings(checked_model(), bare)
