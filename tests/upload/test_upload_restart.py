"""A control whose tables act only after it was restarted."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.upload_cases import SLOW, Place, sums, texts

pytestmark = pytest.mark.integration


@pytest.fixture
def place(made: Path, tmp_path: Path) -> Iterator[Place]:
    shutil.copy(made / "model.toml", tmp_path)
    with SimulatedProcess("controller", "modbus", "--acts-late") as control:
        control.order("load", files=texts(made / "old"))
        control.order("power_cut")
        keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"]}
        here = Place(tmp_path, control, keys | {"acts_after_restart": True}, SLOW)
        here.configure(**SLOW)
        yield here


def test_the_operator_restarts_it_and_the_effect_is_checked(place: Place, made: Path):
    def restart() -> bool:
        place.control.order("power_cut")
        return True

    place.when_restart_is_asked = restart
    result = place.upload(made / "new")
    assert result.ok
    assert "15 corrections" in result.outcome.seen
    assert place.truth()["active"] == sums(made / "new")
    assert "has to be restarted for the table to act" in "\n".join(place.said)


def test_nobody_restarts_it_and_that_is_said(place: Place, made: Path):
    result = place.upload(made / "new")
    assert result.ok
    assert result.outcome.seen == ""
    assert "acts after the controller was restarted" in "\n".join(result.outcome.lines())
    assert place.truth()["active"] == sums(made / "new")


def test_a_restart_that_was_none_shows_in_the_effect(place: Place, made: Path):
    """The operator says yes and did nothing: the old table still acts, and it is put back."""
    place.when_restart_is_asked = lambda: True
    text = place.config.read_text()
    place.config.write_text(text.replace("patience", "effect_tolerance_um = 0.05\npatience"))
    result = place.upload(made / "new")
    assert not result.ok
    assert result.outcome.step == "effect"
    assert place.truth()["active"] == sums(made / "old")
    assert "only after the controller was restarted" in "\n".join(result.outcome.lines())


@pytest.mark.parametrize(("kind", "active"), [("hang", "old"), ("hang_after", "new")])
def test_the_control_is_killed_while_it_activates_and_started_again(
    made: Path, tmp_path: Path, kind: str, active: str
):
    """A power cut of the control as a whole: its process killed, a new one on the same memory."""
    shutil.copy(made / "model.toml", tmp_path)
    memory = str(tmp_path / "memory")
    with SimulatedProcess("controller", "modbus", "--memory", memory) as control:
        control.order("load", files=texts(made / "old"))
        keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"]}
        place = Place(tmp_path, control, keys, SLOW)
        place.configure(patience=0.01, timeout=1.0, reconnect_within=0.3)
        control.order("fault", kind=kind, at="commit")
        left = place.upload(made / "new").outcome
        assert left.open
        assert "NOT known" in "\n".join(left.lines())
        control.kill()
    with SimulatedProcess("controller", "modbus", "--memory", memory) as again:
        place.control = again
        place.store["port"] = again.ready["port"]
        place.configure(**SLOW)
        outcome = place.recover()
        assert outcome.active == active
        assert outcome.done == (active == "new")
        assert again.order("truth")["active"] == sums(made / active)
