"""Uploads to a simulated CANopen control over slcan: every step × every fault."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.upload_cases import Place, sums, texts
from tests.support.daemon.upload_truth import cases, try_fault

pytestmark = pytest.mark.integration

SLOW = {"timeout": 10.0, "command_timeout": 20.0, "reconnect_within": 20.0}
QUICK = {"timeout": 0.2, "command_timeout": 0.5, "reconnect_within": 0.3, "attempts": 3}


class NumberedPlace(Place):
    """CANopen's serial numbers are numbers."""

    def configure(self, patience: float = 60.0, more: str = "", **keys: Any) -> None:
        super().configure(patience, more, **keys)
        self.config.write_text(self.config.read_text().replace("SIM-4711", "4711"))


@pytest.fixture(scope="module")
def control(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedProcess]:
    memory = tmp_path_factory.mktemp("control") / "memory"
    with SimulatedProcess("controller", "canopen", "--memory", str(memory)) as process:
        yield process


@pytest.fixture
def place(made: Path, control: SimulatedProcess, tmp_path: Path) -> Place:
    shutil.copy(made / "model.toml", tmp_path)
    control.order("reset")
    control.order("load", files=texts(made / "old"))
    keys = {
        "driver": "canopen",
        "interface": "slcan",
        "channel": control.ready["channel"],
        "bitrate": 500_000,
        "options.sleep_after_open": 0.0,
        "node": control.ready["node"],
    }
    return NumberedPlace(tmp_path, control, keys, SLOW)


def test_upload_and_roll_back(place: Place, made: Path) -> None:
    place.configure(**SLOW)
    result = place.upload(made / "new")
    assert result.ok, result.outcome.lines()
    assert "15 corrections" in result.outcome.seen
    assert place.truth()["active"] == sums(made / "new")
    assert place.roll_back().ok
    assert place.truth()["active"] == sums(made / "old")


@pytest.mark.one_in(8)
@pytest.mark.parametrize(("step", "kind"), cases())
def test_every_step_with_every_fault(place: Place, made: Path, step: str, kind: str) -> None:
    patient = QUICK | {"timeout": 3.0, "reconnect_within": 5.0}
    print("RESULT", step, kind, try_fault(place, made, step, kind, QUICK, patient))
