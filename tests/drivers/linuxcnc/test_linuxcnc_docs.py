"""docs/linuxcnc.md and the configuration: examples work, keys are told, mistakes are refused."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from abbe.drivers.link import PLUGINS, link_class
from abbe.drivers.linuxcnc.config import STATE_BITS, LinuxCncChannelConfig, LinuxCncConfig
from abbe.drivers.linuxcnc.link import LinuxCncLink
from abbe.drivers.stores.linuxcnc.config import LinuxCncStoreConfig

DOC = (Path(__file__).parents[3] / "docs" / "linuxcnc.md").read_text(encoding="utf-8")
EXAMPLES = [
    section
    for text in re.findall(r"```toml\n(\[links.*?)```", DOC, re.S)
    for section in tomllib.loads(text)["links"].values()
]


def test_examples_work() -> None:
    assert EXAMPLES
    for section in EXAMPLES:
        rest = dict(section)
        assert link_class(rest.pop("driver")) is LinuxCncLink
        link = LinuxCncLink("mill", LinuxCncConfig.model_validate(rest))
        assert set(link.channels) == set(rest["channels"])
    assert PLUGINS.entries()["linuxcnc"].value == "abbe.drivers.linuxcnc.link:LinuxCncLink"


@pytest.mark.parametrize("config", [LinuxCncConfig, LinuxCncChannelConfig, LinuxCncStoreConfig])
def test_every_key_is_documented(config: Any) -> None:
    for key in config.model_fields:
        if key != "channels":
            assert re.search(rf"`{key}\b", DOC), key


def test_every_bit_is_documented() -> None:
    for pin, bit in STATE_BITS.items():
        assert f"| {bit} | `{pin}` |" in DOC


@pytest.mark.parametrize(
    ("channels", "wrong"),
    [
        ({}, "at least 1 item"),
        ({"x": {}}, "needs one of pin, offset and word"),
        ({"x": {"pin": "a", "word": "state"}}, "needs one of"),
        ({"x": {"offset": "X"}}, "every offset needs it"),
        ({"x": {"pin": "a", "max": 1.0}}, "max belongs to an offset"),
        ({"x": {"offset": "Q", "max": 1.0}}, "'X', 'Y', 'Z'"),
        ({"x": {"offset": "X", "max": 0.0}}, "greater than 0"),
        ({"x": {"offset": "X", "max": 1e6}}, "LinuxCNC counts in 32 bits"),
        ({"x": {"offset": "X", "max": 1.0, "unit": "mm"}}, "only for a pin"),
        ({"x": {"pin": "a", "resolution": 0.1}}, "only for an offset"),
        ({"x": {"pin": "a", "scale": 0.0}}, "scale is 0"),
        ({"x": {"pin": "a", "writable": True}}, "Extra inputs"),
        (
            {"x": {"offset": "X", "max": 1.0}, "y": {"offset": "X", "max": 1.0}},
            "'x' and 'y' are both the offset of axis X",
        ),
    ],
)
def test_a_configuration_that_cannot_work(channels: dict[str, Any], wrong: str) -> None:
    with pytest.raises(ValidationError, match=wrong):
        LinuxCncConfig.model_validate({"channels": channels})
