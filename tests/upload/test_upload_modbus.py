"""Uploads over Modbus to a simulated control in a process of its own: every step × every fault."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from upload_cases import QUICK, SLOW, Place, fill, sums, texts
from upload_truth import attempt, check_all

from drivers.simulated.process import SimulatedProcess
from drivers.simulated.table_faults import KINDS

pytestmark = pytest.mark.integration

STEPS = {
    "preflight_identity": {"at": "identity"},
    "preflight_state": {"at": "state"},
    "backup": {"at": "read_active"},
    "begin": {"at": "begin"},
    "first_block": {"at": "block"},
    "later_block": {"at": "block", "skip": 3},
    "compare": {"at": "read_staged", "skip": 1},
    "ready": {"at": "state", "after": "read_staged"},
    "activate": {"at": "commit"},
    "verify": {"at": "read_active", "after": "commit", "skip": 1},
    "effect": {"at": "show"},
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tables")
    fill(folder)
    return folder


@pytest.fixture(scope="module")
def control(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedProcess]:
    memory = tmp_path_factory.mktemp("control") / "memory"
    with SimulatedProcess("controller", "modbus", "--memory", str(memory)) as process:
        yield process


@pytest.fixture
def place(made: Path, control: SimulatedProcess, tmp_path: Path) -> Place:
    shutil.copy(made / "model.toml", tmp_path)
    control.order("reset")
    control.order("load", files=texts(made / "old"))
    keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"]}
    return Place(tmp_path, control, keys)


def test_first_upload_second_upload_and_roll_back(place: Place, made: Path):
    place.control.order("load", files={})
    place.configure(**SLOW)
    first = place.upload(made / "old")
    assert first.ok
    assert place.truth()["active"] == sums(made / "old")
    second = place.upload(made / "new")
    assert second.ok
    assert "15 corrections" in second.outcome.seen
    assert place.truth()["active"] == sums(made / "new")
    assert place.roll_back().ok
    assert place.truth()["active"] == sums(made / "old")
    assert place.roll_back().cleared.nothing_to_do
    assert len(list((place.folder / "backups").iterdir())) == 3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("step", STEPS)
def test_every_step_with_every_fault(place: Place, made: Path, step: str, kind: str):
    place.configure(patience=0.5, **QUICK)
    place.control.order("fault", kind=kind, seconds=0.4, **STEPS[step])
    done = attempt(lambda: place.upload(made / "new"))
    assert place.truth()["happened"], "the fault did not come about"
    place.control.order("wake")
    print("RESULT", step, kind, check_all(place, done, sums(made / "old"), sums(made / "new")), done[1] or done[0].outcome.lines())
