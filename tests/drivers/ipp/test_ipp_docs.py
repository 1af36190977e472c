"""docs/ipp.md: every example is a configuration that works, every key and order is told."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import pytest

from abbe.drivers.ipp.config import Axis, Coordinates, IppChannelConfig, IppConfig, MoveReportConfig
from abbe.drivers.ipp.link import IppLink
from abbe.drivers.link import PLUGINS, link_class
from abbe.drivers.simulated.commands.ipp import _orders, _parser
from abbe.drivers.simulated.ipp.server import IppServer
from tests.support.drivers.link_pages import links_in, page

ROOT = Path(__file__).parents[3]
DOC = page("ipp")
EXAMPLES = links_in(DOC)


@pytest.mark.parametrize(("name", "section"), EXAMPLES, ids=[name for name, _ in EXAMPLES])
def test_examples_work(name: str, section: dict[str, Any]) -> None:
    section = dict(section)
    kind = link_class(section.pop("driver"))
    assert kind is IppLink
    link = IppLink(name, IppConfig.model_validate(section))
    assert set(link.channels) == set(section["channels"])
    assert all(link.info(channel).unit for channel in link.channels)


def test_there_are_examples() -> None:
    assert [name for name, _ in EXAMPLES] == ["cmm", "reported"]
    assert PLUGINS.entries()["ipp"].value == "abbe.drivers.ipp.link:IppLink"
    assert "docs/ipp.md" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("config", [IppConfig, IppChannelConfig, MoveReportConfig])
def test_every_key_is_documented(config: Any) -> None:
    for key, field in config.model_fields.items():
        if key != "channels":
            assert f"`{field.alias or key}`" in DOC, f"{config.__name__}.{key}"


def test_every_axis_and_coordinate_system_is_documented() -> None:
    for name in (*get_args(Axis), *get_args(Coordinates)):
        assert re.search(rf'`"?{re.escape(name)}"?`', DOC), name


def test_the_defaults_are_as_documented() -> None:
    config = IppConfig.model_validate({"host": "x", "channels": {"x": {"axis": "X"}}})
    for key in (
        "port",
        "timeout",
        "coordinates_every",
        "quarantine_after",
        "quarantine_max",
        "max_waiting",
    ):
        row = next(line for line in DOC.splitlines() if line.startswith(f"| `{key}`"))
        assert row.split("|")[2].strip() in (
            f"{getattr(config, key):g}",
            f"{getattr(config, key):g} s",
        )
    assert (config.reconnect_min, config.reconnect_max) == (0.5, 10.0)
    assert (config.coordinates, config.clear_errors) == ("MachineCsy", False)
    assert MoveReportConfig(time=0.2, distance=1.0).wait_limit == pytest.approx(0.6)


def test_the_simulated_server_is_documented() -> None:
    for option in re.findall(r"--[a-z-]+", _parser().format_help()):
        assert option in DOC or option == "--help", option
    machine: Any = SimpleNamespace(plant=SimpleNamespace(seed=1))
    server = IppServer(machine)
    for order in _orders(server):
        assert f'"do": "{order}"' in DOC
