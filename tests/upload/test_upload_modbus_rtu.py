"""Uploads over Modbus RTU: what a line does, where something is written or decided.

Every step × every fault runs over TCP (`test_upload_modbus`), by the same store.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.upload_cases import QUICK, SLOW, Place, sums, texts
from tests.support.daemon.upload_truth import cases, try_fault

pytestmark = pytest.mark.integration


STEPS = ("block", "compare", "activate", "verify")
KINDS = ("lost_answer", "late_answer", "twice", "bad_answer", "lost_request", "bad_request",
         "restart")  # fmt: skip
CASES = [(step, kind) for step, kind in cases() if step in STEPS and kind in KINDS]


@pytest.fixture(scope="module")
def control(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedProcess]:
    memory = tmp_path_factory.mktemp("control") / "memory"
    with SimulatedProcess("controller", "modbus", "--rtu", "--memory", str(memory)) as process:
        yield process


@pytest.fixture
def place(made: Path, control: SimulatedProcess, tmp_path: Path) -> Place:
    shutil.copy(made / "model.toml", tmp_path)
    control.order("reset")
    control.order("load", files=texts(made / "old"))
    keys = {
        "driver": "modbus",
        "transport": "rtu",
        "port": control.ready["device"],
        "baudrate": control.ready["baudrate"],
    }
    return Place(tmp_path, control, keys, SLOW)


def test_first_upload_second_upload_and_roll_back(place: Place, made: Path):
    place.control.order("load", files={})
    place.configure(**SLOW)
    assert place.upload(made / "old").ok
    assert place.truth()["active"] == sums(made / "old")
    second = place.upload(made / "new")
    assert second.ok
    assert "15 corrections" in second.outcome.seen
    assert place.truth()["active"] == sums(made / "new")
    assert place.roll_back().ok
    assert place.truth()["active"] == sums(made / "old")


@pytest.mark.one_in(6)
@pytest.mark.parametrize(("step", "kind"), CASES)
def test_a_line_that_fails(place: Place, made: Path, step: str, kind: str):
    patient = QUICK | {"timeout": 3.0, "command_timeout": 5.0, "reconnect_within": 5.0}
    try_fault(place, made, step, kind, QUICK, patient)
