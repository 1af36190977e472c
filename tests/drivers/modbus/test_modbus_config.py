"""The configuration: what is refused, and that the refusal names the key and both channels."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from abbe.drivers.link import PLUGINS, link_class
from abbe.drivers.modbus.config import BlockConfig, ModbusChannelConfig, ModbusConfig
from abbe.drivers.modbus.link import ModbusLink

DOCUMENTED = """
[links.cmm]
driver = "modbus"
transport = "tcp"
host = "127.0.0.1"
port = 5020
timeout = 0.3
max_gap = 8
reconnect_min = 0.1
reconnect_max = 2.0
quarantine_after = 2
quarantine_max = 10.0
[links.cmm.blocks.fast]
every = 0.0
[links.cmm.blocks.slow]
every = 1.0
unit_id = 7
[links.cmm.channels.enc_x]
table = "input"
address = 0
type = "int32"
order = "CDAB"
unit_id = 1
block = "fast"
scale = 0.5
offset = 1.0
unit = "counts"
[links.cmm.channels.T_x]
table = "input"
address = 20
type = "uint16"
block = "slow"
[links.cmm.channels.ready]
table = "discrete"
address = 3
[links.cmm.channels.fault]
table = "holding"
address = 9
type = "bit"
bit = 5
[links.cmm.channels.out_x]
table = "holding"
address = 100
type = "int32"
writable = true
verify = true
"""


def section(**changes: Any) -> dict[str, Any]:
    base: dict[str, Any] = {"host": "127.0.0.1", "channels": {"a": channel()}}
    return base | changes


def channel(**changes: Any) -> dict[str, Any]:
    return {"table": "holding", "address": 0, "type": "int16"} | changes


def refusal(**changes: Any) -> str:
    with pytest.raises(ValidationError) as caught:
        ModbusConfig.model_validate(section(**changes))
    return str(caught.value)


def test_the_driver_is_found_by_its_name() -> None:
    assert "modbus" in PLUGINS.entries()
    assert link_class("modbus") is ModbusLink
    assert ModbusLink.Config is ModbusConfig


def test_the_documented_section_and_its_description_for_people() -> None:
    table = tomllib.loads(DOCUMENTED)["links"]["cmm"]
    del table["driver"]
    config = ModbusConfig.model_validate(table)
    assert [config.unit_of(name) for name in ("enc_x", "T_x", "out_x")] == [1, 7, 1]
    assert [config.period_of(name) for name in ("enc_x", "T_x", "out_x")] == [0.0, 1.0, 0.0]
    assert dict(ModbusLink("cmm", config).channels) == {
        "enc_x": "unit 1 input 0..1, int32 CDAB, × 0.5 + 1, in counts",
        "T_x": "unit 7 input 20, uint16, every 1 s",
        "ready": "unit 1 discrete 3, bit",
        "fault": "unit 1 holding 9 bit 5, bit",
        "out_x": "unit 1 holding 100..101, int32 ABCD, written, verified",
    }


def test_an_rtu_section_and_its_silence_between_frames() -> None:
    config = ModbusConfig.model_validate(
        {"transport": "rtu", "port": "/dev/ttyUSB0", "baudrate": 9600, "parity": "E"}
        | {"channels": {"a": channel()}}
    )
    assert config.where == "/dev/ttyUSB0"
    assert config.character_time == pytest.approx(11 / 9600)
    assert config.silence == pytest.approx(3.5 * 11 / 9600)
    fast = config.model_copy(update={"baudrate": 115200})
    assert fast.silence == 1.75e-3
    assert config.model_copy(update={"pause": 0.02}).silence == 0.02


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"hots": "x"}, "hots"),
        ({"host": None}, "host is missing"),
        ({"port": "/dev/ttyUSB0"}, "expected a TCP port"),
        ({"port": 70000}, "expected a TCP port"),
        ({"baudrate": 9600}, "baudrate: only for transport = 'rtu'"),
        ({"transport": "rtu"}, "expected a device"),
        ({"transport": "rtu", "port": "/dev/ttyUSB0"}, "host: only for transport = 'tcp'"),
        ({"timeout": 0.0}, "timeout"),
        ({"timeout": "0.3"}, "timeout"),
        ({"timeout": float("nan")}, "timeout"),
        ({"reconnect_min": 3.0}, "reconnect_max 2.0 is below reconnect_min 3.0"),
        ({"max_registers": 126}, "max_registers"),
        ({"max_registers": 1, "channels": {"a": channel(type="int32")}}, "'a': int32 takes 2"),
        ({"channels": {}}, "channels"),
        ({"channels": {"a": channel(block="slwo")}}, "'a': block 'slwo' is not defined"),
        ({"channels": {"a": channel(type=None)}}, "type is missing"),
        ({"channels": {"a": channel(type="int24")}}, "channels.a.type"),
        ({"channels": {"a": channel(order="ACBD")}}, "channels.a.order"),
        ({"channels": {"a": channel(adress=1)}}, "channels.a.adress"),
        ({"channels": {"a": channel(address=65536)}}, "channels.a.address"),
        ({"channels": {"a": channel(address=True)}}, "channels.a.address"),
        ({"channels": {"a": channel(address=65535, type="int32")}}, "beyond address 65535"),
        ({"channels": {"a": channel(table="coil")}}, "a coil is one bit"),
        ({"channels": {"a": channel(table="coil", type="bit", bit=1)}}, "bit belongs to"),
        ({"channels": {"a": channel(type="bit")}}, "bit belongs to"),
        ({"channels": {"a": channel(bit=3)}}, "bit belongs to"),
        ({"channels": {"a": channel(type="bit", bit=3, scale=2.0)}}, "neither scale nor offset"),
        ({"channels": {"a": channel(type="bit", bit=3, writable=True)}}, "uint16"),
        ({"channels": {"a": channel(table="input", writable=True)}}, "cannot write input"),
        ({"channels": {"a": channel(verify=True)}}, "verify is for channels with writable"),
        ({"channels": {"a": channel(scale=0.0)}}, "scale is 0"),
        ({"channels": {"a": channel(scale=float("inf"))}}, "channels.a.scale"),
        ({"channels": {"a": channel(type="int64", scale=1e300)}}, "beyond a float64"),
    ],
)
def test_what_cannot_work_is_refused(changes: dict[str, Any], said: str) -> None:
    assert said in refusal(**changes)


@pytest.mark.parametrize("unit", [0, 248])
def test_rtu_units_are_1_to_247(unit: int) -> None:
    with pytest.raises(ValidationError, match="'a': unit_id"):
        ModbusConfig.model_validate(
            {"transport": "rtu", "port": "/dev/null", "channels": {"a": channel(unit_id=unit)}}
        )


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (channel(type="int32", address=10), channel(type="int16", address=11)),
        (channel(type="float64", address=10), channel(type="int32", address=12)),
        (channel(type="uint16", address=10), channel(type="int16", address=10)),
        (channel(type="int32", address=10), channel(type="int32", address=11)),
    ],
)
def test_overlapping_writable_channels_are_refused_by_both_names(
    first: dict[str, Any], second: dict[str, Any]
) -> None:
    first, second = first | {"writable": True}, second | {"writable": True}
    said = refusal(channels={"late": second, "early": first})
    assert "'early'" in said
    assert "'late'" in said
    assert "overlap" in said


def test_overlaps_that_cannot_hurt_are_allowed() -> None:
    ModbusConfig.model_validate(
        section(
            channels={
                "word": channel(address=10, type="uint16", writable=True),
                "its_bit": channel(address=10, type="bit", bit=3),
                "other_unit": channel(address=10, type="int16", writable=True, unit_id=2),
                "coil": {"table": "coil", "address": 10, "writable": True},
                "next": channel(address=11, type="int32", writable=True),
            }
        )
    )


PAGE = (Path(__file__).parents[3] / "docs" / "modbus.md").read_text("utf-8")


@pytest.mark.parametrize("model", [ModbusConfig, BlockConfig, ModbusChannelConfig])
def test_every_key_is_on_the_users_page(model: type[BaseModel]) -> None:
    missing = [
        k for k in model.model_fields if not re.search(rf"[`\[.]{k}[`.\]]|^{k} = ", PAGE, re.M)
    ]
    assert missing == []


def test_the_users_page_shows_configurations_that_load() -> None:
    first, second = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    config = tomllib.loads(first)["links"]["cmm"]
    assert config.pop("driver") == "modbus"
    checked = ModbusConfig.model_validate(config)
    said = ModbusLink("cmm", checked).channels["enc_x"]
    assert f"`enc_x: {said}`" in PAGE
    ModbusConfig.model_validate({"host": "h"} | tomllib.loads(second)["links"]["cmm"])
