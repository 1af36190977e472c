"""What has changed, in readings that were made for it."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.monitoring.change import MachineChange, machine_change
from abbe.compcore.monitoring.charts import Alarm, ChartDesign, charted
from abbe.compcore.monitoring.expected import expect
from abbe.compcore.monitoring.readings import check_readings
from tests.support.compcore.checked_machine import ALPHA, DAY, checked_model, checks

PLACES = [
    (50.0, 60.0, -250.0),
    (450.0, 80.0, -40.0),
    (60.0, 420.0, -60.0),
    (430.0, 440.0, -260.0),
    (250.0, 240.0, -150.0),
    (240.0, 60.0, -30.0),
    (70.0, 250.0, -270.0),
]


def told(error, *, days: int = 60, after: int = 0, rotations: bool = False) -> MachineChange:
    """The description of what `error(day, place, warmth)` (µm, 3) does, some checks after alarm."""
    rng = np.random.default_rng(5)
    rows = []
    for day in range(days):
        warm = 20.0 + rng.normal()
        for p, place in enumerate(PLACES):
            e = error(day, np.array(place), warm) + 0.4 * rng.normal(size=3)
            e[0] += ALPHA * 1e3 * (warm - 20.0) * place[0]  # what the model knows
            for k in range(3):
                u = tuple(float(j == k) for j in range(3))
                rows.append(
                    {
                        "time": day * DAY + p,
                        "setup": f"ball{p}_{'XYZ'[k]}",
                        **dict(zip("XYZ", place, strict=True)),
                        "u": u,
                        "value": e[k],
                        "sd": 0.4,
                        "T_x": warm,
                        "kind": Kind.ROTATION if rotations else Kind.DISPLACEMENT,
                    }
                )
    names = dict.fromkeys((str(r["setup"]) for r in rows), ("zero",))
    campaign = checks(rows, free=names)
    model = checked_model(left_over=0.3)
    readings = check_readings(model, campaign)
    alarm = charted(expect(readings).charted, ChartDesign()).alarm
    assert alarm is not None
    known = check_readings(
        model, readings.campaign.rows(np.flatnonzero(readings.check <= alarm.check + after))
    )
    return machine_change(known, expect(known), alarm)


def test_a_crash_in_y_that_grows_with_x() -> None:
    found = told(lambda day, at, _: np.array([0.0, 0.02 * (at[0] - 250.0) * (day >= 40), 0.0]))
    assert (found.last_sound, found.first_changed, found.course) == (39, 40, "at once")
    (pattern,) = found.patterns
    assert (pattern.component, pattern.along, pattern.unit) == ("Y", "X", "mm")
    assert pattern.slope == pytest.approx(0.02, abs=3.0 * pattern.slope_sd)
    assert pattern.slope_sd < 0.002
    assert found.explained > 0.9


def test_a_step_that_is_the_same_everywhere() -> None:
    found = told(lambda day, at, _: np.array([0.0, 0.0, -6.0 * (day >= 30)]), after=3)
    (pattern,) = found.patterns
    assert (pattern.component, pattern.along) == ("Z", "")
    assert pattern.constant == pytest.approx(-6.0, abs=3.0 * pattern.constant_sd)
    assert found.first_changed == 30


def test_what_grows_from_day_to_day() -> None:
    found = told(
        lambda day, at, _: np.array([0.0006 * at[0] * max(0, day - 30), 0.0, 0.0]), after=15
    )
    assert found.course == "ever more"
    assert abs(found.first_changed - 31) <= 5
    pattern = found.patterns[0]
    assert (pattern.component, pattern.along) == ("X", "X")
    assert pattern.slope > 0.0


def test_what_hangs_on_a_temperature() -> None:
    found = told(
        lambda day, at, warm: np.array([0.0, 0.0, 5.0 * (warm - 20.0) * (day >= 30)]),
        days=80,
        after=12,
    )
    pattern = found.patterns[0]
    assert (pattern.component, pattern.along) == ("Z", "T_x")
    assert pattern.slope == pytest.approx(5.0, abs=4.0 * pattern.slope_sd)


def test_rotations() -> None:
    found = told(lambda day, at, _: np.array([0.0, 8.0 * (day >= 30), 0.0]), rotations=True)
    (pattern,) = found.patterns
    assert (pattern.component, pattern.along) == ("B", "")
    assert pattern.constant == pytest.approx(8.0, abs=1.0)


def test_what_nothing_simple_describes_is_not_described() -> None:
    def corner(day: int, at: np.ndarray, _: float) -> np.ndarray:
        # a product of both: its means along either axis are zero
        return np.array([0.0, 0.0, 1e-4 * (at[0] - 250.0) * (at[1] - 250.0) * (day >= 30)])

    found = told(corner, after=2)
    assert found.explained < 0.6


def test_a_single_check_cannot_have_changed() -> None:
    readings = check_readings(checked_model(), checks([{}]))
    with pytest.raises(ValueError, match="only one check"):
        machine_change(readings, expect(readings), Alarm(0, 0, "CUSUM", 1, 0))
