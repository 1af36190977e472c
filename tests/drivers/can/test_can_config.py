"""Configurations of CAN links that cannot work: what is wrong, and where."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.config import load_config
from abbe.drivers.can.canopen.config import CanopenConfig
from abbe.drivers.can.canopen.link import CanopenLink
from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.link import DbcLink
from abbe.drivers.link import LinkConfigError
from tests.support.drivers.can.links import DBC, FD_DBC, READ

SECTION = {"dbc": str(DBC), "channels": READ, "interface": "slcan", "channel": "x"}
NODES = {
    "interface": "slcan",
    "channel": "x",
    "nodes": {"x": {"id": 3}},
    "channels": {"x": {"node": "x", "profile": "cia406"}},
}


@pytest.mark.parametrize(
    ("change", "wrong", "field"),
    [
        ({"dbc": "/no/such.dbc"}, "there is no file /no/such.dbc", ("dbc",)),
        (
            {"channels": {"x": {"message": "NO"}}},
            "has no message 'NO'; it has: POSITION, TEMP",
            ("channels", "x", "message"),
        ),
        (
            {"channels": {"x": {"message": "POSITION"}}},
            "message POSITION has no signal 'x'; it has: position_x",
            ("channels", "x"),
        ),
        ({"messages": {"NO": {}}}, "has no message 'NO'", ("messages", "NO")),
        (
            {"messages": {"POSITION_Z": {}}},
            "message POSITION_Z is used by no channel",
            ("messages", "POSITION_Z"),
        ),
        (
            {"interface": "telepathy"},
            "python-can has no interface 'telepathy'; it has: .*pcan.*socketcan",
            ("interface",),
        ),
        (
            {"options": {"sleep_after_opne": 1}},
            "no 'sleep_after_opne'; there are: .*sleep_after_open",
            ("options", "sleep_after_opne"),
        ),
    ],
)
def test_what_only_the_link_can_know(
    change: dict[str, Any], wrong: str, field: tuple[str, ...]
) -> None:
    config = DbcConfig.model_validate(SECTION | change)
    with pytest.raises(LinkConfigError, match=wrong) as caught:
        DbcLink("bench", config)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"channels": {"x": {"message": "M", "scale": 0.0}}}, "scale is 0"),
        ({"messages": {"POSITION": {"request": {"id": 1, "data": "0"}}}}, "up to eight bytes"),
        ({"channel": None}, "channel"),
        ({"bit_rate": 5}, "Extra inputs"),
    ],
)
def test_what_the_section_shows(change: dict[str, Any], wrong: str) -> None:
    with pytest.raises(ValueError, match=wrong):
        DbcConfig.model_validate(SECTION | change)


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"nodes": {"x": {"id": 3}, "y": {"id": 3}}}, "nodes 'x' and 'y' both have id 3"),
        ({"nodes": {"y": {"id": 3}}}, "channel 'x': node 'x' is not defined; there are: y"),
        ({"channels": {"x": {"node": "x"}}}, "needs either profile or index"),
        ({"channels": {"x": {"node": "x", "index": 0x2000}}}, "type is missing"),
        ({"channels": {"x": {"node": "x", "profile": "cia404"}}}, "input belongs to"),
        (
            {"channels": {"x": {"node": "x", "profile": "cia406", "within": 1.0}}},
            "within: only for by = 'pdo'",
        ),
        (
            {
                "nodes": {"x": {"id": 3, "start": False}},
                "channels": {"x": {"node": "x", "profile": "cia406", "by": "pdo"}},
            },
            "by = 'pdo' needs node 'x' started",
        ),
    ],
)
def test_what_the_section_of_nodes_shows(change: dict[str, Any], wrong: str) -> None:
    with pytest.raises(ValueError, match=wrong):
        CanopenConfig.model_validate(NODES | change)


def test_an_interface_of_nodes_that_does_not_exist() -> None:
    config = CanopenConfig.model_validate(NODES | {"interface": "socket"})
    with pytest.raises(LinkConfigError, match="no interface 'socket'; it has: .*socketcan"):
        CanopenLink("bench", config)


def dbc(folder: Path, text: str) -> DbcConfig:
    """A link's section with a DBC file of its own beside the configuration."""
    (folder / "own.dbc").write_text(text, encoding="utf-8")
    section = SECTION | {"dbc": "own.dbc", "channels": {"a": {"message": "A"}}}
    return DbcConfig.model_validate(section, context={"folder": folder})


