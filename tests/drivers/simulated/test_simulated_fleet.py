"""The simulated fleet: what has changed on one machine is found where it has to be."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from pymodbus.client import ModbusTcpClient

from abbe.compcore.files.campaign_file import read_campaign
from abbe.daemon.demo.prepare import START
from abbe.drivers.simulated.bridge.checks import SPHERES
from abbe.drivers.simulated.bridge.happened import Happened
from abbe.drivers.simulated.bridge.machine import make_bridge
from abbe.drivers.simulated.fleet.device import (
    PER_SPHERE,
    SPHERES_AT,
    TEMPERATURES_AT,
    SimulatedFleetMachine,
)
from abbe.drivers.simulated.fleet.past import SINCE, SOUND, past_checks, stands
from tests.support.daemon.live_run import read_holding

CRASH = 10e-6
NOON = 1.8e9


def found(machine: SimulatedFleetMachine, name: str) -> tuple[int, np.ndarray]:
    at = SPHERES_AT + PER_SPHERE * list(SPHERES).index(name)
    words = machine.read("input", at, PER_SPHERE, NOON)
    return words[0], np.array(struct.unpack(">3f", struct.pack(">6H", *words[2:8])))


def floats(words: list[int]) -> np.ndarray:
    return np.array(struct.unpack(f">{len(words) // 2}f", struct.pack(f">{len(words)}H", *words)))


@pytest.mark.thorough
def test_a_crash_turns_x_on_y_where_the_spheres_are() -> None:
    """By so much more in Y as X is further out, and nowhere else."""
    there = SPHERES
    sound = SimulatedFleetMachine(1, 1, Happened(), there)
    crashed = SimulatedFleetMachine(1, 1, Happened(squareness=CRASH), there)
    sums = {name: np.zeros(3) for name in SPHERES}
    for k in range(400):
        for machine, sign in ((sound, 1.0), (crashed, -1.0)):
            machine.probe(NOON)
            for name in SPHERES:
                count, position = found(machine, name)
                assert count == k + 1
                sums[name] += sign * position / 400
    near, far = sums["sphere1"], sums["sphere2"]
    # the same seeds scatter alike; float32 steps are 0.06 µm
    way = SPHERES["sphere2"][0] - SPHERES["sphere1"][0]
    assert far - near == pytest.approx([0.0, CRASH * way, 0.0], abs=5e-4 * CRASH * 1e6)


def test_its_past_ends_yesterday_and_its_spheres_stand_where_they_were_found(
    tmp_path: Path,
) -> None:
    from abbe.compcore.files.model_file import load_model

    text = past_checks(1, 2, "crash", NOON)
    (tmp_path / "past.csv").write_text(text, "utf-8")
    campaign = read_campaign(tmp_path / "past.csv", load_model(START).machine)
    time_of = campaign.conditions.time
    assert time_of.max() == NOON - 86_400.0
    days = np.round((time_of - time_of.max()) / 86_400.0)
    assert len(np.unique(days)) == SOUND + SINCE
    assert text != past_checks(1, 3, "crash", NOON)
    where = stands(text)
    setups = [str(s) for s in campaign.conditions.setup]
    first = campaign.value[setups.index("sphere3_Y")]
    assert where["sphere3"][1] == pytest.approx(SPHERES["sphere3"][1] + first, abs=1e-9)


@pytest.mark.integration
def test_each_machine_has_its_own_port_and_shows_the_temperatures_at_which_it_probes() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "abbe.drivers.simulated", "fleet", "--machines", "3",
         "--die-with-stdin"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        ready = json.loads(process.stdout.readline())
        ports = [fact["port"] for fact in ready["machines"]]
        assert len(set(ports)) == 3
        for port in ports:
            assert read_holding(port, 0, 2) == bytes(4)
        process.stdin.write('{"do": "probe", "machine": 2}\n')
        process.stdin.flush()
        assert json.loads(process.stdout.readline()) == {"done": "probe", "machines": 1}
        read = ModbusTcpClient("127.0.0.1", port=ports[1])
        assert read.connect()
        shown = floats(read.read_input_registers(TEMPERATURES_AT, count=14, device_id=1).registers)
        there = stands(past_checks(1, 2, "nothing", NOON))
        for k, (name, place) in enumerate(SPHERES.items()):
            at = SPHERES_AT + PER_SPHERE * k + 2
            position = floats(read.read_input_registers(at, count=6, device_id=1).registers)
            error = make_bridge(1).error(place, shown)
            # each probing scatters by 0.64 µm; of 0.35 K X's scale makes 3 µm
            assert there[name] - position == pytest.approx(error, abs=2.5e-3)
        read.close()
        process.stdin.close()
        assert process.wait(60) == 0
    finally:
        process.kill()
        process.stdout.close()
        process.wait()


def test_a_machine_that_there_is_not() -> None:
    command = [sys.executable, "-m", "abbe.drivers.simulated", "fleet", "--drifting", "9"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "--drifting" in done.stderr


def test_it_moves_within_its_travels() -> None:
    machine = SimulatedFleetMachine(1, 7, Happened(), SPHERES)
    began = time.time()
    for k in range(200):
        words = machine.read("input", 0, 6, began + k)
        x, y, z = struct.unpack(">3f", struct.pack(">6H", *words))
        assert 0 <= x <= 700
        assert 0 <= y <= 900
        assert -360 <= z <= 0
