"""Uploads over Modbus to a simulated control in a process of its own: every step × every fault."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.daemon.upload.history.log_head import path_of
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.upload_cases import QUICK, SLOW, Place, sums, texts
from tests.support.daemon.upload_truth import attempt, cases, check_all, try_fault

pytestmark = pytest.mark.integration


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
    return Place(tmp_path, control, keys, SLOW)


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


@pytest.mark.one_in(8)
@pytest.mark.parametrize(("step", "kind"), cases())
def test_every_step_with_every_fault(place: Place, made: Path, step: str, kind: str):
    patient = QUICK | {"timeout": 3.0, "command_timeout": 5.0, "reconnect_within": 5.0}
    try_fault(place, made, step, kind, QUICK, patient)


def test_a_controller_that_adds_something_else_gets_its_old_table_back(place: Place, made: Path):
    place.configure(**SLOW)
    place.control.order("fault", kind="lies", at="show", times=100)
    result = place.upload(made / "new")
    assert check_all(place, (result, ""), sums(made / "old"), sums(made / "new")) == "old"
    assert "the controller adds" in result.outcome.why
    assert result.outcome.step == "effect"


def test_a_controller_that_lies_in_every_read_back_never_gets_the_new_table(
    place: Place, made: Path
):
    place.configure(patience=0.3, **SLOW)
    place.control.order("fault", kind="lies", at="read_staged", times=1000)
    result = place.upload(made / "new")
    assert check_all(place, (result, ""), sums(made / "old"), sums(made / "new")) == "old"
    assert result.outcome.step == "compare"


def test_a_controller_that_lies_about_what_is_active_is_not_believed(place: Place, made: Path):
    place.configure(patience=0.3, **SLOW)
    place.control.order("fault", kind="lies", at="read_active", after="commit", times=1000)
    result = place.upload(made / "new")
    assert result.outcome.open
    assert check_all(place, (result, ""), sums(made / "old"), sums(made / "new")) == (
        "open, then new"
    )


def test_the_power_of_the_controller_fails_between_any_two_operations(place: Place, made: Path):
    """A power cut before each single operation of one upload in turn."""
    place.configure(**(SLOW | {"timeout": 1.0}))
    place.upload(made / "new")
    asked = place.truth()["asked"]
    seen: dict[str, int] = {}
    ends = set()
    for operation in dict.fromkeys(asked):
        seen[operation] = asked.count(operation)
    for operation, count in seen.items():
        for skip in {count // 2}:
            place.control.order("reset")
            place.control.order("load", files=texts(made / "old"))
            place.control.order("fault", kind="restart", at=operation, skip=skip, seconds=0.05)
            for file in (place.journal, path_of(place.journal)):
                file.unlink(missing_ok=True)
            done = attempt(lambda: place.upload(made / "new"))
            ends.add(check_all(place, done, sums(made / "old"), sums(made / "new")))
    assert ends >= {"new", "old"}
