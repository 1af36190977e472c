"""The running machine: what its sensors show, what its controls do, one truth per cycle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.drivers.simulated.bridge.device import BridgeDevice, NotWritableError
from abbe.drivers.simulated.bridge.machine import AXES, PLACES, TRAVELS, make_bridge
from abbe.drivers.simulated.bridge.plant import KEPT, Plant, shop_climate, thermistor_ohms
from abbe.drivers.simulated.bridge.registers import BLOCKS, ENCODERS, transducer_configs
from abbe.drivers.simulated.registers import Register, RegisterBlock
from abbe.drivers.transducers import TRANSDUCER_CONFIG, Transducer, make_transducer

MACHINE = make_bridge(1)
TRANSDUCERS: dict[str, Transducer] = {
    name: make_transducer(TRANSDUCER_CONFIG.validate_python(config))
    for name, config in transducer_configs().items()
}


def plant(**settings: Any) -> Plant:
    return Plant(MACHINE, shop_climate(1), 100.0, **settings)


def test_sensors_read_by_abbe_s_transducers_give_the_indicated_state() -> None:
    p = plant(time_factor=60.0)
    for now in np.arange(100.0, 200.0, 3.7):
        latch = p.latch(float(now))
        for i, axis in enumerate(AXES):
            shown = TRANSDUCERS[f"count_{axis}"].value(latch.counts[i])
            assert shown == pytest.approx(latch.position[i], abs=1e-9)
        for k, place in enumerate(PLACES):
            shown = TRANSDUCERS[f"R_{place}"].value(latch.ohms[k] * 0.1)
            assert shown == pytest.approx(
                latch.temperatures[k] + MACHINE.sensor_errors[k], abs=0.012
            )


@given(st.floats(-40, 120))
def test_thermistor_ohms_invert_the_published_formula(celsius: float) -> None:
    ohms = thermistor_ohms(celsius)
    log = math.log(ohms)
    kelvin = 1 / (1.032e-3 + 2.387e-4 * log + 1.580e-7 * log**3)
    assert kelvin - 273.15 == pytest.approx(celsius, abs=1e-9)


def test_one_latch_per_cycle_and_the_truth_belongs_to_it() -> None:
    p = plant()
    first = p.latch(110.0004)
    assert p.latch(110.0009) is first
    second = p.latch(110.0011)
    assert second.sample == first.sample + 1
    assert p.latch(110.0002) is second  # time never goes back
    expected = MACHINE.error(first.position, first.temperatures) + first.position + first.scatter
    assert p.truth(first) == pytest.approx(expected, abs=1e-12)
    assert p.find(first.sample) is first
    assert p.find(first.sample - 1) is None


def test_latches_are_forgotten_in_the_end() -> None:
    p = plant()
    first = p.latch(100.0)
    for k in range(1, KEPT + 1):
        p.latch(100.0005 + k * 1e-3)
    assert p.find(first.sample) is None


def test_noise_is_the_repeatability_and_follows_the_seed() -> None:
    def scatter(seed: int) -> np.ndarray:
        p = plant(seed=seed)
        return np.array([p.latch(100.0005 + k * 1e-3).scatter for k in range(2000)])

    one = scatter(1)
    assert one.std() == pytest.approx(0.3e-3, rel=0.05)
    assert np.array_equal(one, scatter(1))
    assert not np.array_equal(one, scatter(2))


def test_counts_wrap_around_where_the_zero_says_so() -> None:
    encoders = {a: dict(e) for a, e in ENCODERS.items()}
    encoders["Z"]["zero"] = -(2**31) + 1_000_000  # wraps at Z = −100 mm
    p = plant(encoders=encoders)
    z = make_transducer(TRANSDUCER_CONFIG.validate_python(transducer_configs(encoders)["count_Z"]))
    seen = set()
    for now in np.arange(100.0, 200.0, 0.5):
        latch = p.latch(float(now))
        assert -(2**31) <= latch.counts[2] < 2**31
        seen.add(latch.counts[2] > 0)
        assert z.value(latch.counts[2]) == pytest.approx(latch.position[2], abs=1e-9)
    assert seen == {True, False}


def test_go_to_stand_still_and_back_on_the_path() -> None:
    p = plant()
    control = p.disturbances
    p.latch(103.0)
    control.target, control.go_to = (10.0, 2000.0, -50.0), True
    for k in range(1, 200):
        p.latch(103.0 + 0.1 * k)
    standing = p.latch(123.0)
    assert standing.position == (10.0, 900.0, -50.0)  # never beyond the travel
    assert not p.latch(123.5).moving
    control.go_to = False
    places = np.array([p.latch(124.0 + 0.01 * k).position for k in range(1500)])
    assert np.abs(np.diff(places, axis=0)).max() < 0.011 * 300.0  # no teleport
    # It came back to the path where it had left it, and went on from there.
    resumed = p.path.position(p._path_time)
    assert places[-1] == pytest.approx(resumed, abs=1e-4)
    control.stand_still = True
    held = p.latch(140.0).position
    assert p.latch(150.0).position == held
    control.stand_still = False
    assert p.latch(151.0).position != held


def test_disturbances_show_in_the_registers_and_not_in_the_truth() -> None:
    p = plant(time_factor=0.0)
    before = p.latch(105.0)
    p.disturbances.thermistors_open = 0b0000010
    p.disturbances.thermistors_short = 0b1000000
    p.disturbances.encoders_frozen = 0b001
    p.warm(1.5)
    after = p.latch(106.0)
    assert after.ohms[1] == 0xFFFFFFFF
    assert after.ohms[6] == 0
    open_wire = TRANSDUCERS["R_T_x2"]
    with pytest.raises(ValueError, match="broken wire"):
        open_wire.value(after.ohms[1] * 0.1)
    with pytest.raises(ValueError, match="short circuit"):
        open_wire.value(after.ohms[6] * 0.1)
    assert after.counts[0] == before.counts[0]
    assert after.counts[1] != before.counts[1]
    assert after.position[0] != before.position[0]
    assert after.temperatures - before.temperatures == pytest.approx(np.full(7, 1.5))


def read(device: BridgeDevice, block: str, now: float) -> dict[str, float]:
    b = next(b for b in BLOCKS if b.name == block)
    return b.unpack(device.read(b.table, b.start, b.size, now))


def test_the_truth_is_matched_to_the_echoed_sample() -> None:
    p = plant()
    device = BridgeDevice(p)
    assert read(device, "matched", 101.0)["matched_state"] == 0
    controller = read(device, "controller", 104.0)
    truth = read(device, "truth", 104.0)
    assert truth["truth_sample"] == controller["sample"]
    read(device, "controller", 104.2)  # the machine moves on before Abbe answers
    sample = int(controller["sample"])
    answer = [1, 7, 0, 0, 0, 0, 0, 0, sample >> 16, sample & 0xFFFF]
    device.write("holding", 0, answer, 104.25)
    matched = read(device, "matched", 104.3)
    assert matched["matched_state"] == 1
    assert matched["matched_sample"] == sample
    assert matched["matched_age"] == 250
    for axis in AXES:
        assert matched[f"matched_true_{axis}"] == pytest.approx(
            truth[f"true_{axis}"] * 1e5, abs=0.5
        )
        assert matched[f"matched_indicated_{axis}"] == round(truth[f"indicated_{axis}"] * 1e5)
    device.write("holding", 8, [0, 1], 104.4)
    assert read(device, "matched", 104.4)["matched_state"] == 2
    device.write("holding", 2, [0, 0], 104.5)
    assert read(device, "matched", 104.5)["matched_state"] == 3


def test_the_watchdog_sees_abbe_s_heartbeat() -> None:
    device = BridgeDevice(plant())

    def alive(now: float) -> bool:
        return bool(device.read("discrete", 4, 1, now)[0])

    assert not alive(101.0)
    device.write("holding", 1, [1], 101.0)
    assert alive(101.5)
    device.write("holding", 1, [1], 101.9)  # the same number is no sign of life
    assert not alive(102.1)
    device.write("holding", 1, [2], 102.2)
    assert alive(102.3)


def test_events_happen_once_and_states_stay() -> None:
    p = plant(time_factor=0.0)
    device = BridgeDevice(p)
    start = p.latch(100.5).temperatures
    device.write("holding", 100, [5], 101.0)
    device.write("holding", 110, [150], 101.0)
    device.write("holding", 103, [1000], 101.0)
    assert p.disturbances.repeatability == pytest.approx(1e-3)
    assert p.disturbances.thermistors_open == 5
    assert p.latch(102.0).temperatures - start == pytest.approx(np.full(7, 1.5))
    values = read(device, "fault", 102.0)
    assert values["thermistors_open"] == 5
    assert values["temperature_step"] == 0


def test_what_is_not_writable_is_refused_whole() -> None:
    device = BridgeDevice(plant())
    with pytest.raises(NotWritableError):
        device.write("holding", 8, [1, 2, 3], 101.0)
    assert device.read("holding", 8, 2, 101.0) == [0, 0]


def test_blocks_do_not_overlap_and_fit_one_request() -> None:
    for table in ("input", "holding", "coil", "discrete"):
        taken: set[int] = set()
        for block in BLOCKS:
            if block.table == table:
                addresses = set(range(block.start, block.start + block.size))
                assert not addresses & taken
                assert block.size == sum(r.size for r in block.registers) <= 125
                taken |= addresses
    names = [r.name for b in BLOCKS for r in b.registers]
    assert len(set(names)) == len(names)


@given(st.integers(0, 65535), st.integers(-(2**31), 2**31 - 1), st.floats(-1e9, 1e9))
def test_blocks_pack_big_endian_and_unpack(small: int, wide: int, real: float) -> None:
    block = RegisterBlock(
        "b",
        "holding",
        5,
        "",
        (Register("s", "uint16", ""), Register("w", "int32", ""), Register("r", "float64", "")),
    )
    words = block.pack([small, wide, real])
    assert words[0] == small
    assert words[1] << 16 | words[2] == wide % 2**32
    assert block.unpack(words) == {"s": small, "w": wide, "r": real}
    assert [r.address for r in block.registers] == [5, 6, 8]


def test_travels_match_the_transducers() -> None:
    for axis in AXES:
        assert tuple(transducer_configs()[f"count_{axis}"]["travel"]) == TRAVELS[axis]
