"""Charts of several series: hand-worked courses, rates of false alarms, gaps."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.monitoring.charts import ChartDesign, charted
from abbe.compcore.monitoring.run_length import cusum_run_length, ewma_run_length

DESIGN = ChartDesign(false_alarm_every=50.0)


def test_a_course_worked_out_by_hand() -> None:
    values = np.array([[1.5], [0.5], [-3.0], [2.0]])
    found = charted(values, ChartDesign(false_alarm_every=1000.0))
    assert found.upper[:, 0].tolist() == [0.5, 0.0, 0.0, 1.0]
    assert found.lower[:, 0].tolist() == [0.0, 0.0, 2.0, 0.0]
    means = [0.15, 0.185, -0.1335, 0.07985]
    assert found.ewma[:, 0] == pytest.approx(np.array(means) / np.sqrt(0.1 / 1.9))
    assert found.alarm is None


def test_what_was_not_read_leaves_the_charts_as_they_are() -> None:
    rng = np.random.default_rng(1)
    z = rng.normal(size=30)
    gaps = np.full((60, 1), np.nan)
    gaps[::2, 0] = z
    with_gaps, without = charted(gaps, DESIGN), charted(z[:, None], DESIGN)
    for name in ("ewma", "upper", "lower"):
        assert np.array_equal(getattr(with_gaps, name)[::2], getattr(without, name))
        assert np.array_equal(getattr(with_gaps, name)[1::2], getattr(without, name))


def test_an_alarm_names_check_series_side_and_since_when() -> None:
    values = np.zeros((12, 3))
    values[6:, 1] = -2.5
    found = charted(values, DESIGN).alarm
    assert found is not None
    assert (found.series, found.sign, found.since) == (1, -1, 6)
    # the sum grows by 1.5 a check
    limit = DESIGN.limits(3)[1]
    assert found.check == 6 + int(limit // 1.5)
    assert found.chart == "CUSUM"


def test_slow_moves_are_told_by_the_ewma() -> None:
    design = ChartDesign(false_alarm_every=2000.0)
    found = charted(np.full((60, 1), 0.9), design).alarm
    assert found is not None
    assert (found.chart, found.sign, found.since) == ("EWMA", 1, 0)


def test_the_limits_share_the_rate_among_all_charts() -> None:
    for series in (1, 4, 20):
        ewma, cusum = DESIGN.limits(series)
        each = 50.0 * 2 * series
        assert ewma_run_length(DESIGN.weight, ewma) == pytest.approx(each, rel=1e-5)
        assert cusum_run_length(DESIGN.reference, cusum) == pytest.approx(each, rel=1e-5)


@pytest.mark.parametrize("alike", [0.0, 0.9])
def test_a_sound_machine_is_accused_no_more_often_than_stated(alike: float) -> None:
    rng = np.random.default_rng(3)
    lengths = []
    for _ in range(150):
        common = rng.normal(size=(150, 1))
        z = np.sqrt(1.0 - alike) * rng.normal(size=(150, 4)) + np.sqrt(alike) * common
        alarm = charted(z, ChartDesign(false_alarm_every=15.0)).alarm
        lengths.append(150 if alarm is None else alarm.check + 1)
    # 150 runs of 15 on average are off by 1.2 by chance
    assert np.mean(lengths) > 15.0 - 3 * 1.2


def test_detection_is_no_slower_than_stated() -> None:
    rng = np.random.default_rng(4)
    for shift in (1.0, 2.0, 4.0):
        lengths = []
        for _ in range(100):
            z = rng.normal(size=(60, 4))
            z[:, 2] += shift
            alarm = charted(z, ChartDesign(500.0)).alarm
            assert alarm is not None
            lengths.append(alarm.check + 1)
        error = np.std(lengths) / np.sqrt(len(lengths))
        assert np.mean(lengths) < ChartDesign(500.0).detects_within(4, shift) + 3.0 * error


def test_how_full_a_chart_is() -> None:
    rng = np.random.default_rng(6)
    found = charted(rng.normal(size=(400, 2)) + 0.8, DESIGN)
    assert found.alarm is not None
    full = found.fullness
    assert (full[: found.alarm.check] <= 1.0).all()
    assert full[found.alarm.check].max() > 1.0
    assert int(full[found.alarm.check].argmax()) == found.alarm.series


def test_charts_without_a_series() -> None:
    assert charted(np.zeros((5, 0)), DESIGN).alarm is None
    with pytest.raises(ValueError, match="expected 1 or more"):
        DESIGN.limits(0)