def test_a_file_that_is_no_dbc(tmp_path: Path) -> None:
    with pytest.raises(LinkConfigError, match=r"own.dbc cannot be read: .*line 1"):
        DbcLink("bench", dbc(tmp_path, "BO_ nonsense"))


SIGNAL = ' SG_ {0} : 0|16@1- (1,0) [0|0] "mm" Abbe\n'


def test_frames_that_nobody_can_tell_apart(tmp_path: Path) -> None:
    text = 'VERSION ""\nBU_: Abbe\n'
    text += "BO_ 5 A: 8 Abbe\n" + SIGNAL.format("a") + "\nBO_ 5 B: 8 Abbe\n" + SIGNAL.format("b")
    config = dbc(tmp_path, text)
    both = config.model_copy(
        update={
            "channels": DbcConfig.model_validate(
                SECTION | {"channels": {"a": {"message": "A"}, "b": {"message": "B"}}}
            ).channels
        }
    )
    DbcLink("bench", config)
    with pytest.raises(LinkConfigError, match="messages A and B have the same id 5h"):
        DbcLink("bench", both)


def test_can_fd_on_a_link_that_is_not(tmp_path: Path) -> None:
    config = dbc(tmp_path, FD_DBC.replace("ARRAY", "A").replace("first", "a"))
    with pytest.raises(LinkConfigError, match=r"A is a CAN FD frame .*options = \{ fd = true \}"):
        DbcLink("bench", config)


CONFIG = """format = "abbe-config/1"
model = "model.toml"

[links.bus]
driver = "can"
interface = "slcan"
channel = "/dev/ttyACM0"
dbc = "{dbc}"

[links.bus.channels.x]
message = "{message}"
signal = "position_x"

[axes.X]
source = "bus.x"

[guard]
max_correction = 0.1
max_rate = 0.1
"""
MODEL = """format = "abbe-model/1"
[machine]
name = "Bench"
structure = "w b X t"
reference_temperature = 20.0
[machine.axes.X]
travel = [0.0, 700.0]
"""


def configured(folder: Path, message: str, file: str = str(DBC)) -> Path:
    """A whole configuration, with a model."""
    (folder / "model.toml").write_text(MODEL, encoding="utf-8")
    config = folder / "config.toml"
    config.write_text(CONFIG.format(dbc=file, message=message), encoding="utf-8")
    return config


def test_an_error_names_file_line_and_key(tmp_path: Path) -> None:
    load_config(configured(tmp_path, "POSITION"))
    with pytest.raises(InputError) as caught:
        load_config(configured(tmp_path, "POSITOIN"))
    error = caught.value
    assert (error.line, error.field) == (11, "links.bus.channels.x.message")
    assert f"{tmp_path / 'config.toml'}, line 11" in str(error)
    assert "has no message 'POSITOIN'; it has: POSITION" in str(error)
    with pytest.raises(InputError) as caught:
        load_config(configured(tmp_path, "POSITION", "no.dbc"))
    assert (caught.value.line, caught.value.field) == (8, "links.bus.dbc")


BLOCKED = """
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocked())
from abbe.daemon.cli import main
sys.argv = ["abbe", "check", {config!r}]
main()
"""


@pytest.mark.one_in(2)
@pytest.mark.parametrize("driver", ["can", "canopen"])
@pytest.mark.parametrize("names", [("can", "canopen", "cantools"), ("canopen", "cantools")])
def test_without_the_extra_it_says_what_to_install(
    tmp_path: Path, driver: str, names: tuple[str, ...]
) -> None:
    config = configured(tmp_path, "POSITION")
    if driver == "canopen":
        text = config.read_text("utf-8").replace('driver = "can"', 'driver = "canopen"')
        text = text.replace(f'dbc = "{DBC}"', "nodes = { x = { id = 3 } }")
        text = text.replace('message = "POSITION"', 'node = "x"')
        text = text.replace('signal = "position_x"', 'profile = "cia406"\nunit = "mm"')
        config.write_text(text, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED.format(names=names, config=str(config))],
        capture_output=True,
        text=True,
        timeout=100,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])},
        check=False,
    )
    assert done.returncode == 1, done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert "pip install 'abbe[can]'" in done.stderr
    assert f"{config}, line 5" in done.stderr
    package = "python-can" if "can" in names else {"can": "cantools"}.get(driver, driver)
    assert package in done.stderr
