"""What the tests of serial links share: configurations, opening, waiting."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager
from typing import Any

from abbe.drivers.serial.config import SerialConfig
from abbe.drivers.serial.link import SerialLink
from tests.support.drivers.opening import opened

TIMEOUT = 0.2
ROOM = 1.0
"""s that a shared machine may add to any wait."""
NUMBER = r"[-+][\d.]+"
ALL = rf"X(?P<x>{NUMBER}) Y(?P<y>{NUMBER}) Z(?P<z>{NUMBER})"

DRO: dict[str, Any] = {
    "messages": {"position": {"query": "R", "pattern": ALL}},
    "channels": {axis: {"message": "position", "unit": "mm"} for axis in "xyz"},
}
"""All axes of the simulated read-out by one query."""
ONE_BY_ONE: dict[str, Any] = {
    "messages": {
        f"axis_{axis}": {"query": axis.upper(), "pattern": rf"(?P<{axis}>{NUMBER})"}
        for axis in "xyz"
    },
    "channels": {axis: {"message": f"axis_{axis}", "unit": "mm"} for axis in "xyz"},
}
"""Each axis by a query of its own: the answers look alike."""
PRESET: dict[str, Any] = {
    f"preset_{axis}": {"command": f"P{axis}{{value:+.4f}}", "acknowledge": "OK", "unit": "mm"}
    for axis in "XYZ"
}
XOR = {"kind": "xor", "after": "*"}


def section(port: str, parts: dict[str, Any], **settings: Any) -> SerialConfig:
    return SerialConfig.model_validate(
        {
            "port": port,
            "timeout": TIMEOUT,
            "reconnect_min": 0.02,
            "reconnect_max": 0.1,
            "late_reply_max": 0.6,
        }
        | parts
        | settings
    )


def linked(
    port: str, parts: dict[str, Any], **settings: Any
) -> AbstractAsyncContextManager[SerialLink]:
    return opened(SerialLink("bench", section(port, parts, **settings)))
