"""docs/serial.md: every example is a configuration that works, every key is told."""

from __future__ import annotations

import re
from typing import Any

import pytest

from abbe.drivers.link import PLUGINS, link_class
from abbe.drivers.serial.checksum import ALGORITHMS, ChecksumConfig
from abbe.drivers.serial.config import SerialChannelConfig, SerialConfig, SerialMessageConfig
from abbe.drivers.serial.link import SerialLink
from abbe.drivers.serial.tape import TapeSettings
from abbe.drivers.simulated.commands.serial import KINDS, _parser
from tests.support.drivers.link_pages import links_in, page

DOC = page("serial")
EXAMPLES = links_in(DOC)


@pytest.mark.parametrize(("name", "section"), EXAMPLES, ids=[name for name, _ in EXAMPLES])
def test_examples_work(name: str, section: dict[str, Any]) -> None:
    section = dict(section)
    kind = link_class(section.pop("driver"))
    assert kind is SerialLink
    link = SerialLink(name, SerialConfig.model_validate(section))
    assert set(link.channels) == set(section["channels"])
    for channel, text in link.channels.items():
        assert "field" in text
        assert link.info(channel).unit == section["channels"][channel].get("unit", "")


def test_there_are_examples() -> None:
    assert [name for name, _ in EXAMPLES] == ["dro", "thermometers", "laser"]
    assert PLUGINS.entries()["serial"].value == "abbe.drivers.serial.link:SerialLink"


@pytest.mark.parametrize(
    "config", [SerialConfig, SerialMessageConfig, SerialChannelConfig, ChecksumConfig, TapeSettings]
)
def test_every_key_is_documented(config: Any) -> None:
    for key in config.model_fields:
        if key not in ("messages", "channels"):
            assert re.search(rf"`{key}\b", DOC), f"{config.__name__}.{key}"


def test_every_checksum_and_every_simulated_device_is_documented() -> None:
    for kind in ALGORITHMS:
        assert f"`{kind}`" in DOC
    for kind in KINDS:
        assert f"python -m abbe.drivers.simulated serial {kind}" in DOC
    for option in re.findall(r"--[a-z-]+", _parser().format_help()):
        assert option in DOC or option in ("--help", "--speed", "--buffer")


def test_the_defaults_are_as_documented() -> None:
    config = SerialConfig.model_validate(
        {
            "port": "x",
            "messages": {"m": {"query": "R", "pattern": "(?P<x>=)"}},
            "channels": {"x": {"message": "m"}},
        }
    )
    for key in ("timeout", "late_reply_max", "max_line", "quarantine_max", "max_waiting"):
        row = next(line for line in DOC.splitlines() if line.startswith(f"| `{key}`"))
        assert f"| {getattr(config, key):g}" in row
    assert TapeSettings(port="x").run_on == 8
