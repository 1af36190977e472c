"""The server in its own process, spoken to by a bare pymodbus client and by mbpoll."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusIOException

from abbe.drivers.simulated.bridge.machine import AXES, PLACES, make_bridge
from abbe.drivers.simulated.bridge.registers import BLOCKS, INPUT_SIZE, REGISTERS
from abbe.drivers.transducers import TRANSDUCER_CONFIG, make_transducer

pytestmark = pytest.mark.integration

Client = ModbusTcpClient | ModbusSerialClient


@contextmanager
def served(*options: str, stdin: int | None = None) -> Iterator[tuple[Any, dict[str, Any]]]:
    """A server process and its ready line; ended by its own id, whatever happens."""
    process = subprocess.Popen(
        [sys.executable, "-m", "abbe.drivers.simulated", "bridge", "--seed", "1", *options],
        stdout=subprocess.PIPE,
        stdin=stdin if stdin is not None else subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    try:
        yield process, json.loads(process.stdout.readline())
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()
        process.stdout.close()
        if process.stdin is not None:
            process.stdin.close()


@contextmanager
def connected(ready: dict[str, Any], timeout: float = 2.0) -> Iterator[ModbusTcpClient]:
    client = ModbusTcpClient(ready["host"], port=ready["port"], timeout=timeout, retries=0)
    assert client.connect()
    try:
        yield client
    finally:
        client.close()


@pytest.fixture(scope="module")
def bridge() -> Iterator[dict[str, Any]]:
    """One server for all tests that leave it as they found it."""
    with served("--time-factor", "60") as (_, ready):
        yield ready


def read(client: Client, *blocks: str) -> dict[str, float]:
    """Some blocks of the input table or of the holding table in one request."""
    wanted = [b for b in BLOCKS if b.name in blocks]
    start, end = min(b.start for b in wanted), max(b.start + b.size for b in wanted)
    ask = client.read_input_registers
    if wanted[0].table == "holding":
        ask = client.read_holding_registers
    answer = ask(start, count=end - start, device_id=1)
    assert not answer.isError(), answer
    values: dict[str, float] = {}
    for b in wanted:
        values |= b.unpack(answer.registers[b.start - start :][: b.size])
    return values


def set_fault(client: Client, **values: int) -> None:
    for name, value in values.items():
        register = REGISTERS[name]
        if register.table == "coil":
            answer = client.write_coil(register.address, bool(value), device_id=1)
        else:
            words = (
                [value & 0xFFFF] if register.size == 1 else [value >> 16 & 0xFFFF, value & 0xFFFF]
            )
            answer = client.write_registers(register.address, words, device_id=1)
        assert not answer.isError(), answer


def answer_sample(client: Client, sample: int, corrected: list[int], beat: int = 1) -> None:
    """What Abbe does: write the corrected position with the sample that it belongs to."""
    words = [1, beat]
    for number in (*corrected, sample):
        words += [number >> 16 & 0xFFFF, number & 0xFFFF]
    assert not client.write_registers(0, words, device_id=1).isError()


def test_the_ready_line_says_all_that_a_parent_needs(bridge: dict[str, Any]) -> None:
    assert bridge["ready"] is True
    assert bridge["host"] == "127.0.0.1"
    assert bridge["port"] > 0
    registers = {r["name"]: r for r in bridge["registers"]}
    assert set(registers) == set(REGISTERS)
    assert registers["corrected_Z"]["address"] == REGISTERS["corrected_Z"].address
    for config in bridge["transducers"].values():
        make_transducer(TRANSDUCER_CONFIG.validate_python(config))


def test_one_request_is_one_cycle(bridge: dict[str, Any]) -> None:
    machine = make_bridge(1)
    counts = {
        name: make_transducer(TRANSDUCER_CONFIG.validate_python(config))
        for name, config in bridge["transducers"].items()
    }
    samples = []
    with connected(bridge) as client:
        set_fault(client, repeatability=0)
        try:
            for _ in range(40):
                v = read(client, "controller", "truth")
                assert v["truth_sample"] == v["sample"]
                samples.append(v["sample"])
                place = [counts[f"count_{a}"].value(v[f"count_{a}"]) for a in AXES]
                assert place == pytest.approx([v[f"indicated_{a}"] for a in AXES], abs=1e-9)
                # The truth is the exact simulator's, at the very temperatures of that cycle.
                error = machine.error(place, [v[f"true_{p}"] for p in PLACES])
                truth = [v[f"true_{a}"] for a in AXES]
                assert truth == pytest.approx(
                    [p + e for p, e in zip(place, error, strict=True)], abs=2e-6
                )
                for p in PLACES:
                    shown = counts[f"R_{p}"].value(v[f"R_{p}"] * 0.1)
                    assert shown == pytest.approx(v[f"true_{p}"], abs=0.12)
        finally:
            set_fault(client, repeatability=300)
    assert samples == sorted(samples)
    assert samples[-1] > samples[0]


def test_corrected_and_true_positions_meet_in_one_read(bridge: dict[str, Any]) -> None:
    with connected(bridge) as abbe, connected(bridge) as other:
        v = read(abbe, "controller", "truth")
        corrected = [round(v[f"true_{a}"] * 1e5) for a in AXES]
        read(abbe, "controller")  # later cycles do not disturb it
        answer_sample(abbe, int(v["sample"]), corrected)
        seen = read(other, "write-back", "matched")
        assert seen["matched_state"] == 1
        assert seen["echo_sample"] == seen["matched_sample"] == v["sample"]
        for a in AXES:
            assert seen[f"corrected_{a}"] == seen[f"matched_true_{a}"]
        answer_sample(abbe, 0xFFFFFFF0, corrected)
        assert read(other, "write-back", "matched")["matched_state"] == 2


@pytest.mark.skipif(shutil.which("mbpoll") is None, reason="mbpoll is not installed")
def test_mbpoll_reads_corrected_and_true_at_once(bridge: dict[str, Any]) -> None:
    with connected(bridge) as abbe:
        v = read(abbe, "controller", "truth")
        corrected = [round(v[f"true_{a}"] * 1e5) for a in AXES]
        answer_sample(abbe, int(v["sample"]), corrected)
    command = ["mbpoll", "-m", "tcp", "-p", str(bridge["port"]), "-a", "1", "-t", "4:int", "-B"]
    command += ["-0", "-r", "2", "-c", "8", "-1", bridge["host"]]
    output = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True).stdout
    shown = {int(a): int(b) for a, b in re.findall(r"^\[(\d+)\]:\s+(-?\d+)", output, re.M)}
    assert [shown[2], shown[4], shown[6]] == corrected
    assert shown[8] == shown[10] == v["sample"]
    assert [shown[12], shown[14], shown[16]] == corrected


def test_addresses_that_do_not_exist_or_are_read_only_are_refused(bridge: dict[str, Any]) -> None:
    with connected(bridge) as client:
        assert client.read_input_registers(INPUT_SIZE, count=1, device_id=1).isError()
        assert client.read_holding_registers(40, count=2, device_id=1).isError()
        assert client.write_registers(12, [1, 2], device_id=1).isError()
        assert client.write_registers(9, [1, 2], device_id=1).isError()
        assert not client.read_holding_registers(0, count=26, device_id=1).isError()


def test_another_unit_does_not_answer(bridge: dict[str, Any]) -> None:
    with connected(bridge, timeout=0.3) as client, pytest.raises(ModbusIOException):
        client.read_input_registers(0, count=2, device_id=7)
    with connected(bridge) as client:
        assert not client.read_input_registers(0, count=2, device_id=1).isError()


def test_the_machine_s_faults(bridge: dict[str, Any]) -> None:
    with connected(bridge) as client:
        set_fault(client, thermistors_open=0b10, thermistors_short=0b100, encoders_frozen=0b010)
        set_fault(client, heartbeat_stopped=1, unreferenced=1, machine_fault=1)
        try:
            first = read(client, "controller")
            assert first["R_T_x2"] == 0xFFFFFFFF
            assert first["R_T_y1"] == 0
            assert int(first["status"]) & 0b1100 == 0b1000  # fault, not referenced
            bits = client.read_discrete_inputs(0, count=5, device_id=1).bits
            assert (bits[2], bits[3]) == (False, True)
            time.sleep(0.25)
            assert read(client, "controller")["heartbeat"] == first["heartbeat"]
            assert client.read_coils(0, count=5, device_id=1).bits[:5] == [0, 0, 1, 1, 1]
        finally:
            set_fault(client, thermistors_open=0, thermistors_short=0, encoders_frozen=0)
            set_fault(client, heartbeat_stopped=0, unreferenced=0, machine_fault=0)
        assert read(client, "controller")["R_T_x2"] < 20e4
        assert int(read(client, "controller")["status"]) & 0b1100 == 0b0100
        beat = read(client, "controller")["heartbeat"]
        time.sleep(0.25)
        assert read(client, "controller")["heartbeat"] != beat


def test_the_machine_goes_where_it_is_sent_and_stands() -> None:
    options = ("--stand-at", "35,45,-18", "--noise", "0", "--time-factor", "0")
    with served(*options) as (_, ready), connected(ready) as client:
        deadline = time.monotonic() + 30
        while time.monotonic() < deadline:
            v = read(client, "controller", "truth")
            if v["indicated_Y"] == 45.0 and not int(v["status"]) & 2:
                break
            time.sleep(0.05)
        assert [v[f"indicated_{a}"] for a in AXES] == [35.0, 45.0, -18.0]
        time.sleep(0.05)
        later = read(client, "controller", "truth")
        assert later["sample"] > v["sample"]
        assert [later[f"true_{a}"] for a in AXES] == [v[f"true_{a}"] for a in AXES]


def test_a_hanging_server_accepts_and_does_not_answer(bridge: dict[str, Any]) -> None:
    with connected(bridge, timeout=0.2) as client:
        set_fault(client, hang=2500)  # this one is still answered
        started = time.monotonic()
        with pytest.raises(ModbusIOException):
            client.read_input_registers(0, count=2, device_id=1)
        with connected(bridge, timeout=0.2) as second, pytest.raises(ModbusIOException):
            second.write_register(0, 77, device_id=1)
        time.sleep(max(0.0, started + 2.6 - time.monotonic()))
    with connected(bridge) as client:
        assert not client.read_input_registers(0, count=2, device_id=1).isError()
        assert client.read_holding_registers(0, count=1, device_id=1).registers != [77]


def test_busy_answers_are_counted(bridge: dict[str, Any]) -> None:
    with connected(bridge) as client:
        set_fault(client, busy=2)
        codes = []
        for _ in range(3):
            answer = client.read_input_registers(0, count=2, device_id=1)
            codes.append(answer.exception_code if answer.isError() else 0)
        assert codes == [6, 6, 0]


def test_connections_are_dropped_and_the_port_comes_back(bridge: dict[str, Any]) -> None:
    with connected(bridge) as client:
        set_fault(client, drop=1)
        time.sleep(0.2)
        with pytest.raises(ConnectionException):
            client.read_input_registers(0, count=2, device_id=1)
    with connected(bridge) as client:
        set_fault(client, offline=2000)
    time.sleep(0.3)
    refused = ModbusTcpClient(bridge["host"], port=bridge["port"], timeout=0.2, retries=0)
    assert not refused.connect()
    deadline = time.monotonic() + 20
    while not refused.connect():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert not refused.read_input_registers(0, count=2, device_id=1).isError()
    refused.close()


def test_counts_that_wrap_are_followed() -> None:
    with served("--encoder-zero", "Z=-2147480000") as (_, ready), connected(ready) as client:
        z = make_transducer(TRANSDUCER_CONFIG.validate_python(ready["transducers"]["count_Z"]))
        # The counter passes its edge at Z = −0.3648 mm.
        for target, positive in ((0, False), (-20_000, True)):
            set_fault(client, go_to_Z=target, go_to=1)
            deadline = time.monotonic() + 30
            while True:
                v = read(client, "controller", "truth")
                assert z.value(v["count_Z"]) == pytest.approx(v["indicated_Z"], abs=1e-9)
                if v["indicated_Z"] == target * 1e-4:
                    break
                assert time.monotonic() < deadline
                time.sleep(0.01)
            assert (v["count_Z"] > 0) is positive


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_cleanly_when_asked(number: signal.Signals) -> None:
    with served() as (process, ready), connected(ready) as client:
        assert not client.read_input_registers(0, count=2, device_id=1).isError()
        process.send_signal(number)
        assert process.wait(timeout=30) == 0


def test_it_ends_with_its_parent() -> None:
    with served("--die-with-stdin", stdin=subprocess.PIPE) as (process, ready):
        with connected(ready) as client:
            assert not client.read_input_registers(0, count=2, device_id=1).isError()
        assert process.poll() is None
        process.stdin.close()
        assert process.wait(timeout=30) == 0


def test_a_port_that_is_taken_is_said(bridge: dict[str, Any]) -> None:
    command = [
        sys.executable,
        "-m",
        "abbe.drivers.simulated",
        "bridge",
        "--port",
        str(bridge["port"]),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "cannot listen on 127.0.0.1" in done.stderr
    assert "Traceback" not in done.stderr


def test_rtu_over_a_pseudo_terminal() -> None:
    with served("--rtu") as (_, ready):
        assert ready["protocol"] == "rtu"
        client = ModbusSerialClient(ready["device"], baudrate=ready["baudrate"], timeout=2.0)
        assert client.connect()
        try:
            v = read(client, "controller", "truth")
            assert v["sample"] == v["truth_sample"] > 0
            answer_sample(client, int(v["sample"]), [round(v[f"true_{a}"] * 1e5) for a in AXES])
            seen = read(client, "write-back", "matched")
            assert seen["corrected_Y"] == seen["matched_true_Y"]
        finally:
            client.close()
        # A second client on the same cable, after the first has hung up.
        again = ModbusSerialClient(ready["device"], baudrate=ready["baudrate"], timeout=2.0)
        assert again.connect()
        assert read(again, "controller")["sample"] > v["sample"]
        again.close()


def test_orphans_do_not_stay(tmp_path: Any) -> None:
    """The parent is killed outright: the server notices and ends."""
    script = (
        "import subprocess, sys, time\n"
        "p = subprocess.Popen([sys.executable, '-m', 'abbe.drivers.simulated', 'bridge',\n"
        "    '--die-with-stdin'], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)\n"
        "print(p.stdout.readline(), end='', flush=True)\n"
        "time.sleep(600)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    ready = json.loads(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            os.kill(ready["pid"], 0)
        except ProcessLookupError:
            return
        if _is_zombie(ready["pid"]):
            return
        time.sleep(0.05)
    raise AssertionError("the server outlived its parent")


def _is_zombie(pid: int) -> bool:
    """Ended, but not yet reaped by whoever adopted it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text("ascii").rsplit(")", 1)[1].split()[0] == "Z"
    except FileNotFoundError:
        return True
