"""``abbe run`` live: corrected positions in the controller's registers, outages, a cut sensor."""

from __future__ import annotations

import math
import signal
import time
from itertools import pairwise
from pathlib import Path

import pytest

from abbe.compcore.files.model_file import load_model
from abbe.compcore.machine.conditions import Conditions
from abbe.daemon.demo.simulator import Simulator, simulated_bridge
from abbe.daemon.status_word import Status
from abbe.drivers.simulated.bridge.machine import TOOL
from tests.support.daemon.live_run import (
    MODEL,
    Cycle,
    LiveRun,
    compensating,
    error_um,
    live_run,
    machine,
    matched,
    mbpoll,
    read_holding,
    set_fault,
)

pytestmark = pytest.mark.integration

COUNT_UM = 0.01
"""One count of the corrected positions' registers, µm."""
SMALL_UM = 0.1
"""Folding (0.01 µm), and what the thermistors' noise of 2 mK does to 900 mm of scale, µm."""
MODEL_UM = 2.0
"""What a model fitted to measurements may be wrong by in one direction, µm."""
OUTAGE = 10.0
"""s for which the server is pulled."""


def test_an_unrelated_client_reads_corrected_positions_that_are_true(tmp_path: Path) -> None:
    """What mbpoll reads is the exact simulator's truth, within the model's error and a count."""
    with machine(tmp_path) as (simulator, config), live_run(config) as run:
        run.until(compensating)
        answers = []
        for _ in range(40):
            answers.append(matched(simulator.port))
            time.sleep(0.15)
        assert run.end() == 0
        cycles = list(run.cycles)
    model = load_model(MODEL)
    errors = []
    for answer in answers:
        assert answer["matched_state"] == 1.0
        assert answer["matched_sample"] == answer["echo_sample"]
        at = {a: answer[f"matched_indicated_{a}"] for a in "XYZ"}
        temperatures = temperatures_at(cycles, at)
        predicted = model.axis_error(Conditions.at(at, tool=TOOL, signals=temperatures))
        for axis in "XYZ":
            corrected, true = answer[f"corrected_{axis}"], answer[f"matched_true_{axis}"]
            by_model = at[axis] + float(predicted[axis][0])
            model_error = 1e3 * abs(true - by_model)
            assert model_error < MODEL_UM
            assert 1e3 * abs(corrected - by_model) <= COUNT_UM + SMALL_UM
            assert 1e3 * abs(corrected - true) <= model_error + COUNT_UM + SMALL_UM
            errors.append(1e3 * abs(true - at[axis]))
    assert max(errors) > 10.0
    assert len({answer["echo_sample"] for answer in answers}) > 30


def temperatures_at(cycles: list[Cycle], indicated: dict[str, float]) -> dict[str, float]:
    """The temperatures by which the cycle corrected that read these positions.

    Those that the cycle before told: signals are taken in when the answer is out.
    """
    for before, cycle in pairwise(cycles):
        # a cycle on a busy computer may have read nothing
        seen = {a: math.inf if q is None else q for a, q in cycle["indicated"].items()}
        if all(abs(seen[a] - indicated[a]) < 1e-6 for a in "XYZ"):
            return dict(before["temperatures"])
    raise AssertionError(f"no cycle read {indicated}")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_with_the_correction_at_zero_and_the_controller_informed(
    tmp_path: Path, number: signal.Signals
) -> None:
    with machine(tmp_path) as (simulator, config), live_run(config) as run:
        run.until(compensating)
        assert int.from_bytes(read_holding(simulator.port, 0, 1)) & Status.COMPENSATING
        assert run.end(number) == 0
        assert read_holding(simulator.port, 0, 1) == b"\0\0"
        last = run.cycles[-1]
        assert set(last["correction"].values()) == {0.0}
        assert last["corrected"] == last["indicated"]
        assert "Traceback" not in run.journal


@pytest.mark.one_in(2)
@pytest.mark.parametrize("how", ["killed", "frozen"])
def test_a_server_that_is_away_for_ten_seconds(tmp_path: Path, how: str) -> None:
    """No crash, the state is shown, stale data are not corrected, it recovers without help."""
    with machine(tmp_path) as (simulator, config), live_run(config) as run:
        run.until(compensating)
        gone = len(run.cycles)
        began = time.monotonic()
        simulator.process.send_signal(signal.SIGKILL if how == "killed" else signal.SIGSTOP)
        lost = run.until(lambda c: c["links"]["cmm"]["state"] != "up", since=gone)
        assert lost["faults"]["link cmm"]
        run.until(lambda c: set(c["guard"]["states"].values()) == {"off"}, since=gone)
        time.sleep(max(0.0, began + OUTAGE - time.monotonic()))
        assert run.process.poll() is None
        # from the cycle after: the one in which the link is lost may have been read before
        away = run.cycles[run.cycles.index(lost) + 1 :]
        assert not any(c["written"] for c in away)
        for cycle in away:
            assert set(cycle["indicated"].values()) == {None}
            assert set(cycle["corrected"].values()) == {None}
        back = len(run.cycles)
        if how == "frozen":
            simulator.process.send_signal(signal.SIGCONT)
            _recovers(run, back, simulator)
        else:
            again = ["--port", str(simulator.port), "--noise", "0"]
            with simulated_bridge(1, 1.0, again) as second:
                _recovers(run, back, second)
                run.end()


