"""docs/can.md: every example is a configuration that works, every key and option is told."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from abbe.drivers.can.canopen import config as canopen_config
from abbe.drivers.can.canopen.config import CanopenConfig, NodeConfig
from abbe.drivers.can.dbc import config as dbc_config
from abbe.drivers.can.dbc.config import DbcConfig, DbcMessageConfig, RequestConfig
from abbe.drivers.can.error_frames import LEFT_THE_BUS
from abbe.drivers.link import PLUGINS, link_class
from abbe.drivers.simulated.commands.can import _parser
from tests.support.drivers.can.links import DBC
from tests.support.drivers.link_pages import links_in, page

ROOT = Path(__file__).parents[3]
DOC = page("can")
EXAMPLES = links_in(DOC)


@pytest.mark.parametrize(("name", "section"), EXAMPLES, ids=[name for name, _ in EXAMPLES])
def test_examples_work(name: str, section: dict[str, Any]) -> None:
    section = dict(section)
    kind = link_class(section.pop("driver"))
    config = kind.Config.model_validate(section, context={"folder": DBC.parent})
    link = kind(name, config)
    assert set(link.channels) == set(section["channels"])
    for channel, words in section["channels"].items():
        info = link.info(channel)
        assert info.writable is words.get("writable", False)
        assert info.every == words.get("every", 0.0)
        if "unit" in words:
            assert info.unit == words["unit"]


def test_there_are_examples() -> None:
    assert [name for name, _ in EXAMPLES] == ["can", "encoders", "field", "try_nodes"]
    assert PLUGINS.entries()["can"].value == "abbe.drivers.can.dbc.link:DbcLink"
    assert PLUGINS.entries()["canopen"].value == "abbe.drivers.can.canopen.link:CanopenLink"


@pytest.mark.parametrize(
    "config",
    [
        DbcConfig,
        DbcMessageConfig,
        RequestConfig,
        dbc_config.DbcChannelConfig,
        CanopenConfig,
        NodeConfig,
        canopen_config.CanopenChannelConfig,
    ],
)
def test_every_key_is_documented(config: Any) -> None:
    for key in config.model_fields:
        if key in ("messages", "channels", "nodes"):
            assert f"[links.NAME.{key}." in DOC
        elif config is RequestConfig:
            assert re.search(rf"request.*\b{key} = ", DOC), key
        else:
            assert re.search(rf"`{key}\b", DOC), f"{config.__name__}.{key}"


def test_the_defaults_are_as_documented() -> None:
    dbc = DbcConfig.model_validate(
        {"interface": "x", "channel": 0, "dbc": "x", "channels": {"x": {"message": "M"}}}
    )
    nodes = CanopenConfig.model_validate(
        {"interface": "x", "channel": 0, "nodes": {"x": {"id": 1}}}
    )
    for key in ("open_timeout", "timeout", "late_reply_max", "quarantine_max", "max_waiting"):
        row = next(line for line in DOC.splitlines() if line.startswith(f"| `{key}`"))
        assert f"| {getattr(dbc, key):g}" in row
        assert getattr(dbc, key) == getattr(nodes, key)
    channel = canopen_config.CanopenChannelConfig(node="x", profile="cia406")
    assert (channel.within, channel.every, channel.by, channel.number_type) == (
        1.0,
        0.0,
        "sdo",
        "int32",
    )
    assert "| `within` | 1 s |" in DOC
    assert nodes.nodes["x"].emergency == "bad"


def test_every_option_of_the_simulator_is_documented() -> None:
    for option in re.findall(r"--[a-z-]+", _parser().format_help()):
        assert option in DOC or option == "--help", option


def test_what_is_said_on_the_screen_is_what_the_code_says() -> None:
    files = (*(ROOT / "drivers/can").rglob("*.py"), *(ROOT / "drivers").glob("*.py"))
    code = "".join(path.read_text("utf-8") for path in files)
    plain = re.sub(r'"\s*\n\s*f?"', "", code)
    for words in (
        LEFT_THE_BUS,
        "the interface reports error frames",
        "nobody acknowledges (alone on the bus, or wrong bit rate?)",
        "cannot send: no room for a frame in ",
        "receiving failed: ",
        "the other side hung up (unplugged?)",
        "connected, and nothing comes: ",
        ": no heartbeat for ",
        " did not answer SYNC",
        " did not come ",
        "may still be answered late",
        "none of its messages came",
        "the interface is open, and no node answers",
        "is in none of the node's TPDOs",
        "locked: another program has it",
    ):
        assert words in plain, words
        assert words.strip() in DOC, words


def test_pages_lead_here_and_from_here_somewhere() -> None:
    assert "docs/can.md" in (ROOT / "README.md").read_text("utf-8")
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", DOC):
        assert (ROOT / "docs" / target).resolve().exists(), target
