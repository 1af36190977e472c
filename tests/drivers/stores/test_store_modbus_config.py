"""What a Modbus store's section may say of its line, and what it makes of it."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from abbe.drivers.stores.modbus.config import ModbusStoreConfig


def test_a_serial_line_is_set_as_a_links():
    store = ModbusStoreConfig.model_validate(
        {
            "transport": "rtu",
            "port": "/dev/ttyUSB0",
            "baudrate": 38400,
            "parity": "E",
            "pause": 0.02,
            "local_echo": True,
            "late_reply_max": 4.0,
        }
    )
    link = store.link()
    assert (link.transport, link.port, link.baudrate, link.parity) == (
        "rtu", "/dev/ttyUSB0", 38400, "E",
    )  # fmt: skip
    assert (link.pause, link.local_echo, link.late_reply_max) == (0.02, True, 4.0)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"host": "10.0.0.1", "baudrate": 19200}, "baudrate: only for transport = 'rtu'"),
        ({"host": "10.0.0.1", "pause": 0.1}, "pause: only for"),
        ({"transport": "rtu", "port": 502}, "expected a device"),
        ({"transport": "rtu", "port": "/dev/ttyUSB0", "host": "10.0.0.1"}, "host: only for"),
    ],
)
def test_keys_of_the_other_transport_are_refused(section, words):
    with pytest.raises(ValidationError, match=words):
        ModbusStoreConfig.model_validate(section)