def _recovers(run: LiveRun, back: int, simulator: Simulator) -> None:
    """From `back` on: from what the controller had, no step, ramped in, then right again."""
    full = run.until(compensating, since=back)
    way = run.cycles[back : run.cycles.index(full)]
    fresh = [c for c in way if None not in c["indicated"].values()]
    sizes = [max(map(abs, c["correction"].values())) for c in fresh]
    assert min(sizes) < 0.3 * max(sizes)
    longest = 0.5 * 0.3  # max_rate × stale_after of the example
    for one, two in pairwise(fresh):
        assert all(
            abs(two["correction"][d] - one["correction"][d]) <= longest + 1e-6 for d in "XYZ"
        )
    assert all(abs(error_um(full, axis)) < MODEL_UM for axis in "XYZ")
    assert full["links"]["cmm"]["state"] == "up"
    time.sleep(0.2)
    assert matched(simulator.port)["matched_state"] == 1.0


def test_a_machine_that_is_switched_on_later(tmp_path: Path) -> None:
    """Abbe may be there first; what it links comes when it comes."""
    with machine(tmp_path) as (first, config):
        port = first.port
    with live_run(config) as run:
        waiting = run.until(lambda c: c["time"] > 2.0)
        assert waiting["links"]["cmm"]["state"] in ("connecting", "down")
        assert set(waiting["corrected"].values()) == {None}
        with simulated_bridge(1, 1.0, ["--port", str(port), "--noise", "0"]):
            full = run.until(compensating)
            assert all(abs(error_um(full, axis)) < MODEL_UM for axis in "XYZ")
            assert run.end() == 0


def test_a_thermistor_that_is_cut_takes_its_axis_and_no_other(tmp_path: Path) -> None:
    """Named; the correction held, then ramped to zero; the other axes unaffected; then back."""
    stand = ["--stand-at", "650,800,-60"]
    with machine(tmp_path, *stand) as (simulator, config), live_run(config) as run:
        run.until(lambda c: compensating(c) and c["indicated"]["X"] == 650.0)
        before = run.until(compensating)
        assert abs(before["correction"]["X"]) > 1e-3
        cut = len(run.cycles)
        set_fault(simulator.port, "thermistors_open", 0b1)
        held = run.until(lambda c: c["guard"]["states"]["X"] == "holding", since=cut)
        assert "broken wire" in held["faults"]["signal T_x1"]
        assert held["correction"]["X"] == pytest.approx(before["correction"]["X"], abs=1e-4)
        run.until(lambda c: c["guard"]["states"]["X"] == "falling", since=cut)
        off = run.until(lambda c: c["guard"]["states"]["X"] == "off", since=cut)
        story = run.cycles[run.cycles.index(held) : run.cycles.index(off) + 1]
        _held_then_ramped(story, before["correction"]["X"])
        for cycle in run.cycles[cut:]:
            assert cycle["guard"]["states"]["Y"] == "active"
            assert cycle["guard"]["states"]["Z"] == "active"
            assert abs(error_um(cycle, "Y")) < MODEL_UM
            assert abs(error_um(cycle, "Z")) < MODEL_UM
        word = int.from_bytes(read_holding(simulator.port, 0, 1))
        assert word & Status.SIGNAL_FAULT
        assert word & Status.Y_ACTIVE
        assert word & Status.Z_ACTIVE
        assert not word & (Status.X_ACTIVE | Status.COMPENSATING)
        healed = len(run.cycles)
        set_fault(simulator.port, "thermistors_open", 0)
        full = run.until(compensating, since=healed)
        assert abs(error_um(full, "X")) < MODEL_UM
        run.end()
        assert run.journal.count("signal T_x1: broken wire") == 1


def _held_then_ramped(story: list[Cycle], before: float) -> None:
    """X of the cycles from the first held to the first that is off."""
    held = [c for c in story if c["guard"]["states"]["X"] == "holding"]
    falling = [c["correction"]["X"] for c in story if c["guard"]["states"]["X"] == "falling"]
    assert held[-1]["time"] - held[0]["time"] <= 1.1
    assert story[-1]["time"] - story[0]["time"] >= 2.9
    assert all(abs(c["correction"]["X"] - before) < 1e-4 for c in held)
    # what is ramped follows the machine, which warms on: two cycles close together may rise by that
    assert all(abs(b) < abs(a) + 5e-5 for a, b in pairwise(falling))
    assert story[-1]["correction"]["X"] == 0.0
    assert story[-1]["corrected"]["X"] == story[-1]["indicated"]["X"]


def test_a_frozen_controller_behind_a_living_server_is_noticed(tmp_path: Path) -> None:
    """It answers, with the same position for ever: its heartbeat tells."""
    with machine(tmp_path) as (simulator, config), live_run(config) as run:
        run.until(compensating)
        stopped = len(run.cycles)
        mbpoll("-r", "2", "-t", "0", port=simulator.port, values=[1])
        off = run.until(lambda c: set(c["guard"]["states"].values()) == {"off"}, since=stopped)
        assert "heartbeat stands still" in off["faults"]["axis X"]
        assert set(off["corrected"].values()) == {None}
        mbpoll("-r", "2", "-t", "0", port=simulator.port, values=[0])
        run.until(compensating, since=len(run.cycles))
        run.end()
