"""docs/opcua.md: every example works, every key is told, and its default."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_args

import pytest

from abbe.drivers.link import PLUGINS, link_class
from abbe.drivers.opcua.config import OpcuaChannelConfig, OpcuaConfig, Policy, Security, Stamp
from abbe.drivers.opcua.link import OpcuaLink
from tests.support.drivers.link_pages import links_in, page

ROOT = Path(__file__).parents[3]
DOC = page("opcua")
EXAMPLES = links_in(DOC)


@pytest.mark.parametrize(("name", "section"), EXAMPLES, ids=[name for name, _ in EXAMPLES])
def test_examples_work(name: str, section: dict[str, Any]) -> None:
    section = dict(section)
    assert link_class(section.pop("driver")) is OpcuaLink
    link = OpcuaLink(name, OpcuaConfig.model_validate(section))
    assert set(link.channels) == set(section["channels"])
    assert all(link.info(channel).unit for channel in link.channels)


def test_there_are_examples() -> None:
    assert [name for name, _ in EXAMPLES] == ["control", "control"]
    assert PLUGINS.entries()["opcua"].value == "abbe.drivers.opcua.link:OpcuaLink"
    assert "docs/opcua.md" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("config", [OpcuaConfig, OpcuaChannelConfig])
def test_every_key_is_documented(config: Any) -> None:
    for key in config.model_fields:
        if key != "channels":
            assert f"`{key}`" in DOC, f"{config.__name__}.{key}"


def test_every_choice_is_documented() -> None:
    for name in (*get_args(Security), *get_args(Policy), *get_args(Stamp)):
        assert f'`"{name}"`' in DOC, name


def test_the_defaults_are_as_documented() -> None:
    config = OpcuaConfig.model_validate(
        {"url": "opc.tcp://x", "channels": {"x": {"node": "ns=1;s=x"}}}
    )
    for key in (
        "timeout",
        "stamp",
        "subscribe",
        "units",
        "unanswered",
        "security",
        "policy",
        "max_waiting",
    ):
        row = next(line for line in DOC.splitlines() if line.startswith(f"| `{key}`"))
        value = getattr(config, key)
        stated = row.split("|")[2].strip()
        if isinstance(value, str):
            wanted = f'`"{value}"`'
        else:
            wanted = str(value).lower() if isinstance(value, bool) else f"{value:g}"
        assert stated in (wanted, f"{wanted} s"), key
    assert (config.reconnect_min, config.reconnect_max) == (0.5, 10.0)
    assert (config.host, config.port) == ("x", 4840)


def test_the_certificate_s_name_is_the_one_that_is_asked_for() -> None:
    source = (ROOT / "drivers/opcua/session.py").read_text(encoding="utf-8")
    found = re.search(r'_APPLICATION = "(.*)"', source)
    assert found is not None
    assert f"URI:{found[1]}" in DOC
