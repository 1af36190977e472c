"""Uploads over a serial line to a simulated control: every step × every fault."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.upload_cases import Place, sums, texts
from tests.support.daemon.upload_truth import cases, try_fault

pytestmark = pytest.mark.integration

SLOW = {"timeout": 10.0, "stall_timeout": 10.0}
QUICK = {"timeout": 0.15, "stall_timeout": 0.25, "late_reply_max": 0.3, "attempts": 2}


@pytest.fixture(scope="module")
def control(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedProcess]:
    memory = tmp_path_factory.mktemp("control") / "memory"
    with SimulatedProcess("controller", "serial", "--memory", str(memory)) as process:
        yield process


@pytest.fixture
def place(made: Path, control: SimulatedProcess, tmp_path: Path) -> Place:
    shutil.copy(made / "model.toml", tmp_path)
    control.order("reset")
    control.order("load", files=texts(made / "old"))
    keys = {"driver": "serial", "port": control.ready["device"], "baudrate": 1000000, "run_on": 256}
    return Place(tmp_path, control, keys, SLOW)


def test_upload_and_roll_back(place: Place, made: Path):
    place.configure(**SLOW)
    result = place.upload(made / "new")
    assert result.ok, result.outcome.lines()
    assert "15 corrections" in result.outcome.seen
    assert place.truth()["active"] == sums(made / "new")
    assert place.roll_back().ok
    assert place.truth()["active"] == sums(made / "old")


@pytest.mark.one_in(8)
@pytest.mark.parametrize(("step", "kind"), cases())
def test_every_step_with_every_fault(place: Place, made: Path, step: str, kind: str):
    patient = QUICK | {"timeout": 3.0, "stall_timeout": 3.0}
    print("RESULT", step, kind, try_fault(place, made, step, kind, QUICK, patient))
