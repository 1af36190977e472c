"""4–20 mA loops with their NE 43 limits, and straight lines."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from abbe.drivers.transducers import (
    TRANSDUCER_CONFIG,
    SensorFaultError,
    Transducer,
    TransducerFault,
    make_transducer,
)

LOOP = {"type": "current-loop", "at_4mA": -20.0, "at_20mA": 80.0, "unit": "degC"}


def make(**config: Any) -> Transducer:
    return make_transducer(TRANSDUCER_CONFIG.validate_python(config))


@pytest.mark.parametrize(
    ("current", "value"), [(4.0, -20.0), (12.0, 30.0), (20.0, 80.0), (3.8, -21.25), (20.5, 83.125)]
)
def test_the_line_holds_up_to_the_limits_of_measurement(current: float, value: float) -> None:
    assert make(**LOOP).value(current) == pytest.approx(value, abs=1e-12)
    assert make(**LOOP).inverse(value) == pytest.approx(current, abs=1e-12)
    assert make(**LOOP, scale=0.001).value(current * 1000) == pytest.approx(value, abs=1e-12)


@pytest.mark.parametrize(
    ("current", "fault"),
    [
        (0.0, TransducerFault.BROKEN_WIRE),
        (0.99, TransducerFault.BROKEN_WIRE),
        (3.5, TransducerFault.TRANSMITTER_ALARM),
        (3.6, TransducerFault.TRANSMITTER_ALARM),
        (3.7, TransducerFault.OUT_OF_RANGE),
        (3.7999, TransducerFault.OUT_OF_RANGE),
        (20.5001, TransducerFault.OUT_OF_RANGE),
        (20.9, TransducerFault.OUT_OF_RANGE),
        (21.0, TransducerFault.TRANSMITTER_ALARM),
        (24.0, TransducerFault.TRANSMITTER_ALARM),
        (float("nan"), TransducerFault.NOT_A_NUMBER),
    ],
)
def test_namur_limits(current: float, fault: TransducerFault) -> None:
    with pytest.raises(SensorFaultError) as caught:
        make(**LOOP).value(current)
    assert caught.value.fault is fault


def test_what_no_loop_can_carry_is_not_written() -> None:
    with pytest.raises(SensorFaultError, match=r"needs 22\.00 mA"):
        make(**LOOP).inverse(92.5)


@given(st.floats(-1e6, 1e6), st.floats(-100, 100).filter(lambda s: abs(s) > 1e-3))
def test_lines_invert(raw: float, scale: float) -> None:
    line = make(type="linear", scale=scale, offset=-7.5, unit="kg")
    assert line.unit == "kg"
    assert line.value(raw) == pytest.approx(scale * raw - 7.5)
    assert line.inverse(line.value(raw)) == pytest.approx(raw, abs=1e-6)


def test_a_line_s_limits_are_named() -> None:
    line = make(type="linear", scale=0.1, unit="degC", min=0.0, max=60.0)
    assert line.value(600) == pytest.approx(60.0)
    with pytest.raises(SensorFaultError, match=r"out of range: 60\.1 degC, above 60 degC"):
        line.value(601)
    with pytest.raises(SensorFaultError, match=r"out of range: -0\.1 degC, below 0 degC"):
        line.inverse(-0.1)


@pytest.mark.parametrize(
    ("config", "said"),
    [
        (LOOP | {"at_20mA": -20.0}, "no slope"),
        (LOOP | {"alarm_low": 3.9}, "expected 1 < alarm_low <= measure_low <= 4"),
        (LOOP | {"alarm_high": 20.1}, "expected 20 <= measure_high <= alarm_high"),
        ({"type": "linear", "unit": "kg", "scale": 0}, "scale is 0"),
        ({"type": "linear", "unit": "kg", "min": 2.0, "max": 1.0}, "must lie below max"),
        ({"type": "linear"}, "unit"),
    ],
)
def test_configurations_that_cannot_work_are_refused(config: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError) as caught:
        make(**config)
    assert said in str(caught.value)
