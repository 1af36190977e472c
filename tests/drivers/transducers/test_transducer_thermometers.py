"""Thermistors, tables and platinum sensors against published figures; faults are named."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from abbe.drivers.link import Quality, Sample
from abbe.drivers.transducers import (
    TRANSDUCER_CONFIG,
    SensorFaultError,
    Transducer,
    TransducerFault,
    make_transducer,
)

YSI = {"type": "steinhart-hart", "a": 1.032e-3, "b": 2.387e-4, "c": 1.580e-7, "r25": 1e4}
ARDUINO = {
    "type": "steinhart-hart",
    "a": 1.009249522e-3,
    "b": 2.378405444e-4,
    "c": 2.019202697e-7,
}
RATIO = {
    "type": "ntc-ratio",
    "r25": 1e4,
    "a": 3.3539438e-3,
    "b": 2.5646095e-4,
    "c": 2.5158166e-6,
    "d": 1.0503069e-7,
}
PT100 = {"type": "pt", "r0": 100.0}


def make(**config: Any) -> Transducer:
    return make_transducer(TRANSDUCER_CONFIG.validate_python(config))


@pytest.mark.parametrize(
    ("config", "ohms", "celsius", "tolerance"),
    [
        (YSI, 29490, 0.007, 5e-4),
        (YSI, 10000, 25.005, 5e-4),
        (YSI, 3893, 49.995, 5e-4),
        (ARDUINO, 10000, 24.68, 5e-3),
        (RATIO, 32650, -0.008, 5e-4),
        (RATIO, 10000, 25.006, 5e-4),
        (RATIO, 3605, 49.973, 5e-4),
        ({"type": "beta", "r25": 1e4, "beta": 3435}, 4160, 49.57, 5e-3),
        ({"type": "beta", "r25": 1e4, "beta": 3950}, 4160, 46.14, 5e-3),
        ({"type": "beta", "r25": 1e4, "beta": 3950}, 1e4, 25.0, 1e-9),
        (PT100, 107.7935, 20.0, 1e-4),
        (PT100, 138.5055, 100.0, 1e-4),
        (PT100, 100.0, 0.0, 1e-12),
        # IEC 60751's table: R(-100 °C) = 60.26 Ω, R(-190 °C) = 22.83 Ω, R(850 °C) = 390.48 Ω.
        (PT100, 60.26, -100.0, 0.02),
        (PT100, 22.83, -190.0, 0.02),
        (PT100, 390.48, 850.0, 0.02),
        ({"type": "pt", "r0": 1000.0}, 1077.935, 20.0, 1e-4),
    ],
)
def test_published_figures(
    config: dict[str, Any], ohms: float, celsius: float, tolerance: float
) -> None:
    assert make(**config).value(ohms) == pytest.approx(celsius, abs=tolerance)


def test_platinum_below_zero_solves_the_equation_itself() -> None:
    pt = make(**PT100)
    for i in range(-1999, 0):
        t = i / 10
        ratio = 1 + 3.9083e-3 * t - 5.775e-7 * t**2 - 4.183e-12 * (t - 100) * t**3
        assert pt.value(100 * ratio) == pytest.approx(t, abs=1e-9)


RT_ROWS = [
    [t, 1e4 * math.exp(3900 * (1 / (t + 273.15) - 1 / 298.15) + 2e-5 * (t - 25) ** 2)]
    for t in range(-40, 111, 5)
]
INVERTIBLE: list[dict[str, Any]] = [
    YSI,
    RATIO,
    {"type": "beta", "r25": 1e4, "beta": 3435},
    {"type": "rt-table", "table": RT_ROWS},
    {"type": "rt-table", "table": [[-50, 80.31], [0, 100.0], [50, 119.4], [150, 157.33]]},
    PT100,
    PT100 | {"lead_resistance": 0.8, "temperature_offset": -0.03},
    YSI | {"circuit": {"kind": "ohm", "scale": 0.1}},
    YSI | {"circuit": {"kind": "divider", "series": 1e4, "full_scale": 65535}},
    YSI | {"circuit": {"kind": "divider", "series": 4.7e3, "sensor": "high"}},
    PT100 | {"circuit": {"kind": "divider", "series": 100.0, "bridge_ratio": 0.5}},
    PT100 | {"circuit": {"kind": "current", "current": 1e-3, "scale": 1e-3}},
    YSI | {"parallel": 2.2e4},
]


@given(st.sampled_from(INVERTIBLE), st.floats(-35, 105))
def test_inverse_returns_the_raw_number(config: dict[str, Any], celsius: float) -> None:
    transducer = make(**config)
    raw = transducer.inverse(celsius)
    assert transducer.value(raw) == pytest.approx(celsius, abs=1e-7)


def test_table_interpolates_between_rows_as_stated() -> None:
    fine = make(**YSI)
    for step, allowed in ((5, 0.006), (10, 0.022)):
        rows = [[t, fine.inverse(t)] for t in range(0, 61, step)]
        table = make(type="rt-table", table=rows)
        errors = [abs(table.value(fine.inverse(t / 10)) - t / 10) for t in range(601)]
        assert 0.1 * allowed < max(errors) < allowed


def test_a_divider_is_the_circuit_that_it_says() -> None:
    low = make(**YSI, circuit={"kind": "divider", "series": 3e4, "full_scale": 4095})
    assert low.value(4095 * 1e4 / (1e4 + 3e4)) == pytest.approx(make(**YSI).value(1e4))
    high = make(**YSI, circuit={"kind": "divider", "series": 3e4, "sensor": "high"})
    assert high.value(3e4 / (1e4 + 3e4)) == pytest.approx(make(**YSI).value(1e4))
    bridge = make(**PT100, circuit={"kind": "divider", "series": 100.0, "bridge_ratio": 0.5})
    assert bridge.value(0.0) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("config", "raw", "fault", "said"),
    [
        (YSI, 4.2e6, TransducerFault.BROKEN_WIRE, "broken wire: 4.2 MΩ, above 1 MΩ"),
        (YSI, 3.1, TransducerFault.SHORT_CIRCUIT, "short circuit: 3.1 Ω, below 10 Ω"),
        (YSI, 0.0, TransducerFault.SHORT_CIRCUIT, "short circuit: 0 Ω, below 10 Ω"),
        (
            YSI,
            150.0,
            TransducerFault.OUT_OF_RANGE,
            "out of range: 150 Ω would be hotter than 150 °C",
        ),
        (
            YSI,
            9e5,
            TransducerFault.OUT_OF_RANGE,
            "out of range: 900 kΩ would be colder than -50 °C",
        ),
        (YSI, math.nan, TransducerFault.NOT_A_NUMBER, "not a number: the device sent nan"),
        (YSI, math.inf, TransducerFault.NOT_A_NUMBER, "not a number: the device sent inf"),
        (
            YSI | {"circuit": {"kind": "ohm", "scale": 0.1}},
            0xFFFFFFFF,
            TransducerFault.BROKEN_WIRE,
            "broken wire: 429.5 MΩ, above 1 MΩ",
        ),
        (
            YSI | {"circuit": {"kind": "divider", "series": 1e4, "full_scale": 4095}},
            4095,
            TransducerFault.BROKEN_WIRE,
            "broken wire: infinite resistance, above 1 MΩ",
        ),
        (
            YSI | {"circuit": {"kind": "divider", "series": 1e4, "full_scale": 4095}},
            9000,
            TransducerFault.OUT_OF_RANGE,
            "out of range: raw 9000 is 2.20 of the divider's supply",
        ),
        (
            YSI | {"parallel": 1e4},
            1e4,
            TransducerFault.BROKEN_WIRE,
            "broken wire: infinite resistance, ",
        ),
        (PT100, 501.0, TransducerFault.BROKEN_WIRE, "broken wire: 501 Ω, above 500 Ω"),
        (PT100, 1.0, TransducerFault.SHORT_CIRCUIT, "short circuit: 1 Ω, below 10 Ω"),
        (
            PT100,
            400.0,
            TransducerFault.OUT_OF_RANGE,
            "out of range: 400 Ω would be hotter than 850 °C",
        ),
        (
            {"type": "rt-table", "table": RT_ROWS},
            900e3,
            TransducerFault.OUT_OF_RANGE,
            "out of range: 900 kΩ, outside the table's",
        ),
    ],
)
def test_faults_are_named_and_never_a_temperature(
    config: dict[str, Any], raw: float, fault: TransducerFault, said: str
) -> None:
    transducer = make(**config)
    with pytest.raises(SensorFaultError) as caught:
        transducer.value(raw)
    assert caught.value.fault is fault
    sample = transducer.convert(Sample(raw, 12.5))
    assert sample.reason.startswith(said)
    assert sample.quality is Quality.BAD
    assert math.isnan(sample.value)
    assert sample.time == 12.5


def test_samples_keep_their_time_and_bad_ones_their_reason() -> None:
    pt = make(**PT100)
    good = pt.convert(Sample(107.7935, 3.0))
    assert good.good
    assert good.time == 3.0
    assert good.value == pytest.approx(20.0, abs=1e-4)
    lost = Sample(math.nan, 4.0, Quality.UNAVAILABLE, "no answer")
    assert pt.convert(lost) is lost


@pytest.mark.parametrize(
    ("config", "said"),
    [
        (ARDUINO | {"r25": 1e4}, "24.68 °C at r25 = 10000"),
        (YSI | {"b": -2.387e-4}, "not an NTC thermistor"),
        (YSI | {"typo": 1}, "typo"),
        (YSI | {"short_below": 1e4}, "widen the limits"),
        (YSI | {"short_below": 2e6}, "must lie below open_above"),
        (YSI | {"min_temperature": 160.0}, "must lie below max_temperature"),
        ({"type": "beta", "r25": 1e4, "beta": 0}, "greater than 0"),
        ({"type": "rt-table", "table": [[0, 1000], [10, 900], [5, 800]]}, "row 3: temperatures"),
        ({"type": "rt-table", "table": [[0, 1000], [10, 900], [20, 950]]}, "row 3: resistances"),
        ({"type": "rt-table", "table": [[0, 1000]]}, "at least 2"),
        ({"type": "rt-table", "table": [[0, 1000], [10, 2]]}, "which name faults"),
        ({"type": "rt-table", "table": [[0, "x"], [10, 2]]}, "table.0.1"),
        ({"type": "pt", "a": -1.0}, "platinum"),
        ({"type": "thermocouple"}, "thermocouple"),
    ],
)
def test_configurations_that_cannot_work_are_refused(config: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError) as caught:
        make(**config)
    assert said in str(caught.value)
