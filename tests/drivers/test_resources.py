"""Resources are spelled alike, whoever names them and however they are written."""

from pathlib import Path

import pytest

from abbe.drivers import resources
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.link import ModbusLink
from abbe.drivers.stores.base import store_class


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST", "127.0.0.1", "::1", "[::1]"])
def test_this_computer_has_one_name(host: str) -> None:
    assert resources.tcp(host, 502) == "tcp 127.0.0.1:502"


@pytest.mark.parametrize(
    ("host", "name"),
    [
        ("CMM.local", "cmm.local:502"),
        ("cmm.local.", "cmm.local:502"),
        ("192.168.0.10", "192.168.0.10:502"),
        ("FE80:0:0::1", "[fe80::1]:502"),
    ],
)
def test_a_server_is_spelled_in_one_way(host: str, name: str) -> None:
    assert resources.tcp(host, 502) == f"tcp {name}"


def test_a_serial_port_is_the_device_behind_its_links(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    device.touch()
    by_id = tmp_path / "by-id"
    by_id.symlink_to(device)
    spellings = (str(device), str(by_id), f"serial://{by_id}", f"{tmp_path}/./ttyUSB0")
    assert {resources.serial(s) for s in spellings} == {(f"serial {device.resolve()}",)}
    # an adapter on the same port is the same resource
    assert resources.can("slcan", f"{by_id}@115200") == (f"serial {device.resolve()}",)


def test_a_terminal_server_is_a_server() -> None:
    for url in ("socket://Box:4001", "rfc2217://box:4001?logging=debug", "socket://box:4001/"):
        assert resources.serial(url) == ("tcp box:4001",)


def test_units_behind_a_gateway_are_controllers_of_their_own() -> None:
    assert resources.modbus("Gate", 502, 2) != resources.modbus("gate", 502, 3)
    # who is not behind a gateway may be called by any of these
    assert len({resources.modbus("gate", 502, unit) for unit in (0, 1, 255)}) == 1


def test_a_modbus_link_owns_the_units_that_it_uses() -> None:
    word = {"table": "holding", "address": 0, "type": "uint16", "writable": True}
    channels = {"word": word, "air": {**word, "writable": False, "unit_id": 7}}
    section = {"host": "gate", "port": 502, "unit_id": 2, "channels": channels}
    link = ModbusLink("cmm", ModbusConfig.model_validate(section))
    assert link.owns == ("tcp gate:502 unit 2", "tcp gate:502 unit 7")
    assert link.owns_for(["word"]) == ("tcp gate:502 unit 2",)


def test_what_no_other_process_can_have_is_nobodys() -> None:
    assert resources.serial("loop://") == ()
    assert resources.can("virtual", "a") == ()


def test_only_what_keeps_its_askers_apart_may_be_read_beside_its_owner() -> None:
    assert resources.readers_may_share(resources.tcp("a", 1))
    assert resources.readers_may_share(resources.linuxcnc())
    assert not resources.readers_may_share("serial /dev/ttyS0")
    assert not resources.readers_may_share("can socketcan can0")


def owned(driver: str, **section: object) -> tuple[str, ...]:
    kind = store_class(driver)
    return kind("store", kind.Config.model_validate(section)).owns


def test_stores_name_what_they_write_to(tmp_path: Path) -> None:
    assert owned("modbus", host="Localhost", port=5020) == ("tcp 127.0.0.1:5020 unit 1",)
    assert owned("modbus", host="plc", port=502, unit_id=3) == ("tcp plc:502 unit 3",)
    assert owned("modbus", transport="rtu", port="/dev/null") == ("serial /dev/null",)
    assert owned("serial", port="/dev/null") == ("serial /dev/null",)
    assert owned("canopen", interface="socketcan", channel="can0", node=3) == (
        "can socketcan can0",
    )
    ini = tmp_path / "mill.ini"
    assert owned("linuxcnc", ini=str(ini)) == ("linuxcnc hal", f"linuxcnc {ini.resolve()}")
