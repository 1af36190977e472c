"""Commands that ``abbe upload`` and the service print are run as printed, quotes and all."""

from __future__ import annotations

import asyncio
import json
import logging
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.daemon.config import load_config
from abbe.daemon.service import Service
from abbe.daemon.upload.operator import TerminalOperator
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.command_line import Done, abbe
from tests.support.daemon.upload_cases import QUICK, SLOW, Place, sums, texts

pytestmark = pytest.mark.integration

COMMAND = re.compile(r"\babbe upload [^\n;]*")


def printed(text: str) -> str:
    """The one command in a text."""
    (found,) = set(COMMAND.findall(text))
    return found.strip()


def run(command: str) -> Done:
    words = shlex.split(command)
    assert words[0] == "abbe"
    return abbe(*words[1:])


def placed(made: Path, tmp_path: Path, control: SimulatedProcess, **more: object) -> Place:
    """A folder whose name needs quotes, and a control with the old tables."""
    folder = tmp_path / "hall 3, 'south'"
    folder.mkdir()
    shutil.copy(made / "model.toml", folder)
    control.order("load", files=texts(made / "old"))
    keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"], **more}
    place = Place(folder, control, keys, SLOW)
    place.configure(**SLOW)
    return place


@pytest.fixture
def place(made: Path, tmp_path: Path) -> Iterator[Place]:
    with SimulatedProcess("controller", "modbus") as control:
        yield placed(made, tmp_path, control)


def left_open(place: Place, made: Path, *more: str) -> str:
    """An upload to a control that falls silent while it activates; what is printed."""
    place.configure(patience=0.01, **QUICK)
    place.control.order("fault", kind="hang_after", at="commit")
    failed = abbe("upload", place.config, made / "new", "--yes", *more)
    assert failed.status == 1
    assert "NOT known" in failed.out or "null" in failed.out
    place.configure(**SLOW)
    place.control.order("wake")
    return failed.out


def recovered(place: Place, made: Path, command: str) -> None:
    """The command brings the upload to its end: the new tables are active."""
    done = run(command)
    assert done.status == 0, done
    assert "is active, verified by reading it back" in done.out
    assert place.truth()["active"] == sums(made / "new")
    assert "was not finished" not in abbe("upload", place.config, "--status").out


def test_what_was_left_open_is_recovered_as_printed(place: Place, made: Path):
    command = printed(left_open(place, made))
    assert command == printed(abbe("upload", place.config, "--status").out)
    recovered(place, made, command)


def test_the_services_warning_and_json_say_the_same(
    place: Place, made: Path, caplog: pytest.LogCaptureFixture
):
    answer = json.loads(left_open(place, made, "--json"))
    assert answer["journal"] == "open"
    with caplog.at_level(logging.WARNING, "abbe.service"):
        asyncio.run(Service(load_config(place.config)).run(0.05))
    recovered(place, made, printed(caplog.text))


def test_an_old_table_that_could_not_be_put_back(
    place: Place, made: Path, monkeypatch: pytest.MonkeyPatch
):
    """The new one acts otherwise than it says, and the machine moves when it is taken back."""
    place.configure(**SLOW | {"patience": 0.01})
    place.control.order("fault", kind="lies", at="show", times=1000)
    tell = TerminalOperator.tell

    def hindering(self: TerminalOperator, line: str) -> None:
        if line.startswith("putting the old table"):
            place.control.order("machine", idle=False)
        tell(self, line)

    monkeypatch.setattr(TerminalOperator, "tell", hindering)
    failed = abbe("upload", place.config, made / "new", "--yes", "--json")
    assert failed.status == 1
    answer = json.loads(failed.out)
    assert (answer["active"], answer["failed_step"]) == ("new", "effect")
    assert "Mend that" in answer["notes"][-1]
    monkeypatch.undo()
    place.control.order("clear")
    place.control.order("machine", idle=True)
    done = run(printed("\n".join(answer["notes"])))
    assert done.status == 0, done
    assert "verified by reading it back" in done.out
    # what was wrong is mended: the new one stays, its effect looked at again
    assert place.truth()["active"] == sums(made / "new")
    assert "was not finished" not in abbe("upload", place.config, "--status").out


def test_the_effect_is_looked_at_after_a_restart(made: Path, tmp_path: Path):
    with SimulatedProcess("controller", "modbus", "--acts-late") as control:
        place = placed(made, tmp_path, control, acts_after_restart=True)
        control.order("power_cut")
        done = abbe("upload", place.config, made / "new", "--yes")
        assert done.status == 0, done.err
        control.order("power_cut")
        checked = run(printed(done.out))
        assert checked.status == 0, checked.err
        assert "the controller adds what the table says" in checked.out
